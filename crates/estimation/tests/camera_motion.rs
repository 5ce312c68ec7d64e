//! P3P and the weighted vote on the camera's motion, on points with known truth.

use proptest::prelude::*;
use stillpoint_estimation::{
    CameraMotion, Intrinsics, Measurement, MotionOptions, MotionPair, MotionPrior, Purpose, Rng,
    find_camera_motion, p3p, rng,
};
use stillpoint_geometry::{Camera, Se3, Vec2, Vec3, Vec6, so3};

pub(crate) fn camera() -> Camera {
    Camera::pinhole(640, 480, [520.0, 515.0, 320.0, 240.0])
}

const SIGMA_PX: f64 = 0.6;

fn depth_sigma(z: f64) -> f64 {
    0.003 * z * z
}

fn normal(random: &mut Rng) -> f64 {
    (0..12).map(|_| random.unit() - 0.5).sum()
}

/// Noisy pairs of points that follow a motion, in a part of the image.
pub(crate) fn follow(
    motion: &Se3,
    count: usize,
    columns: (f64, f64),
    depths: (f64, f64),
    with_depth: bool,
    random: &mut Rng,
) -> Vec<MotionPair> {
    let camera = camera();
    (0..count)
        .map(|_| {
            let u = columns.0 + (columns.1 - columns.0) * random.unit();
            let z = depths.0 + (depths.1 - depths.0) * random.unit();
            let point = camera.backproject(Vec2::new(u, 480.0 * random.unit()), z);
            let p = motion.transform(&point);
            let noise = Vec2::new(normal(random), normal(random)) * SIGMA_PX;
            let sigma = depth_sigma(p.z);
            let depth = with_depth.then(|| (p.z + sigma * normal(random), sigma));
            MotionPair {
                point,
                measurement: Measurement::new(camera.project(&p) + noise, SIGMA_PX, depth),
                weight: 1.0,
            }
        })
        .collect()
}

fn find(pairs: &[MotionPair], prior: Option<&MotionPrior>, seed: u64) -> Option<CameraMotion> {
    find_camera_motion(
        &Intrinsics::from(&camera()),
        pairs,
        prior,
        &MotionOptions::default(),
        rng(seed, 7, Purpose::CAMERA_MOTION),
    )
}

/// Translation (m) and rotation (rad) between two motions.
pub(crate) fn error(a: &Se3, b: &Se3) -> (f64, f64) {
    let e = *a * b.inverse();
    (e.translation.norm(), so3::angle(&e.rotation))
}

