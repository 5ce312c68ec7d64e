//! The room without the people.

use crate::room::{config, simulator};
use stillpoint_dense::{Fuser, MeshOptions};
use stillpoint_geometry::Vec3;
use stillpoint_imaging::Simd;

/// Distance to a convex polygon, m.
fn distance(face: &[Vec3], p: &Vec3) -> f64 {
    let normal = (face[1] - face[0]).cross(&(face[2] - face[0])).normalize();
    let (mut inside, mut nearest) = (true, f64::INFINITY);
    for (i, a) in face.iter().enumerate() {
        let side = face[(i + 1) % face.len()] - a;
        inside &= normal.cross(&side).dot(&(p - a)) >= 0.0;
        let share = ((p - a).dot(&side) / side.norm_squared()).clamp(0.0, 1.0);
        nearest = nearest.min((a + side * share - p).norm());
    }
    if inside {
        normal.dot(&(p - face[0])).abs()
    } else {
        nearest
    }
}

#[test]
fn what_moves_is_not_in_the_surface_and_is_counted_where_it_was() {
    let room = simulator("walking_static", 30);
    let faces = room.static_surfaces();
    let fused = |masked: bool| {
        let mut fuser = Fuser::new(&config(), room.camera(), Simd::detect()).unwrap();
        for i in (0..30).step_by(3) {
            let mask = room.truth(i).mask;
            let moving: Vec<bool> = mask.data().iter().map(|m| masked && *m > 0).collect();
            let pose = room.world_from_camera(room.depth_stamp(i));
            fuser.add(&room.frame_with_colour(i), &moving, &pose);
        }
        let mesh = fuser.map().mesh(&MeshOptions::default());
        let count = mesh.positions.len();
        let nearest = |p: Vec3| {
            let all = faces.iter().map(|f| distance(f, &p));
            all.fold(f64::INFINITY, f64::min)
        };
        let errors: Vec<f64> = (0..count as u32)
            .map(|i| nearest(mesh.position(i)))
            .collect();
        let far = errors.iter().filter(|e| **e > 0.1).count() as f64 / count as f64;
        let mean = errors.iter().filter(|e| **e < 0.1).sum::<f64>() / count as f64;
        let plan = stillpoint_dense::Floor::find(&mesh, &Vec3::z())
            .and_then(|floor| fuser.map().plan(&floor, &Default::default()));
        let crossed = plan.map_or(0, |p| p.crossed.iter().filter(|c| **c > 0).count());
        (far, mean, crossed)
    };
    let (far, mean, crossed) = fused(true);
    let (control, _, none) = fused(false);
    assert!(
        far < 0.01 && control > 20.0 * far.max(0.0005),
        "{far} {control}"
    );
    assert!(mean < 0.012, "{mean}");
    assert!(crossed > 5 && none == 0, "{crossed} {none}");
}
