//! Files of meshes.

use super::*;

#[test]
fn mesh_files_match_their_stated_sizes() {
    let mut volume = Volume::new(&config(0.04), Simd::detect());
    volume.integrate(
        &look(&still(), |_, _| Some(1.0)),
        &camera(),
        &still(),
        &Arrivals::default(),
    );
    let mesh = volume.mesh(&ALL);
    let mut ply = Vec::new();
    mesh.write_ply(&mut ply).unwrap();
    let head = ply.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let body = 27 * mesh.positions.len() + 13 * mesh.triangles.len();
    assert_eq!(ply.len(), head + body);
    for mesh in [&mesh, &Mesh::default()] {
        let mut glb = Vec::new();
        mesh.write_glb(&mut glb, None).unwrap();
        let number = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&glb[..4], number(8)), (&b"glTF"[..], glb.len()));
        let json = std::str::from_utf8(&glb[20..20 + number(12)]).unwrap();
        assert_eq!(json.contains("\"min\":["), !mesh.triangles.is_empty());
        assert_eq!(20 + number(12) + 8 + number(20 + number(12)), glb.len());
    }
}
