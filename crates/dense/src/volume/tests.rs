//! Volumes of known surfaces, and properties of their meshes.

mod files;

use super::*;
use crate::arrivals::Arrivals;
use crate::mesh::{Mesh, MeshOptions};
use crate::observation::units;
use proptest::prelude::*;
use std::collections::BTreeMap;
use stillpoint_geometry::{Vec6, so3};

const W: usize = 80;
const H: usize = 60;

pub(crate) fn camera() -> Camera {
    Camera::pinhole(W as u32, H as u32, [70.0, 70.0, 39.5, 29.5])
}

/// A camera observation with ray lengths by `depth`: a function of origin and direction (with z = 1 in the camera) in the world.
pub(crate) fn look(pose: &Se3, depth: impl Fn(&Vec3, &Vec3) -> Option<f64>) -> Observation {
    let c = camera();
    let of = |i: usize| {
        let ray = Vec3::new(
            ((i % W) as f64 - c.cx) / c.fx,
            ((i / W) as f64 - c.cy) / c.fy,
            1.0,
        );
        let z = depth(&pose.translation, &(pose.rotation * ray));
        z.map_or(0, |z| units(z as f32))
    };
    Observation {
        width: W,
        height: H,
        depth: (0..W * H).map(of).collect(),
        movers: vec![0; W.div_ceil(8) * H.div_ceil(8)],
        colour: vec![0x40_80_c0; (W / 4) * (H / 4)],
        depth_stamp: 0.0,
        doubt: 1,
    }
}

pub(crate) fn sphere(centre: Vec3, radius: f64) -> impl Fn(&Vec3, &Vec3) -> Option<f64> {
    move |o, d| {
        let (a, b) = (d.norm_squared(), (o - centre).dot(d));
        let root = b * b - a * ((o - centre).norm_squared() - radius * radius);
        (root > 0.0)
            .then(|| (-b - root.sqrt()) / a)
            .filter(|z| *z > 0.0)
    }
}

pub(crate) fn plane(normal: Vec3, offset: f64) -> impl Fn(&Vec3, &Vec3) -> Option<f64> {
    move |o, d| Some((offset - normal.dot(o)) / normal.dot(d)).filter(|z| *z > 0.0 && *z < 12.0)
}

pub(crate) fn looking(from: Vec3, to: Vec3) -> Se3 {
    let z = (to - from).normalize();
    let side = if z.y.abs() < 0.9 {
        Vec3::y()
    } else {
        Vec3::x()
    };
    let x = side.cross(&z).normalize();
    let turn = stillpoint_geometry::Mat3::from_columns(&[x, z.cross(&x), z]);
    Se3::from_matrix(&turn, from)
}

pub(crate) fn config(voxel: f64) -> DenseConfig {
    DenseConfig {
        voxel,
        ..DenseConfig::default()
    }
}

pub(crate) const ALL: MeshOptions = MeshOptions {
    min_seen: 1,
    min_area: 0.0,
};

