//! The rigid motion between two cameras with depth, on points with known truth.

use proptest::prelude::*;
use stillpoint_estimation::{
    Intrinsics, Measurement, Purpose, RigidOptions, RigidOutcome, RigidPair, Rng, find_rigid, rng,
};
use stillpoint_geometry::{Se3, Vec2, Vec3, Vec6, so3};

const CAMERA: Intrinsics = Intrinsics {
    fx: 520.0,
    fy: 515.0,
    cx: 320.0,
    cy: 240.0,
};

fn normal(random: &mut Rng) -> f64 {
    (0..12).map(|_| random.unit() - 0.5).sum()
}

fn project(p: &Vec3) -> Vec2 {
    Vec2::new(
        CAMERA.fx * p.x / p.z + CAMERA.cx,
        CAMERA.fy * p.y / p.z + CAMERA.cy,
    )
}

/// A camera's measurement of a point, and the resulting position.
fn see(p: &Vec3, random: &mut Rng) -> (Vec3, Measurement) {
    let sigma_px = [1.0, 1.2, 1.44][random.below(3)];
    let sigma = 0.003 * p.z * p.z;
    let pixel = project(p) + Vec2::new(normal(random), normal(random)) * sigma_px;
    let z = p.z + sigma * normal(random);
    let x = (pixel.x - CAMERA.cx) / CAMERA.fx;
    let y = (pixel.y - CAMERA.cy) / CAMERA.fy;
    let measurement = Measurement::new(pixel, sigma_px, Some((z, sigma)));
    (Vec3::new(x * z, y * z, z), measurement)
}

fn anywhere(random: &mut Rng) -> Vec3 {
    let z = 0.8 + 3.0 * random.unit();
    let (x, y) = (1.1 * random.unit() - 0.55, 0.8 * random.unit() - 0.4);
    Vec3::new(x * z, y * z, z)
}

/// Pairs of which the first `wrong` are mismatched.
fn pairs(b_from_a: &Se3, count: usize, wrong: usize, random: &mut Rng) -> Vec<RigidPair> {
    (0..count)
        .map(|i| {
            let truth = anywhere(random);
            let in_b = if i < wrong {
                anywhere(random)
            } else {
                b_from_a.transform(&truth)
            };
            let (point_a, measurement_a) = see(&truth, random);
            let (point_b, measurement_b) = see(&in_b, random);
            RigidPair {
                point_a,
                point_b,
                measurement_a,
                measurement_b,
            }
        })
        .collect()
}

/// Likewise, with every right pair well within the gates of the true motion: otherwise noise would put a tenth outside.
fn clear_pairs(b_from_a: &Se3, count: usize, wrong: usize, random: &mut Rng) -> Vec<RigidPair> {
    let mut all = pairs(b_from_a, count, wrong, random);
    for pair in &mut all[wrong..] {
        while !fits(b_from_a, pair, 0.5) {
            *pair = pairs(b_from_a, 1, 0, random).remove(0);
        }
    }
    all
}

/// Whether a pair is within this share of the squared default gates of a motion.
fn fits(b_from_a: &Se3, pair: &RigidPair, share: f64) -> bool {
    let gate_scale = RigidOptions::default().gate_scale;
    let within = |m: &Measurement, p: Vec3| m.chi2(&CAMERA, &p) <= share * gate_scale * m.gate();
    within(&pair.measurement_b, b_from_a.transform(&pair.point_a))
        && within(
            &pair.measurement_a,
            b_from_a.inverse().transform(&pair.point_b),
        )
}

fn find(pairs: &[RigidPair], seed: u64) -> RigidOutcome {
    let options = RigidOptions::default();
    find_rigid(&CAMERA, pairs, &options, rng(seed, 3, Purpose::RIGID))
}

/// Motions that keep the scene in front of the second camera.
fn motion() -> impl Strategy<Value = Se3> {
    let (t, r) = (-0.3..0.3f64, -0.3..0.3f64);
    [t.clone(), t.clone(), t, r.clone(), r.clone(), r].prop_map(|t| Se3::exp(&Vec6::from(t)))
}

