//! Absolute pose on points with known truth.

use proptest::prelude::*;
use stillpoint_estimation::{
    AbsolutePoseOptions, AbsolutePoseOutcome, Intrinsics, Measurement, PoseObservation, Purpose,
    Rng, find_absolute_pose, rng,
};
use stillpoint_geometry::{Camera, Se3, Vec2, Vec3, Vec6, so3};

fn camera() -> Camera {
    Camera::pinhole(640, 480, [520.0, 515.0, 320.0, 240.0])
}

fn normal(random: &mut Rng) -> f64 {
    (0..12).map(|_| random.unit() - 0.5).sum()
}

/// Observations of which the first `wrong` belong to other points; a share of all has depth.
fn observations(
    camera_from_world: &Se3,
    (count, wrong): (usize, usize),
    with_depth: f64,
    random: &mut Rng,
) -> Vec<PoseObservation> {
    let camera = camera();
    let anywhere = |random: &mut Rng| {
        let pixel = Vec2::new(640.0 * random.unit(), 480.0 * random.unit());
        camera.backproject(pixel, 0.7 + 4.0 * random.unit())
    };
    let world_from_camera = camera_from_world.inverse();
    (0..count)
        .map(|i| {
            let p = anywhere(random);
            let seen = if i < wrong { anywhere(random) } else { p };
            let noise = Vec2::new(normal(random), normal(random));
            let sigma = 0.003 * seen.z * seen.z;
            let depth =
                (random.unit() < with_depth).then(|| (seen.z + sigma * normal(random), sigma));
            PoseObservation {
                point: world_from_camera.transform(&p),
                measurement: Measurement::new(camera.project(&seen) + noise, 1.0, depth),
            }
        })
        .collect()
}

fn find(observations: &[PoseObservation], seed: u64) -> AbsolutePoseOutcome {
    find_absolute_pose(
        &Intrinsics::from(&camera()),
        observations,
        &AbsolutePoseOptions::default(),
        rng(seed, 7, Purpose(7)),
    )
}

/// Anywhere in a building.
fn pose() -> impl Strategy<Value = Se3> {
    let (t, r) = (-20.0..20.0f64, -1.8..1.8f64);
    [t.clone(), t.clone(), t, r.clone(), r.clone(), r].prop_map(|t| Se3::exp(&Vec6::from(t)))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Three quarters are wrong, without an initial guess; with depth, without, and mixed.
    #[test]
    fn pose_is_found_among_outliers(truth in pose(), seed in any::<u64>(), with_depth in prop::sample::select(vec![0.0, 0.5, 1.0])) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let observations = observations(&truth, (200, 150), with_depth, random);
        let outcome = find(&observations, seed);
        let found = outcome.found().unwrap();
        let e = found.camera_from_world * truth.inverse();
        let (t, r) = (e.translation.norm(), so3::angle(&e.rotation));
        prop_assert!(t < 0.03 && r < 0.01, "{t} m, {r} rad");
        let kept = found.inliers[150..].iter().filter(|i| **i).count();
        prop_assert!(kept >= 38, "{kept}");
        prop_assert_eq!(found.inlier_count, found.inliers.iter().filter(|i| **i).count());
        prop_assert!(found.information.cholesky().is_some());
    }

    #[test]
    fn random_observations_give_no_pose(seed in any::<u64>(), with_depth in 0.0..1.0f64) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let observations = observations(&Se3::identity(), (100, 100), with_depth, random);
        prop_assert!(find(&observations, seed).found().is_none());
    }

    #[test]
    fn same_random_address_gives_identical_results(seed in any::<u64>()) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let observations = observations(&Se3::identity(), (80, 40), 0.5, random);
        let run = || format!("{:?}", find(&observations, seed));
        prop_assert_eq!(run(), run());
    }

    #[test]
    fn non_finite_values_are_tolerated(seed in any::<u64>(), bad in prop::sample::select(vec![f64::NAN, f64::INFINITY, 0.0, -1e300])) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let mut observations = observations(&Se3::identity(), (90, 0), 0.5, random);
        for o in &mut observations[..30] {
            match random.below(4) {
                0 => o.point.z = bad,
                1 => o.measurement.pixel.x = bad,
                2 => o.measurement.inverse_depth = bad,
                _ => o.measurement.pixel_weight = bad,
            }
        }
        let outcome = find(&observations, seed);
        let found = outcome.found().unwrap();
        prop_assert!(found.camera_from_world.translation.norm() < 0.03);
    }
}

#[test]
fn degenerate_or_too_few_observations_are_reported() {
    let camera = camera();
    let random = &mut rng(5, 0, Purpose(1000));
    let mut line = observations(&Se3::identity(), (60, 0), 1.0, random);
    for (i, o) in line.iter_mut().enumerate() {
        o.point = Vec3::new(-0.6 + 0.02 * i as f64, 0.1, 1.0);
        o.measurement = Measurement::new(camera.project(&o.point), 1.0, Some((1.0, 0.003)));
    }
    assert!(find(&line, 1).found().is_none());
    assert!(matches!(
        find(&[], 1),
        AbsolutePoseOutcome::TooFewObservations { usable: 0 }
    ));
    assert!(matches!(
        find(&line[..14], 1),
        AbsolutePoseOutcome::TooFewObservations { usable: 14 }
    ));
}
