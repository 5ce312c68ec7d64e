use super::*;
use proptest::prelude::*;

/// Motion of a hand-held camera: oscillations of 0.4 to 1.1 Hz, and rotation of up to 60 deg/s.
fn hand(t: f64) -> Se3 {
    let place = [(0.10, 2.6, 0.0), (0.08, 4.1, 1.0), (0.05, 6.9, 2.0)];
    let [x, y, z] = place.map(|(size, speed, phase)| size * libm::sin(speed * t + phase));
    let turn = Vec3::new(0.2 * libm::sin(2.9 * t), 0.3 * libm::sin(3.5 * t), 0.1 * t);
    Se3::new(so3::exp(&turn), Vec3::new(x, y, z + 0.3 * t))
}

/// Three numbers of deviation 1: sums of twelve uniform deviates, from a hash of the frame.
fn normal(frame: usize, stream: u64) -> Vec3 {
    let mut state = frame as u64 * 977 + stream * 7919 + 1;
    let mut unit = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    Vec3::from_fn(|_, _| (0..12).map(|_| unit()).sum::<f64>() - 6.0)
}

/// Frame stamps with a jitter of a tenth of the interval.
fn stamps(count: usize, rate: f64) -> Vec<f64> {
    let off = |k: usize| 0.1 * (normal(k, 9).x).clamp(-3.0, 3.0);
    (0..count).map(|k| (k as f64 + off(k)) / rate).collect()
}

fn jittered(stamps: &[f64], metres: f64, radians: f64) -> Vec<Se3> {
    let pose = |(k, t): (usize, &f64)| {
        let exact = hand(*t);
        let turn = so3::exp(&(normal(k, 1) * radians));
        Se3::new(
            turn * exact.rotation,
            exact.translation + normal(k, 0) * metres,
        )
    };
    stamps.iter().enumerate().map(pose).collect()
}

/// Root mean square error of positions and of rotations.
fn error(stamps: &[f64], poses: &[Se3]) -> [f64; 2] {
    let off = |(t, pose): (&f64, &Se3)| {
        let exact = hand(*t);
        let place = (pose.translation - exact.translation).norm_squared();
        let turn = pose.rotation.angle_to(&exact.rotation);
        [place, turn * turn]
    };
    let sum = stamps.iter().zip(poses).map(off);
    let sum = sum.fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    sum.map(|s| (s / poses.len() as f64).sqrt())
}

fn both(rate: f64, metres: f64, radians: f64) -> ([f64; 2], [f64; 2]) {
    let stamps = stamps((4.0 * rate) as usize, rate);
    let mut poses = jittered(&stamps, metres, radians);
    let before = error(&stamps, &poses);
    smooth(&stamps, &mut poses);
    (before, error(&stamps, &poses))
}

#[test]
fn jitter_is_reduced_at_any_frame_rate() {
    for (rate, left) in [(15.0, 0.8), (30.0, 0.65), (60.0, 0.6)] {
        let (before, after) = both(rate, 0.01, 0.01);
        assert!(after[0] < left * before[0], "{rate}: {before:?} {after:?}");
        assert!(
            after[1] < (left + 0.25) * before[1],
            "{rate}: {before:?} {after:?}"
        );
    }
}

#[test]
fn exact_poses_are_unchanged() {
    for rate in [10.0, 15.0, 30.0, 60.0] {
        let (_, after) = both(rate, 0.0, 0.0);
        assert!(after[0] < 1e-4 && after[1] < 2e-4, "{rate}: {after:?}");
    }
}