/// Triangle edges by number of uses, in both directions.
fn sides(mesh: &Mesh) -> BTreeMap<(u32, u32), usize> {
    let mut sides = BTreeMap::new();
    for [a, b, c] in &mesh.triangles {
        for side in [(*a, *b), (*b, *c), (*c, *a)] {
            *sides.entry(side).or_insert(0) += 1;
        }
    }
    sides
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]

    /// A ball seen from all around is closed, smooth and in place.
    #[test]
    fn fused_ball_is_closed_and_round(
        at in prop::array::uniform3(-3.0_f64..3.0),
        radius in 0.25_f64..0.4,
        voxel in 0.02_f64..0.04,
    ) {
        let centre = Vec3::from(at);
        let mut volume = Volume::new(&config(voxel), Simd::detect());
        for i in 0..26 {
            let d = [i % 3, i / 3 % 3, i / 9].map(|k| k as f64 - 1.0);
            let d = Vec3::from(d);
            if d.norm() < 0.5 { continue; }
            let pose = looking(centre + d.normalize() * 1.4, centre);
            volume.integrate(&look(&pose, sphere(centre, radius)), &camera(), &pose, &Arrivals::default());
        }
        let mesh = volume.mesh(&ALL);
        prop_assert!(mesh.triangles.len() > 200);
        for ((a, b), count) in sides(&mesh) {
            prop_assert_eq!(count, 1);
            prop_assert!(sides_has(&mesh, b, a), "{} {} is open", a, b);
        }
        let mut sum = 0.0;
        for (p, n) in mesh.positions.iter().zip(&mesh.normals) {
            let out = Vec3::from(p.map(f64::from)) - centre;
            let error = (out.norm() - radius).abs();
            prop_assert!(error < 0.6 * voxel, "{error}");
            sum += error;
            prop_assert!(Vec3::from(n.map(f64::from)).dot(&out.normalize()) > 0.8);
        }
        prop_assert!(sum / (mesh.positions.len() as f64) < 0.15 * voxel);
        let exact = 4.0 * std::f64::consts::PI * radius * radius;
        prop_assert!((mesh.area() / exact - 1.0).abs() < 0.05);
        prop_assert!(mesh.colours.iter().all(|c| *c == [0xc0, 0x80, 0x40]));
    }

    /// A wall is flat, and open only at its border.
    #[test]
    fn fused_wall_is_flat_and_open_only_at_its_border(
        turn in prop::array::uniform3(-0.5_f64..0.5),
        distance in 0.8_f64..1.5,
        voxel in 0.02_f64..0.04,
    ) {
        let pose = Se3::exp(&Vec6::new(0.3, -0.2, 0.1, turn[0], turn[1], turn[2]));
        let normal = so3::exp(&Vec3::from(turn)) * Vec3::new(0.2, 0.1, 1.0).normalize();
        let offset = normal.dot(&pose.translation) + distance;
        let mut volume = Volume::new(&config(voxel), Simd::detect());
        volume.integrate(&look(&pose, plane(normal, offset)), &camera(), &pose, &Arrivals::default());
        let mesh = volume.mesh(&ALL);
        prop_assert!(mesh.triangles.len() > 200);
        let used = sides(&mesh);
        let mut open = Vec::new();
        for (side, count) in &used {
            prop_assert_eq!(*count, 1);
            if !used.contains_key(&(side.1, side.0)) { open.push(side.0); }
        }
        prop_assert!(!open.is_empty());
        let from_camera = pose.inverse();
        for i in open {
            let p = from_camera.transform(&mesh.position(i));
            let px = camera().project(&p);
            let reach = 3.0 * voxel * 70.0 / p.z + 2.0;
            let border = px.x.min(px.y).min(79.0 - px.x).min(59.0 - px.y);
            prop_assert!(border < reach, "open in the midst of the wall: {:?}", px);
        }
        for i in 0..mesh.positions.len() as u32 {
            let p = mesh.position(i);
            let error = (normal.dot(&p) - offset).abs();
            // Within the measured space, as given by the volume; and where the surface was extrapolated.
            let bound = match volume.distance(&p) {
                Some(d) => {
                    prop_assert!(d.abs() < 0.2 * voxel);
                    0.2
                }
                None => 0.4,
            };
            prop_assert!(error < bound * voxel, "{error}");
        }
    }

    /// Vector and portable code give the same bits for any observation.
    #[test]
    fn vector_and_scalar_integration_agree(
        seed in any::<u64>(),
        turn in prop::array::uniform3(-3.0_f64..3.0),
    ) {
        let mut x = seed | 1;
        let mut random = move || {
            x ^= x << 13;
            x ^= x >> 7;
            x ^= x << 17;
            (x >> 40) as u32
        };
        let mut both = [Simd::Scalar, Simd::detect()].map(|s| Volume::new(&config(0.04), s));
        for k in 0..4 {
            let pose = Se3::exp(&Vec6::new(0.1 * f64::from(k), 0.2, 0.0, turn[0], turn[1], turn[2]));
            let mut seen = look(&pose, |_, d| Some(1.0 + 0.1 * d.x));
            for z in &mut seen.depth {
                match random() % 8 {
                    0 => *z = 0,
                    1 => *z = (random() & 0xffff) as u16,
                    _ => *z = z.wrapping_add((random() % 400) as u16 + 2000 * (k as u16 % 3)),
                }
            }
            seen.colour.iter_mut().for_each(|c| *c = random() & 0xff_ffff);
            seen.doubt = 1 + (k as u8 % 3);
            for v in &mut both { v.integrate(&seen, &camera(), &pose, &Arrivals::default()); }
        }
        prop_assert!(both[0].blocks.len() > 10);
        prop_assert_eq!(both[0].digest(), both[1].digest());
    }
}

fn sides_has(mesh: &Mesh, a: u32, b: u32) -> bool {
    mesh.triangles
        .iter()
        .filter(|t| t.contains(&a) && t.contains(&b))
        .any(|t| (0..3).any(|i| t[i] == a && t[(i + 1) % 3] == b))
}

fn still() -> Se3 {
    Se3::identity()
}

fn with_box(z: f64) -> impl Fn(&Vec3, &Vec3) -> Option<f64> {
    move |_, d| {
        Some(if d.x.abs() < 0.2 / z && d.y.abs() < 0.2 / z {
            z
        } else {
            2.0
        })
    }
}

