//! Exactness: frames agree under warping by depth and pose.

use stillpoint_geometry::{BrownConrady, Camera, Se3, Vec2};
use stillpoint_imaging::{DepthImage, GrayImage};
use stillpoint_simulator::{Simulator, SimulatorConfig};

fn ideal(scene: &str) -> Simulator {
    with_camera(scene, SimulatorConfig::default().camera)
}

/// A camera with a lens that distorts as strongly as freiburg1's.
fn distorted() -> Camera {
    let mut camera = Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3]);
    camera.distortion = BrownConrady {
        k1: 0.2624,
        k2: -0.9531,
        p1: -0.0054,
        p2: 0.0026,
        k3: 1.1633,
    };
    camera
}

fn with_camera(scene: &str, camera: Camera) -> Simulator {
    Simulator::new(&SimulatorConfig {
        scene: scene.to_owned(),
        noise: false,
        depth_delay: 0.0,
        camera,
        ..SimulatorConfig::default()
    })
    .expect("a scene that exists")
}

/// Visits the pixels of frame `i` that frame `j` must see too, with their pixel and depth there.
fn warp(
    camera: &Camera,
    depth: &DepthImage,
    j_from_i: &Se3,
    mut visit: impl FnMut([usize; 2], Vec2, f64),
) {
    for v in (4..476).step_by(3) {
        for u in (4..636).step_by(3) {
            let z = f64::from(depth.at(u, v));
            // Only inside faces, where second differences of 1 / z vanish.
            let w = |x: usize, y: usize| 1.0 / f64::from(depth.at(x, y));
            let bend = (w(u - 3, v) + w(u + 3, v) - 2.0 / z).abs()
                + (w(u, v - 3) + w(u, v + 3) - 2.0 / z).abs();
            if z == 0.0 || bend > 1e-4 {
                continue;
            }
            let from = camera.undistort(Vec2::new(u as f64, v as f64));
            let p = j_from_i.transform(&camera.backproject(from, z));
            let px = camera.project_distorted(&p);
            if p.z > 0.1 && px.x > 4.0 && px.y > 4.0 && px.x < 635.0 && px.y < 475.0 {
                visit([u, v], px, p.z);
            }
        }
    }
}

fn bilinear(at: impl Fn(usize, usize) -> f64, p: Vec2) -> f64 {
    let (x, y) = (p.x.floor(), p.y.floor());
    let (fx, fy) = (p.x - x, p.y - y);
    let (x, y) = (x as usize, y as usize);
    (at(x, y) * (1.0 - fx) + at(x + 1, y) * fx) * (1.0 - fy)
        + (at(x, y + 1) * (1.0 - fx) + at(x + 1, y + 1) * fx) * fy
}

#[test]
fn warped_depth_agrees_between_frames() {
    let sims = [
        ideal("xyz"),
        ideal("loop_two_rooms"),
        with_camera("xyz", distorted()),
    ];
    for (scene, sim) in sims.iter().enumerate() {
        let (a, b) = (10, 25);
        let (depth_a, depth_b) = (sim.depth(a), sim.depth(b));
        let b_from_a =
            sim.world_from_camera(sim.stamp(b)).inverse() * sim.world_from_camera(sim.stamp(a));
        let (mut seen, mut equal, mut nearer) = (0, 0, 0);
        warp(sim.camera(), &depth_a, &b_from_a, |_, px, z| {
            let inverse = bilinear(|x, y| 1.0 / f64::from(depth_b.at(x, y)), px);
            seen += 1;
            let error = (1.0 / inverse - z) / z;
            equal += usize::from(error.abs() < 2e-4);
            nearer += usize::from(error < -2e-4);
        });
        assert!(seen > 15_000, "{scene}: {seen}");
        // Different pixels must be occluded (or on an edge), except for a few.
        assert!(equal * 100 > seen * 85, "{scene}: {equal} of {seen}");
        assert!(
            seen - equal - nearer < seen / 50,
            "{scene}: {equal} equal, {nearer} nearer of {seen}"
        );
    }
}