fn twist(size_t: f64, size_r: f64) -> impl Strategy<Value = Vec6> {
    let (t, r) = (-size_t..size_t, -size_r..size_r);
    [t.clone(), t.clone(), t, r.clone(), r.clone(), r].prop_map(Vec6::from)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// The truth is among the poses, and all of them see the points in the given directions.
    #[test]
    fn p3p_solutions_contain_the_true_pose(
        truth in twist(2.0, 2.0),
        seen in [[-0.6..0.6f64, -0.5..0.5, 0.4..8.0], [-0.6..0.6f64, -0.5..0.5, 0.4..8.0], [-0.6..0.6f64, -0.5..0.5, 0.4..8.0]],
        lengths in [0.1..9.0f64, 0.1..9.0, 0.1..9.0],
    ) {
        let truth = Se3::exp(&truth);
        let seen = seen.map(|[x, y, z]| Vec3::new(x * z, y * z, z));
        let sides = (seen[1] - seen[0], seen[2] - seen[0]);
        // Nearly degenerate triangles do not determine a pose to this accuracy.
        prop_assume!(sides.0.cross(&sides.1).norm() > 0.05 * sides.0.norm() * sides.1.norm());
        let volume = seen[0].normalize().dot(&seen[1].normalize().cross(&seen[2].normalize()));
        prop_assume!(volume.abs() > 1e-3);
        let points = seen.map(|p| truth.inverse().transform(&p));
        let bearings = [0, 1, 2].map(|i| seen[i].normalize() * lengths[i]);
        let poses = p3p(points, bearings);
        prop_assert!(!poses.is_empty() && poses.len() <= 4);
        let nearest = poses.iter().map(|p| error(p, &truth)).map(|(t, r)| t + r).fold(f64::INFINITY, f64::min);
        prop_assert!(nearest < 1e-4, "{nearest:e} among {}", poses.len());
        for pose in &poses {
            for (p, b) in points.iter().zip(&bearings) {
                let cos = pose.transform(p).normalize().dot(&b.normalize());
                prop_assert!(cos > 1.0 - 1e-9, "{cos}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Half of the pairs are outliers, without a prior.
    #[test]
    fn motion_is_found_among_outliers(truth in twist(0.1, 0.1), seed in any::<u64>(), depth in any::<bool>()) {
        let truth = Se3::exp(&truth);
        let random = &mut rng(seed, 0, Purpose(1000));
        let mut pairs = follow(&truth, 240, (10.0, 630.0), (0.8, 4.0), depth, random);
        for p in &mut pairs[..120] {
            p.measurement.pixel += Vec2::new(random.unit() - 0.5, random.unit() - 0.5) * 150.0;
        }
        let found = find(&pairs, None, seed).unwrap();
        let (t, r) = error(&found.b_from_a, &truth);
        prop_assert!(t < 0.006 && r < 0.003, "{t} m, {r} rad");
        let kept = found.inliers[120..].iter().filter(|i| **i).count();
        prop_assert!(kept >= 105, "{kept}");
        prop_assert_eq!(found.count, found.inliers.iter().filter(|i| **i).count());
        prop_assert!((found.weight_share - found.count as f64 / 240.0).abs() < 1e-12);
    }

    #[test]
    fn same_random_address_gives_identical_results(seed in any::<u64>(), depth in any::<bool>()) {
        let truth = Se3::exp(&Vec6::new(0.02, 0.01, 0.0, 0.01, 0.0, 0.02));
        let random = &mut rng(seed, 0, Purpose(1000));
        let mut pairs = follow(&truth, 60, (10.0, 630.0), (0.8, 4.0), depth, random);
        for p in &mut pairs[..25] {
            p.measurement.pixel.x += 40.0 * random.unit();
        }
        let run = || format!("{:?}", find(&pairs, None, seed));
        prop_assert_eq!(run(), run());
    }

    #[test]
    fn random_pairs_give_no_motion(seed in any::<u64>()) {
        let random = &mut rng(seed, 0, Purpose(1000));
        let mut pairs = follow(&Se3::identity(), 80, (10.0, 630.0), (0.8, 4.0), true, random);
        for p in &mut pairs {
            p.measurement.pixel = Vec2::new(640.0 * random.unit(), 480.0 * random.unit());
        }
        let found = find(&pairs, None, seed);
        prop_assert!(found.is_none_or(|f| f.count < 12));
    }
}

/// 60 % of the pairs are on a person walking in front; the truth is the room's motion.
fn walking(seed: u64) -> (Se3, Se3, Vec<MotionPair>) {
    let random = &mut rng(seed, 0, Purpose(1001));
    let camera_moves = Se3::exp(&Vec6::new(0.012, -0.004, 0.008, 0.004, -0.006, 0.002));
    let person_moves = camera_moves * Se3::exp(&Vec6::new(0.045, 0.0, 0.01, 0.0, 0.0, 0.0));
    let mut pairs = follow(&person_moves, 180, (150.0, 450.0), (1.0, 1.5), true, random);
    pairs.extend(follow(
        &camera_moves,
        120,
        (10.0, 630.0),
        (1.5, 4.0),
        true,
        random,
    ));
    (camera_moves, person_moves, pairs)
}

fn believe(pairs: &mut [MotionPair]) {
    for (i, p) in pairs.iter_mut().enumerate() {
        // Old landmarks are mostly in the room. A tenth of the weights are wrong.
        let old = (i >= 180) != i.is_multiple_of(10);
        p.weight = if old { 1.0 } else { 0.3 };
    }
}

fn constant_velocity(camera_moves: &Se3) -> MotionPrior {
    MotionPrior {
        b_from_a: Se3::exp(&Vec6::new(-0.003, 0.002, 0.002, 0.002, -0.001, 0.0)) * *camera_moves,
        sigma_m: 0.006,
        sigma_rad: 0.006,
    }
}

#[test]
fn weights_and_prior_favour_the_room_over_people() {
    for seed in 0..20 {
        let (camera_moves, _, mut pairs) = walking(seed);
        let prior = constant_velocity(&camera_moves);
        believe(&mut pairs);
        let found = find(&pairs, Some(&prior), seed).unwrap();
        let (t, r) = error(&found.b_from_a, &camera_moves);
        assert!(t < 0.006 && r < 0.003, "seed {seed}: {t} m, {r} rad");
        let room = found.inliers[180..].iter().filter(|i| **i).count();
        let person = found.inliers[..180].iter().filter(|i| **i).count();
        assert!(room >= 105 && person <= 18, "seed {seed}: {room}, {person}");
        // These weights suffice alone: 120 votes of the room against 66 of the person.
        let weights_only = find(&pairs, None, seed).unwrap();
        assert!(error(&weights_only.b_from_a, &camera_moves).0 < 0.006);
    }
}

/// Control: without weights and prior the person, who has more points, wins.
#[test]
fn without_weights_the_majority_wins() {
    for seed in 0..20 {
        let (camera_moves, person_moves, pairs) = walking(seed);
        let found = find(&pairs, None, seed).unwrap();
        assert!(
            error(&found.b_from_a, &camera_moves).0 > 0.02,
            "seed {seed}"
        );
        let person = found.inliers[..180].iter().filter(|i| **i).count();
        assert!(person >= 130, "seed {seed}: {person}");
        assert!(error(&found.b_from_a, &person_moves).0 < 0.02);
    }
}

#[test]
fn prior_outweighs_a_small_majority() {
    for seed in 0..10 {
        let (camera_moves, _, mut pairs) = walking(seed);
        // 140 against 120.
        pairs.drain(..40);
        let prior = constant_velocity(&camera_moves);
        let found = find(&pairs, Some(&prior), seed).unwrap();
        assert!(
            error(&found.b_from_a, &camera_moves).0 < 0.006,
            "seed {seed}"
        );
        let found = find(&pairs, None, seed).unwrap();
        assert!(
            error(&found.b_from_a, &camera_moves).0 > 0.02,
            "seed {seed}"
        );
    }
}

/// A wrong prior does not hide a motion on which all pairs agree.
#[test]
fn unanimous_pairs_overrule_a_wrong_prior() {
    let (camera_moves, _, pairs) = walking(3);
    let prior = MotionPrior {
        b_from_a: Se3::exp(&Vec6::new(0.3, -0.2, 0.1, 0.1, 0.2, -0.1)),
        sigma_m: 0.005,
        sigma_rad: 0.005,
    };
    let found = find(&pairs[180..], Some(&prior), 3).unwrap();
    assert!(error(&found.b_from_a, &camera_moves).0 < 0.006);
    assert!(found.weight_share > 0.85);
}

/// Pairs of weight 0 are classified but do not vote.
#[test]
fn zero_weight_pairs_are_classified_without_voting() {
    let (camera_moves, _, mut pairs) = walking(5);
    for (i, p) in pairs.iter_mut().enumerate() {
        p.weight = if (180..240).contains(&i) { 1.0 } else { 0.0 };
    }
    let found = find(&pairs, None, 5).unwrap();
    assert!(error(&found.b_from_a, &camera_moves).0 < 0.006);
    assert!(found.inliers[240..].iter().filter(|i| **i).count() >= 48);
    assert!(found.inliers[..180].iter().filter(|i| **i).count() <= 18);
    assert!(found.weight_share > 0.8 && found.weight_share <= 1.0);
}

#[test]
fn invalid_input_gives_no_motion() {
    let (_, _, mut pairs) = walking(1);
    assert!(find(&[], None, 1).is_none());
    assert!(find(&pairs[..4], None, 1).is_none());
    for (i, p) in pairs.iter_mut().enumerate() {
        match i % 6 {
            0 => p.point.x = f64::NAN,
            1 => p.measurement.pixel.y = f64::INFINITY,
            2 => p.weight = f64::NAN,
            3 => p.weight = -1.0,
            4 => p.weight = f64::INFINITY,
            _ => p.weight = 0.0,
        }
    }
    assert!(find(&pairs, None, 1).is_none());
    // If one pair has nearly all the weight, drawing three different ones must not hang.
    let (_, _, mut pairs) = walking(1);
    pairs[0].weight = 1e18;
    let _ = find(&pairs, None, 1);
    // Points on a line, seen by a static camera.
    for (i, p) in pairs.iter_mut().enumerate() {
        p.point = Vec3::new(0.0, 0.0, 1.0 + 0.01 * i as f64);
    }
    let found = find(&pairs, None, 1);
    assert!(found.is_none_or(|f| f.b_from_a.is_finite()));
}

#[test]
fn p3p_refuses_degenerate_input() {
    let (x, y, z) = (Vec3::x(), Vec3::y(), Vec3::z());
    let bearings = [x + z * 3.0, y + z * 3.0, z];
    assert!(p3p([x, x * 2.0, x * 3.0], bearings).is_empty());
    assert!(p3p([x, x, y], bearings).is_empty());
    assert!(p3p([x, y, z], [Vec3::zeros(), y, z]).is_empty());
    assert!(p3p([x * f64::NAN, y, z], bearings).is_empty());
    // For coinciding directions results are finite.
    assert!(p3p([x, y, z], [z, z, z]).iter().all(Se3::is_finite));
}
