//! Tests of the scene without people.

use crate::room::{config, simulator};
use stillpoint_dense::{DenseConfig, Fuser, MeshOptions};
use stillpoint_geometry::{Camera, Se3, Vec3};
use stillpoint_imaging::{DepthImage, FrameId, GrayImage, RgbdFrame, Simd};
use stillpoint_simulator::Surfaces;

#[test]
fn movers_are_excluded_and_their_cells_counted() {
    let room = simulator("walking_static", 30);
    let truth = Surfaces::new(room.static_surfaces());
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
        let errors: Vec<f64> = (0..count as u32)
            .map(|i| truth.distance(&mesh.position(i)))
            .collect();
        // At 4 m, one frame in a hundred is 10 cm off on a wall, with these few frames and wide voxels.
        let far = errors.iter().filter(|e| **e > 0.15).count() as f64 / count as f64;
        // Only measured parts, without those extrapolated at borders.
        let measured = |i: &usize| fuser.map().distance(&mesh.position(*i as u32)).is_some();
        let near: Vec<f64> = (0..count)
            .filter(measured)
            .map(|i| errors[i])
            .filter(|e| *e < 0.1)
            .collect();
        let mean = near.iter().sum::<f64>() / near.len() as f64;
        let plan = stillpoint_dense::Floor::find(&mesh, &Vec3::z())
            .and_then(|floor| fuser.map().plan(&floor, &Default::default()));
        let crossed = plan.map_or(0, |p| p.crossed.iter().filter(|c| **c > 0).count());
        (far, mean, crossed)
    };
    let (far, mean, crossed) = fused(true);
    let (control, _, none) = fused(false);
    assert!(
        far < 0.001 && control > 20.0 * far.max(0.0005),
        "{far} {control}"
    );
    assert!(mean < 0.012, "{mean}");
    assert!(crossed > 5 && none == 0, "{crossed} {none}");
}

/// A box before a wall, which appears after a second: it becomes part of the map after 10 s, independent of the number of frames.
#[test]
fn object_entering_free_space_must_stand_for_a_while() {
    let (w, h) = (64, 48);
    let camera = Camera::pinhole(w as u32, h as u32, [60.0, 60.0, 31.5, 23.5]);
    let depth = |boxed: bool, i: usize| {
        let inside = boxed && (20..44).contains(&(i % w)) && (14..34).contains(&(i / w));
        if inside { 1.2 } else { 2.0 }
    };
    let frame = |boxed: bool, stamp: f64| RgbdFrame {
        id: FrameId(0),
        stamp,
        depth_stamp: stamp,
        gray: GrayImage::new(w, h),
        colour: None,
        depth: DepthImage::from_vec(w, h, (0..w * h).map(|i| depth(boxed, i)).collect()).unwrap(),
    };
    let surface = |fuser: &Fuser| {
        let mesh = fuser.map().mesh(&MeshOptions::default());
        let near = mesh.positions.iter().filter(|p| p[2] < 1.4).count();
        (near, mesh.positions.len() - near)
    };
    let config = DenseConfig {
        voxel: 0.04,
        ..DenseConfig::default()
    };
    let add = |fuser: &mut Fuser, boxed: bool, [from, to]: [f64; 2], rate: f64| {
        let count = ((to - from) * rate) as usize;
        for k in 0..count {
            let frame = frame(boxed, from + k as f64 / rate);
            fuser.add(&frame, &[], &Se3::identity());
        }
    };
    for rate in [5.0, 30.0] {
        let mut fuser = Fuser::new(&config, &camera, Simd::detect()).unwrap();
        add(&mut fuser, false, [0.0, 2.0], rate);
        add(&mut fuser, true, [2.0, 10.0], rate);
        let (before, wall) = surface(&fuser);
        assert!(before == 0 && wall > 500, "{before} {wall}");
        add(&mut fuser, true, [10.0, 15.0], rate);
        let (after, _) = surface(&fuser);
        assert!(after > 100, "{after} at {rate} Hz");
        // Time without observation does not count.
        let mut gone = Fuser::new(&config, &camera, Simd::detect()).unwrap();
        add(&mut gone, false, [0.0, 2.0], rate);
        add(&mut gone, true, [2.0, 3.0], rate);
        add(&mut gone, true, [60.0, 61.0], rate);
        assert_eq!(surface(&gone).0, 0);
    }
    // A box present from the beginning is taken in at once.
    let mut other = Fuser::new(&config, &camera, Simd::detect()).unwrap();
    add(&mut other, true, [0.0, 1.0], 5.0);
    assert!(surface(&other).0 > 100);
}
