//! Bundle adjustment on a synthetic scene: recovers perturbed poses and points, and detects wrong observations.

use stillpoint_estimation::{
    BundleObservation, BundleOptions, BundleProblem, BundleStop, Intrinsics, Measurement,
    adjust_bundle,
};
use stillpoint_geometry::{Camera, Se3, Vec2, Vec3, Vec6};

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
fn perturbed_poses_and_points_are_recovered() {
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
fn outliers_are_reported_and_tolerated() {
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

/// Cameras along a corridor, each seeing the next two metres; the last camera is fixed.
fn corridor(cameras: usize) -> Scene {
    let camera = Camera::pinhole(640, 480, [520.0, 520.0, 320.0, 240.0]);
    let shift = |z: f64| Se3::new(Default::default(), Vec3::new(0.0, 0.0, -z));
    let poses: Vec<Se3> = (0..cameras).map(|i| shift(0.1 * i as f64)).collect();
    let point = |i: u64| {
        let z = 0.5 * (noise(3 * i + 2) + 1.0) * (0.1 * cameras as f64 + 2.0);
        Vec3::new(0.5 * noise(3 * i), 0.4 * noise(3 * i + 1), z)
    };
    let (mut points, mut observations) = (Vec::new(), Vec::new());
    for i in 0..20 * cameras as u64 {
        let p = point(i);
        let seen: Vec<_> = (0..cameras)
            .map(|k| (k, poses[k].transform(&p)))
            .filter(|(_, q)| q.z > 0.8 && q.z < 2.0)
            .collect();
        if seen.len() < 2 {
            continue;
        }
        for (k, q) in seen {
            let n = 7 * observations.len() as u64;
            let pixel = camera.project(&q) + Vec2::new(noise(n), noise(n + 1));
            observations.push(BundleObservation {
                pose: k as u32,
                point: points.len() as u32,
                measurement: Measurement::new(
                    pixel,
                    1.0,
                    Some((q.z + 0.005 * noise(n + 2), 0.005)),
                ),
            });
        }
        points.push(p);
    }
    let shaken = poses.iter().enumerate().map(|(i, p)| {
        if i + 1 == cameras {
            return *p;
        }
        let by = |k: usize, _| 0.01 * noise(90_000 + (6 * i + k) as u64);
        Se3::exp(&Vec6::from_fn(by)) * *p
    });
    let moved = points
        .iter()
        .enumerate()
        .map(|(j, p)| p + Vec3::from_fn(|k, _| 0.02 * noise(50_000 + (3 * j + k) as u64)));
    let problem = BundleProblem {
        camera: Intrinsics::from(&camera),
        poses: shaken.collect(),
        free_poses: cameras - 1,
        points: moved.collect(),
        observations,
    };
    Scene {
        poses,
        points,
        problem,
    }
}

/// 160 free poses are solved in sparse blocks.
#[test]
fn large_sparse_problem_is_recovered() {
    let Scene {
        poses,
        points,
        mut problem,
    } = corridor(161);
    let before = pose_error(&poses, &problem.poses);
    let report = adjust_bundle(&mut problem, &BundleOptions::default());
    let after = pose_error(&poses, &problem.poses);
    assert!(after < 0.06 && after < 0.3 * before, "{before} -> {after}");
    assert_eq!(problem.points.len(), points.len());
    assert_eq!(report.stop, BundleStop::Converged);
    // Cameras without common points have no block.
    assert!(report.blocks < 160 * 161 / 4, "{}", report.blocks);
}

/// The same problem with 100 free poses, which is dense, and with a 101st without observations, which makes it sparse:
/// the two solvers must agree.
#[test]
fn dense_and_sparse_solvers_agree() {
    let mut dense = corridor(101).problem;
    let mut sparse = dense.clone();
    sparse.poses.insert(100, Se3::identity());
    sparse.free_poses = 101;
    for o in &mut sparse.observations {
        o.pose += u32::from(o.pose == 100);
    }
    let options = BundleOptions {
        min_relative_gain: 0.0,
        ..BundleOptions::default()
    };
    let (a, b) = (
        adjust_bundle(&mut dense, &options),
        adjust_bundle(&mut sparse, &options),
    );
    assert!(b.blocks < a.blocks);
    assert!((a.final_cost - b.final_cost).abs() < 1e-6 * a.final_cost);
    assert!(pose_error(&dense.poses[..100], &sparse.poses[..100]) < 1e-6);
    assert_eq!(a.outliers, b.outliers);
    assert_eq!(sparse.poses[100], Se3::identity());
}

/// 230 cameras in one place, each point seen by three of them at random: the factor would be nearly full, so conjugate
/// gradients are used.
#[test]
fn densely_connected_problem_is_recovered() {
    let mut scene = scene();
    let count = 230;
    let pose = |i: usize| {
        Se3::exp(&Vec6::from_fn(|k, _| {
            0.1 * noise(70_000 + (6 * i + k) as u64)
        }))
    };
    let point = |i: u64| Vec3::new(noise(3 * i), 0.8 * noise(3 * i + 1), 2.5 + noise(3 * i + 2));
    scene.poses = (0..count).map(pose).collect();
    scene.points = (0..9000).map(point).collect();
    let camera = Camera::pinhole(640, 480, [520.0, 520.0, 320.0, 240.0]);
    let problem = &mut scene.problem;
    problem.observations.clear();
    for (j, p) in scene.points.iter().enumerate() {
        for k in 0..3 {
            let i = (0.5 * (noise((300_000 + 3 * j + k) as u64) + 1.0) * count as f64) as usize;
            let seen = scene.poses[i].transform(p);
            problem.observations.push(BundleObservation {
                pose: i as u32,
                point: j as u32,
                measurement: Measurement::new(camera.project(&seen), 1.0, Some((seen.z, 0.01))),
            });
        }
    }
    let shake = |j: usize, size: f64| move |k: usize| size * noise((900_000 + 6 * j + k) as u64);
    problem.free_poses = count - 1;
    problem.poses = scene.poses.clone();
    for (i, p) in problem.poses[..count - 1].iter_mut().enumerate() {
        let by = shake(i, 0.01);
        *p = Se3::exp(&Vec6::from_fn(|k, _| by(k))) * *p;
    }
    problem.points = scene.points.clone();
    for (j, p) in problem.points.iter_mut().enumerate() {
        let by = shake(10_000 + j, 0.02);
        *p += Vec3::from_fn(|k, _| by(k));
    }
    let report = adjust_bundle(problem, &BundleOptions::default());
    let error = pose_error(&scene.poses, &problem.poses);
    assert!(error < 1e-4, "{error} {report:?}");
    // Without fill: a factor would have nearly all pairs.
    assert!(report.blocks < (count - 1) * count / 2 * 9 / 10);
    assert!(!report.outliers.contains(&true));
}

/// Work is counted and never exceeds its limit.
#[test]
fn work_limit_is_respected() {
    for start in [scene().problem, corridor(130).problem] {
        let full = adjust_bundle(&mut start.clone(), &BundleOptions::default());
        for share in 0..5 {
            let options = BundleOptions {
                max_work: full.work * share / 5,
                ..BundleOptions::default()
            };
            let mut problem = start.clone();
            let report = adjust_bundle(&mut problem, &options);
            assert_eq!(report.stop, BundleStop::WorkLimit);
            assert!(report.work <= options.max_work);
            assert!(report.iterations < full.iterations);
            let error = pose_error(&problem.poses, &start.poses);
            assert_eq!(report.iterations == 0, error < 1e-9);
        }
        let exact = BundleOptions {
            max_work: full.work,
            ..BundleOptions::default()
        };
        let report = adjust_bundle(&mut start.clone(), &exact);
        assert_eq!((report.stop, report.work), (full.stop, full.work));
    }
}

#[test]
fn empty_problems_are_accepted() {
    let mut problem = scene().problem;
    problem.free_poses = 0;
    let poses = problem.poses.clone();
    let report = adjust_bundle(&mut problem, &BundleOptions::default());
    assert_eq!(problem.poses, poses);
    assert!(report.final_cost <= report.initial_cost);
    problem.observations.clear();
    let report = adjust_bundle(&mut problem, &BundleOptions::default());
    assert_eq!((report.final_cost, report.outliers.len()), (0.0, 0));
    problem.points.clear();
    problem.poses.clear();
    let _ = adjust_bundle(&mut problem, &BundleOptions::default());
}

#[test]
fn same_problem_gives_identical_results() {
    let run = || {
        let mut problem = scene().problem;
        let _ = adjust_bundle(&mut problem, &BundleOptions::default());
        format!("{:?} {:?}", problem.poses, problem.points)
    };
    assert_eq!(run(), run());
}
