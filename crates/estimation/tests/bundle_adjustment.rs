//! Bundle adjustment on a synthetic scene: perturbed poses and points come back, wrong observations are named.

#![allow(clippy::unwrap_used)] // A failed helper is a failed test.

use stillpoint_estimation::{
    BundleObservation, BundleOptions, BundleProblem, Intrinsics, Measurement, adjust_bundle,
};
use stillpoint_geometry::{Camera, Se3, Vec3, Vec6};

const POSES: usize = 6;
const POINTS: usize = 120;

/// Reproducible noise in [-1, 1].
fn noise(n: u64) -> f64 {
    let mut x = n.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x ^= x >> 29;
    x = x.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x ^= x >> 32;
    (x >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

struct Scene {
    poses: Vec<Se3>,
    points: Vec<Vec3>,
    problem: BundleProblem,
}

/// Poses and points with exact observations of pixel and depth; the problem starts from perturbed ones. The last two
/// poses are fixed.
fn scene() -> Scene {
    let camera = Camera::pinhole(640, 480, [520.0, 520.0, 320.0, 240.0]);
    let pose = |i: usize| {
        let s = i as f64;
        Se3::exp(&Vec6::new(
            0.08 * s,
            -0.03 * s,
            0.02 * s,
            0.01 * s,
            -0.03 * s,
            0.02 * s,
        ))
    };
    let poses: Vec<Se3> = (0..POSES).map(pose).collect();
    let point = |i: u64| Vec3::new(noise(3 * i), 0.8 * noise(3 * i + 1), 2.5 + noise(3 * i + 2));
    let points: Vec<Vec3> = (0..POINTS as u64).map(point).collect();
    let mut observations = Vec::new();
    for (j, p) in points.iter().enumerate() {
        for (i, pose) in poses.iter().enumerate() {
            let seen = pose.transform(p);
            let depth = (j % 2 == 0).then_some((seen.z, 0.01));
            observations.push(BundleObservation {
                pose: i as u32,
                point: j as u32,
                measurement: Measurement::new(camera.project(&seen), 1.0, depth),
            });
        }
    }
    let free_poses = POSES - 2;
    let shaken = poses.iter().enumerate().map(|(i, p)| {
        if i >= free_poses {
            return *p;
        }
        Se3::exp(&Vec6::from_fn(|k, _| {
            0.01 * noise(1000 + (6 * i + k) as u64)
        })) * *p
    });
    let moved = points
        .iter()
        .enumerate()
        .map(|(j, p)| p + Vec3::from_fn(|k, _| 0.03 * noise(5000 + (3 * j + k) as u64)));
    let problem = BundleProblem {
        camera: Intrinsics::from(&camera),
        poses: shaken.collect(),
        free_poses,
        points: moved.collect(),
        observations,
    };
    Scene {
        poses,
        points,
        problem,
    }
}

fn pose_error(a: &[Se3], b: &[Se3]) -> f64 {
    let errors = a
        .iter()
        .zip(b)
        .map(|(a, b)| (a.inverse() * *b).log().norm());
    errors.fold(0.0, f64::max)
}

#[test]
fn perturbed_poses_and_points_come_back() {
    let Scene {
        poses,
        points,
        mut problem,
    } = scene();
    assert!(pose_error(&poses, &problem.poses) > 0.005);
    let fixed = problem.poses[POSES - 1];
    let report = adjust_bundle(&mut problem, &BundleOptions::default());
    assert!(report.final_cost < 1e-3 * report.initial_cost);
    assert!(
        pose_error(&poses, &problem.poses) < 1e-5,
        "{}",
        pose_error(&poses, &problem.poses)
    );
    let worst = problem
        .points
        .iter()
        .zip(&points)
        .map(|(a, b)| (a - b).norm());
    assert!(worst.fold(0.0, f64::max) < 1e-4);
    assert_eq!(problem.poses[POSES - 1], fixed);
    assert!(!report.outliers.contains(&true));
}

#[test]
fn wrong_observations_are_named_and_do_no_harm() {
    let Scene {
        poses, mut problem, ..
    } = scene();
    let wrong: Vec<usize> = (0..problem.observations.len()).step_by(37).collect();
    for i in &wrong {
        problem.observations[*i].measurement.pixel.x += 60.0;
    }
    let report = adjust_bundle(&mut problem, &BundleOptions::default());
    for i in &wrong {
        assert!(report.outliers[*i], "observation {i}");
    }
    let named = report.outliers.iter().filter(|o| **o).count();
    assert!(
        named <= wrong.len() + problem.observations.len() / 50,
        "{named} outliers"
    );
    assert!(pose_error(&poses, &problem.poses) < 2e-3);
}

#[test]
fn the_same_problem_gives_the_same_bits() {
    let run = || {
        let mut problem = scene().problem;
        let _ = adjust_bundle(&mut problem, &BundleOptions::default());
        format!("{:?} {:?}", problem.poses, problem.points)
    };
    assert_eq!(run(), run());
}