/// 20 m/s^2 for a tenth of a second among accurate poses: a robot driving over a door sill.
#[test]
fn short_acceleration_is_preserved() {
    let stamps: Vec<f64> = (0..90).map(|k| f64::from(k) / 30.0).collect();
    let way = |t: f64| {
        let (blow, after) = ((t - 1.0).clamp(0.0, 0.1), (t - 1.1).max(0.0));
        10.0 * blow * blow + 2.0 * after
    };
    let exact = |t: f64| Se3::new(so3::exp(&Vec3::zeros()), Vec3::new(0.0, 0.0, way(t)));
    let mut poses: Vec<Se3> = stamps.iter().map(|t| exact(*t)).collect();
    for (k, pose) in poses.iter_mut().enumerate() {
        pose.translation += normal(k, 0) * 0.001;
    }
    smooth(&stamps, &mut poses);
    for (t, pose) in stamps.iter().zip(&poses) {
        let off = (pose.translation.z - way(*t)).abs();
        assert!(off < 0.006, "{t}: {off}");
    }
}

#[test]
fn single_outlier_pose_is_corrected() {
    let stamps = stamps(60, 30.0);
    let mut poses = jittered(&stamps, 0.002, 0.002);
    poses[30].translation.x += 0.08;
    smooth(&stamps, &mut poses);
    let off = (poses[30].translation - hand(stamps[30]).translation).norm();
    assert!(off < 0.01, "{off}");
}

#[test]
fn too_few_poses_are_unchanged() {
    let stamps = stamps(LEAST - 1, 30.0);
    let poses = jittered(&stamps, 0.01, 0.01);
    let mut smoothed = poses.clone();
    smooth(&stamps, &mut smoothed);
    assert_eq!(poses, smoothed);
}

proptest! {
    /// The result does not depend on the choice of world frame.
    #[test]
    fn result_is_independent_of_the_world_frame(turn in [-2.0..2.0, -2.0..2.0, -2.0..2.0f64], shift in [-5.0..5.0, -5.0..5.0, -5.0..5.0f64]) {
        let world = Se3::new(so3::exp(&Vec3::from(turn)), Vec3::from(shift));
        let stamps = stamps(40, 30.0);
        let mut poses = jittered(&stamps, 0.005, 0.005);
        let mut moved: Vec<Se3> = poses.iter().map(|p| world * *p).collect();
        smooth(&stamps, &mut poses);
        smooth(&stamps, &mut moved);
        for (a, b) in poses.iter().zip(&moved) {
            let apart = (world * *a).inverse() * *b;
            prop_assert!(apart.log().norm() < 1e-8, "{apart:?}");
        }
    }

    /// With any stamps, no pose moves farther than the errors around it, and none is lost.
    #[test]
    fn uneven_stamps_are_handled(gaps in prop::collection::vec(-4.0..-0.61f64, 12..60), metres in 0.0..0.05f64) {
        let mut now = 0.0;
        let times = gaps.iter().map(|g| {
            now += libm::pow(10.0, *g);
            now
        });
        let stamps: Vec<f64> = times.collect();
        let poses = jittered(&stamps, metres, metres);
        let mut smoothed = poses.clone();
        smooth(&stamps, &mut smoothed);
        for (a, b) in poses.iter().zip(&smoothed) {
            let (moved, turned) = ((a.translation - b.translation).norm(), a.rotation.angle_to(&b.rotation));
            prop_assert!(moved < 0.05 + 10.0 * metres && turned < 0.05 + 10.0 * metres, "{moved} {turned}");
        }
    }

    /// The banded solver solves the normal equations.
    #[test]
    fn banded_solver_solves_the_normal_equations(weights in prop::collection::vec(0.1..10.0f64, 3..20), shares in [-3.0..3.0, -3.0..3.0, -3.0..3.0f64], weight in 0.0..5.0f64) {
        let mut system = Banded::new(&weights);
        for k in 0..weights.len() - 2 {
            system.add(k, &shares, weight, &(Vec3::x() * (k as f64 - 3.0)));
        }
        let found = system.solve();
        for i in 0..weights.len() {
            let mut gradient = weights[i] * found[i].x;
            for k in 0..weights.len() - 2 {
                if (k..k + 3).contains(&i) {
                    let sum: f64 = (0..3).map(|j| shares[j] * found[k + j].x).sum();
                    gradient += weight * shares[i - k] * (sum - (k as f64 - 3.0));
                }
            }
            prop_assert!(gradient.abs() < 1e-8, "{i}: {gradient}");
        }
    }
}