fn error(a: &Se3, b: &Se3) -> (f64, f64) {
    let e = *a * b.inverse();
    (e.translation.norm(), so3::angle(&e.rotation))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Four fifths of the pairs are wrong. No right one is lost, as all are within the gates of the true motion.
    #[test]
    fn motion_is_found_among_outliers(truth in motion(), seed in any::<u64>()) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let pairs = clear_pairs(&truth, 200, 160, random);
        let outcome = find(&pairs, seed);
        let found = outcome.found().unwrap();
        let (t, r) = error(&found.b_from_a, &truth);
        prop_assert!(t < 0.015 && r < 0.007, "{t} m, {r} rad");
        let kept = found.inliers[160..].iter().filter(|i| **i).count();
        let false_ones = found.inliers[..160].iter().filter(|i| **i).count();
        prop_assert!(kept >= 38 && false_ones <= 3, "{kept} {false_ones}");
        prop_assert_eq!(found.inlier_count, kept + false_ones);
        // Control: a fit to all pairs is far off.
        let (a, b): (Vec<_>, Vec<_>) = pairs.iter().map(|p| (p.point_a, p.point_b)).unzip();
        let all = stillpoint_geometry::align_umeyama(&a, &b, false).unwrap().target_from_source;
        prop_assert!(error(&all, &truth).0 > 3.0 * t);
    }

    /// Swapping the cameras gives the inverse motion.
    #[test]
    fn swapped_cameras_give_the_inverse_motion(truth in motion(), seed in any::<u64>()) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let there = pairs(&truth, 80, 20, random);
        let back: Vec<_> = there.iter().map(|p| RigidPair {
            point_a: p.point_b,
            point_b: p.point_a,
            measurement_a: p.measurement_b,
            measurement_b: p.measurement_a,
        }).collect();
        let (there, back) = (find(&there, seed), find(&back, seed));
        let (there, back) = (there.found().unwrap(), back.found().unwrap());
        let (t, r) = error(&there.b_from_a, &back.b_from_a.inverse());
        prop_assert!(t < 1e-3 && r < 5e-4, "{t} {r}");
    }

    #[test]
    fn same_random_address_gives_identical_results(seed in any::<u64>()) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let pairs = pairs(&Se3::exp(&Vec6::new(0.1, 0.0, 0.1, 0.1, 0.0, 0.0)), 90, 50, random);
        let run = || format!("{:?}", find(&pairs, seed));
        prop_assert_eq!(run(), run());
    }

    #[test]
    fn random_pairs_give_no_motion(seed in any::<u64>(), count in 30usize..300) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let outcome = find(&pairs(&Se3::identity(), count, count, random), seed);
        prop_assert!(matches!(outcome, RigidOutcome::NoConsensus { inliers, .. } if inliers < 20), "{outcome:?}");
    }

    /// No input causes a panic, and pairs that are not finite are never inliers.
    #[test]
    fn non_finite_pairs_are_tolerated(seed in any::<u64>(), bad in prop::sample::select(vec![f64::NAN, f64::INFINITY, -1.0, 0.0, 1e300])) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let truth = Se3::exp(&Vec6::new(0.1, 0.0, 0.1, 0.1, 0.0, 0.0));
        let mut pairs = pairs(&truth, 90, 0, random);
        for p in &mut pairs[..30] {
            match random.below(5) {
                0 => p.point_a.z = bad,
                1 => p.point_b.x = bad,
                2 => p.measurement_a.pixel.y = bad,
                3 => p.measurement_b.inverse_depth = bad,
                _ => p.measurement_b.pixel_weight = bad,
            }
        }
        let outcome = find(&pairs, seed);
        let found = outcome.found().unwrap();
        let (t, r) = error(&found.b_from_a, &truth);
        prop_assert!(t < 0.02 && r < 0.01, "{t} {r}");
    }
}

/// Errors scaled with the information are chi-square with six degrees of freedom, for measured and for exact points.
#[test]
fn errors_match_the_information() {
    for exact_points in [false, true] {
        let mut sum = 0.0;
        let runs = 200;
        for seed in 0..runs {
            let random = &mut rng(seed, 0, Purpose(1001));
            let truth = Se3::exp(&Vec6::new(0.2, -0.05, 0.1, 0.05, 0.1, -0.1));
            let mut pairs = pairs(&truth, 60, 0, random);
            let mut options = RigidOptions::default();
            if exact_points {
                options.gate_scale = 1.0;
                for p in &mut pairs {
                    p.point_a = anywhere(random);
                    p.point_b = truth.transform(&p.point_a);
                    p.measurement_a = see(&p.point_a, random).1;
                    p.measurement_b = see(&p.point_b, random).1;
                }
            }
            let outcome = find_rigid(&CAMERA, &pairs, &options, rng(seed, 3, Purpose::RIGID));
            let found = outcome.found().unwrap();
            let e = (found.b_from_a * truth.inverse()).log();
            sum += e.dot(&(found.information * e));
            let expected = if exact_points { 0.9..1.8 } else { 2.0..6.0 };
            assert!(
                expected.contains(&found.variance_factor),
                "{}",
                found.variance_factor
            );
        }
        let mean = sum / runs as f64;
        // Gating makes inliers look slightly better, so the upper bound is wider.
        assert!(
            (4.0..9.0).contains(&mean),
            "{mean}, exact points: {exact_points}"
        );
    }
}

#[test]
fn degenerate_or_too_few_pairs_are_reported() {
    let truth = Se3::exp(&Vec6::new(0.1, 0.0, 0.1, 0.1, 0.0, 0.0));
    let random = &mut rng(5, 0, Purpose(1000));
    let mut along = pairs(&truth, 60, 0, random);
    let mut put = |p: &mut RigidPair, at: Vec3| {
        (p.point_a, p.measurement_a) = see(&at, random);
        (p.point_b, p.measurement_b) = see(&truth.transform(&at), random);
    };
    for (i, p) in along.iter_mut().enumerate() {
        put(p, Vec3::new(-0.6 + 0.02 * i as f64, 0.1, 1.0));
    }
    // Samples that are collinear within noise may pass, so the final check may be the one to refuse.
    let outcome = find(&along, 1);
    assert!(
        matches!(
            outcome,
            RigidOutcome::Degenerate { .. } | RigidOutcome::NoConsensus { .. }
        ),
        "{outcome:?}"
    );
    for p in &mut along {
        put(p, Vec3::new(0.1, 0.1, 1.5));
    }
    assert!(find(&along, 1).found().is_none());
    assert!(matches!(
        find(&[], 1),
        RigidOutcome::TooFewPairs { usable: 0 }
    ));
    assert!(matches!(
        find(&along[..19], 1),
        RigidOutcome::TooFewPairs { usable: 19 }
    ));
}