/// Mean shift (px) that best explains the grey differences between a frame and the warped other frame.
fn mean_shift(a: &GrayImage, b: &GrayImage, pairs: &[([usize; 2], Vec2)]) -> Vec2 {
    let (mut xx, mut xy, mut yy, mut x, mut y) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for ([u, v], px) in pairs {
        let at = |dx: f64, dy: f64| bilinear(|x, y| f64::from(b.at(x, y)), *px + Vec2::new(dx, dy));
        let (gx, gy) = (
            0.5 * (at(1.0, 0.0) - at(-1.0, 0.0)),
            0.5 * (at(0.0, 1.0) - at(0.0, -1.0)),
        );
        let r = f64::from(a.at(*u, *v)) - at(0.0, 0.0);
        // Differences that no small shift explains are other faces.
        if r.abs() < 25.0 {
            xx += gx * gx;
            xy += gx * gy;
            yy += gy * gy;
            x += gx * r;
            y += gy * r;
        }
    }
    let det = xx * yy - xy * xy;
    Vec2::new((yy * x - xy * y) / det, (xx * y - xy * x) / det)
}

#[test]
fn warped_colours_agree_to_a_tenth_of_a_pixel() {
    let mut sims = ["xyz", "rpy", "halfsphere", "loop_two_rooms"]
        .map(ideal)
        .into_iter()
        .collect::<Vec<_>>();
    sims.push(with_camera("rpy", distorted()));
    for (scene, sim) in sims.iter().enumerate() {
        let (a, b) = (40, 46);
        let (fa, fb) = (sim.frame(a), sim.frame(b));
        let b_from_a = sim.world_from_camera(fb.stamp).inverse() * sim.world_from_camera(fa.stamp);
        for quadrant in 0..4 {
            let mut pairs = Vec::new();
            warp(sim.camera(), &fa.depth, &b_from_a, |[u, v], px, z| {
                let same = (f64::from(fb.depth.at(px.x.round() as usize, px.y.round() as usize))
                    / z
                    - 1.0)
                    .abs()
                    < 0.01;
                if same && usize::from(u > 320) + 2 * usize::from(v > 240) == quadrant {
                    pairs.push(([u, v], px));
                }
            });
            assert!(pairs.len() > 1000, "{scene}: {}", pairs.len());
            let shift = mean_shift(&fa.gray, &fb.gray, &pairs);
            assert!(shift.norm() < 0.1, "{scene}, quadrant {quadrant}: {shift}");
        }
    }
}

#[test]
fn depth_is_rendered_at_its_own_stamp() {
    let config = SimulatorConfig {
        noise: false,
        depth_delay: 0.016,
        ..SimulatorConfig::default()
    };
    let sim = Simulator::new(&config).unwrap();
    let frame = sim.frame(30);
    assert!(frame.depth_stamp - frame.stamp > 0.004 && frame.depth_stamp - frame.stamp < 0.028);
    // No other simulator has a colour frame at exactly that depth stamp, so the depth is compared with a warp of the undelayed one by the
    // exact motion in between.
    let still = ideal("xyz");
    let motion =
        sim.world_from_camera(frame.depth_stamp).inverse() * sim.world_from_camera(frame.stamp);
    let (mut with, mut without, mut n) = (0.0, 0.0, 0.0);
    let there = still.depth(30);
    warp(sim.camera(), &there, &motion, |[u, v], px, z| {
        let found = 1.0 / bilinear(|x, y| 1.0 / f64::from(frame.depth.at(x, y)), px);
        if (found / z - 1.0).abs() < 0.01 {
            with += (found - z).abs();
            without += f64::from((frame.depth.at(u, v) - there.at(u, v)).abs().min(0.02));
            n += 1.0;
        }
    });
    assert!(n > 10_000.0 && with / n < 2e-4, "{} m", with / n);
    assert!(
        without > 5.0 * with,
        "the delay must be visible: {} against {} m",
        without / n,
        with / n
    );
}