#[test]
fn removed_object_disappears_when_seen_through() {
    let mut volume = Volume::new(&config(0.02), Simd::detect());
    let there = |v: &Volume| {
        let mesh = v.mesh(&MeshOptions::default());
        mesh.positions.iter().filter(|p| p[2] < 1.5).count()
    };
    // Five seconds at 15 Hz.
    for _ in 0..75 {
        volume.integrate(
            &look(&still(), with_box(1.0)),
            &camera(),
            &still(),
            &Arrivals::default(),
        );
    }
    assert!(there(&volume) > 200);
    let mut frames = 0;
    while there(&volume) > 0 {
        volume.integrate(
            &look(&still(), |_, _| Some(2.0)),
            &camera(),
            &still(),
            &Arrivals::default(),
        );
        frames += 1;
        assert!(
            frames <= 30,
            "{} corners are left after two seconds",
            there(&volume)
        );
    }
    assert!(frames > 3, "one frame that errs must not remove a thing");
    // The wall behind it is whole.
    let behind = volume.distance(&Vec3::new(0.05, 0.05, 2.0)).unwrap();
    assert!(behind.abs() < 0.005, "{behind}");
}

#[test]
fn occluded_or_unmeasured_surfaces_stay() {
    let mut volume = Volume::new(&config(0.02), Simd::detect());
    for _ in 0..10 {
        volume.integrate(
            &look(&still(), with_box(1.5)),
            &camera(),
            &still(),
            &Arrivals::default(),
        );
    }
    let before = volume.mesh(&ALL);
    for _ in 0..30 {
        volume.integrate(
            &look(&still(), |_, _| Some(0.7)),
            &camera(),
            &still(),
            &Arrivals::default(),
        );
        volume.integrate(
            &look(&still(), |_, _| None),
            &camera(),
            &still(),
            &Arrivals::default(),
        );
    }
    let far = |m: &Mesh| m.positions.iter().filter(|p| p[2] > 1.0).count();
    assert_eq!(far(&volume.mesh(&ALL)), far(&before));
}

#[test]
fn empty_blocks_are_freed() {
    let mut volume = Volume::new(&config(0.02), Simd::detect());
    for _ in 0..4 {
        volume.integrate(
            &look(&still(), |_, _| Some(1.0)),
            &camera(),
            &still(),
            &Arrivals::default(),
        );
    }
    let (near, bytes) = (volume.blocks.len(), volume.bytes());
    for _ in 0..40 {
        volume.integrate(
            &look(&still(), |_, _| Some(2.0)),
            &camera(),
            &still(),
            &Arrivals::default(),
        );
    }
    let of_first = |v: &Volume| v.blocks.within([[-99, -99, 0], [99, 99, 8]]).count();
    // At the image border a part of each block was never seen through.
    assert!(near > 20 && of_first(&volume) < near, "{near}");
    for (x, y, z) in [(0, 0, 5), (0, -1, 6), (-1, 0, 6), (-1, -1, 5)] {
        assert!(
            volume.blocks.find(Key::new(x, y, z)).is_none(),
            "{x} {y} {z}"
        );
    }
    assert!(volume.bytes() < 6 * bytes);
}

#[test]
fn small_mesh_pieces_are_dropped() {
    let dot = |_: &Vec3, d: &Vec3| {
        Some(if d.x.abs() < 0.03 && d.y.abs() < 0.03 {
            1.0
        } else {
            2.0
        })
    };
    let mut volume = Volume::new(&config(0.02), Simd::detect());
    for _ in 0..3 {
        volume.integrate(
            &look(&still(), dot),
            &camera(),
            &still(),
            &Arrivals::default(),
        );
    }
    let count = |min_area: f64| {
        let mesh = volume.mesh(&MeshOptions { min_area, ..ALL });
        let near = mesh.positions.iter().filter(|p| p[2] < 1.5).count();
        (
            near > 0,
            mesh.positions.len() > 500,
            mesh.normals.len() == mesh.positions.len(),
        )
    };
    assert_eq!(count(0.0), (true, true, true));
    assert_eq!(count(0.05), (false, true, true));
}

#[test]
fn non_finite_or_huge_poses_change_nothing() {
    let mut volume = Volume::new(&config(0.02), Simd::detect());
    for x in [f64::NAN, f64::INFINITY, 1e12] {
        let pose = Se3 {
            translation: Vec3::new(x, 0.0, 0.0),
            ..still()
        };
        volume.integrate(
            &look(&still(), |_, _| Some(1.0)),
            &camera(),
            &pose,
            &Arrivals::default(),
        );
    }
    assert_eq!(volume.blocks.len(), 0);
    assert_eq!(volume.mesh(&ALL), Mesh::default());
    assert_eq!(volume.distance(&Vec3::new(f64::NAN, 0.0, 0.0)), None);
}
