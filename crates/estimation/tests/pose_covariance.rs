//! Covariance and information of optimised poses.
#![allow(clippy::print_stdout)]

use crate::pose::{Random, SIGMA_PX, camera, error, scene, solve};
use proptest::prelude::*;
use stillpoint_estimation::{
    Intrinsics, Measurement, PoseObservation, PoseOptions, optimise_pose, pose_covariance,
};
use stillpoint_geometry::{Mat6, Se3, Vec2, Vec3, Vec6};

/// Errors scaled with the information have variance 1 in each of six directions.
#[test]
fn information_is_the_inverse_covariance() {
    let (truth, mut sum, runs) = (Se3::identity(), 0.0, 400);
    let random = &mut Random(7);
    for _ in 0..runs {
        let (observations, _) = scene(&truth, 60, 0.0, true, random);
        let intrinsics = Intrinsics::from(&camera());
        // With open gates the tails are kept, which would otherwise reduce the variance.
        let options = PoseOptions {
            gate_scale: 1e3,
            ..PoseOptions::default()
        };
        let estimate = optimise_pose(&intrinsics, &truth, &observations, &options);
        let e = error(&estimate, &truth);
        sum += e.dot(&(estimate.information * e));
    }
    let mean = sum / f64::from(runs);
    // 6 +- 4 sqrt(2 * 6 / 400), plus a little for the linearisation.
    assert!((mean - 6.0).abs() < 0.8, "mean {mean}");
}

/// Mean normalised squared error of poses over `runs` scenes.
fn mean_nees(count: usize, outliers: f64, depth: bool, runs: u32, seed: u64) -> f64 {
    let random = &mut Random(seed);
    let mut sum = 0.0;
    for _ in 0..runs {
        let truth = Se3::exp(&Vec6::from_fn(|_, _| random.within(-0.5, 0.5)));
        let (observations, _) = scene(&truth, count, outliers, depth, random);
        let start = Se3::exp(&Vec6::from_fn(|_, _| random.within(-0.01, 0.01)));
        let estimate = solve(&(start * truth), &observations);
        let e = error(&estimate, &truth);
        let covariance = estimate.covariance().unwrap();
        sum += e.dot(&covariance.cholesky().unwrap().solve(&e));
    }
    sum / f64::from(runs)
}

/// With gates and outliers as in tracking: removing the outer 5 % of good measurements loses some information, so the
/// mean is slightly above 6.
#[test]
fn errors_match_the_stated_covariance() {
    for (count, outliers, depth) in [
        (60, 0.0, true),
        (200, 0.0, true),
        (200, 0.3, true),
        (60, 0.0, false),
        (200, 0.3, false),
    ] {
        let mean = mean_nees(count, outliers, depth, 300, 11);
        println!("{count} points, {outliers} wrong, depth {depth}: NEES {mean:.2}");
        assert!(
            (5.0..7.5).contains(&mean),
            "{count} {outliers} {depth}: {mean}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Covariance times information is the identity, at any scale of the scene.
    #[test]
    fn the_covariance_inverts_the_information(
        seed in any::<u64>(),
        count in 10_usize..100,
        scale in -3.0..3.0f64,
    ) {
        let (observations, _) = scene(&Se3::identity(), count, 0.0, true, &mut Random(seed));
        let information = solve(&Se3::identity(), &observations).information * libm::exp(scale);
        let covariance = pose_covariance(&information).unwrap();
        prop_assert!((covariance * information - Mat6::identity()).amax() < 1e-6);
        prop_assert_eq!(covariance, covariance.transpose());
        prop_assert!(covariance.cholesky().is_some());
    }

    /// A direction with zero information has no covariance.
    #[test]
    fn a_singular_information_has_no_covariance(
        rows in prop::collection::vec(prop::array::uniform6(-1.0..1.0f64), 0..6),
        size in -8.0..8.0f64,
    ) {
        let mut information = Mat6::zeros();
        for row in rows.iter().map(|r| Vec6::from(*r)) {
            information += row * row.transpose() * libm::exp(size);
        }
        prop_assert_eq!(pose_covariance(&information), None);
    }

    #[test]
    fn any_matrix_is_inverted_or_refused(
        values in prop::collection::vec(any::<f64>(), 36),
    ) {
        let covariance = pose_covariance(&Mat6::from_row_slice(&values));
        prop_assert!(covariance.is_none_or(|c| c.iter().all(|v| v.is_finite())));
    }
}

#[test]
fn points_on_one_ray_give_no_covariance() {
    let (observations, _) = scene(&Se3::identity(), 200, 0.0, false, &mut Random(3));
    // Pixels of points on one ray leave the camera's distance along it open.
    let on_a_ray = |i: usize| PoseObservation {
        point: Vec3::new(0.0, 0.0, 1.0 + i as f64 * 0.1),
        measurement: Measurement::new(Vec2::new(320.0, 240.0), SIGMA_PX, None),
    };
    let line: Vec<_> = (0..20).map(on_a_ray).collect();
    assert_eq!(solve(&Se3::identity(), &line).covariance(), None);
    assert_eq!(solve(&Se3::identity(), &[]).covariance(), None);
    assert!(
        solve(&Se3::identity(), &observations)
            .covariance()
            .is_some()
    );
}
