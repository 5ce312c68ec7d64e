//! Pose optimisation and triangulation on points with known truth.

use proptest::prelude::*;
use stillpoint_estimation::{
    Intrinsics, KnownPlace, Measurement, PoseEstimate, PoseObservation, PoseOptions, optimise_pose,
    triangulate_midpoint,
};
use stillpoint_geometry::{Camera, Mat3, Mat6, Se3, Vec2, Vec3, Vec6, nalgebra};

/// Seeded random numbers (Steele, Lea, Flood 2014, SplitMix64).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Normal with deviation 1: twelve uniform numbers add up to variance 1.
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.within(-0.5, 0.5)).sum()
    }
}

pub(crate) fn camera() -> Camera {
    Camera::pinhole(640, 480, [520.0, 515.0, 320.0, 240.0])
}

pub(crate) const SIGMA_PX: f64 = 0.8;

fn depth_sigma(z: f64) -> f64 {
    0.002 * z * z
}

/// `count` noisy points in front of the true pose; a share `outliers` of them is measured elsewhere. Without `depth`,
/// pixels only.
pub(crate) fn scene(
    truth: &Se3,
    count: usize,
    outliers: f64,
    depth: bool,
    random: &mut Random,
) -> (Vec<PoseObservation>, Vec<bool>) {
    let (camera, world_from_camera) = (camera(), truth.inverse());
    let wrong = (outliers * count as f64) as usize;
    let mut observations = Vec::new();
    for i in 0..count {
        let px = Vec2::new(random.within(10.0, 630.0), random.within(10.0, 470.0));
        let z = random.within(0.6, 5.0);
        let point = world_from_camera.transform(&camera.backproject(px, z));
        let noise = Vec2::new(random.normal(), random.normal()) * SIGMA_PX;
        let mut seen = px + noise;
        let measured_z = z / (1.0 + random.normal() * depth_sigma(z) / z);
        if i < wrong {
            let side = if random.next().is_multiple_of(2) {
                1.0
            } else {
                -1.0
            };
            seen.x += side * random.within(15.0, 120.0);
            seen.y += random.within(-80.0, 80.0);
        }
        let depth = depth.then_some((measured_z, depth_sigma(z)));
        observations.push(PoseObservation {
            point,
            measurement: Measurement::new(seen, SIGMA_PX, depth),
        });
    }
    (observations, (0..count).map(|i| i >= wrong).collect())
}

pub(crate) fn solve(initial: &Se3, observations: &[PoseObservation]) -> PoseEstimate {
    let intrinsics = Intrinsics::from(&camera());
    optimise_pose(&intrinsics, initial, observations, &PoseOptions::default())
}

pub(crate) fn error(estimate: &PoseEstimate, truth: &Se3) -> Vec6 {
    (estimate.camera_from_world * truth.inverse()).log()
}

fn twist(size_t: f64, size_r: f64) -> impl Strategy<Value = Vec6> {
    let t = -size_t..size_t;
    let r = -size_r..size_r;
    [t.clone(), t.clone(), t, r.clone(), r.clone(), r].prop_map(Vec6::from)
}

/// On a line, the steps of the pixel grid stay in place when the camera moves along it: matches of 200 points are off
/// by 1.5 px along horizontal lines. The 40 corners among them determine the pose.
#[test]
fn points_that_slide_along_an_edge_do_not_pull_the_pose() {
    let truth = Se3::exp(&Vec6::new(0.1, -0.2, 0.05, 0.02, -0.03, 0.01));
    let off = |edge: Vec2| {
        let (mut observations, _) = scene(&truth, 240, 0.0, true, &mut Random(3));
        for o in &mut observations[40..] {
            o.measurement.pixel.x += 1.5;
            o.measurement = o.measurement.on_edge(edge);
        }
        let found = solve(&truth, &observations).camera_from_world;
        // At a point straight ahead, px.
        let ahead = truth.inverse().transform(&Vec3::new(0.0, 0.0, 2.0));
        let pixel = |pose: &Se3| camera().project(&pose.transform(&ahead));
        (pixel(&found) - pixel(&truth)).norm()
    };
    assert!(off(Vec2::new(0.97, 0.0)) < 0.4);
    // Control: without edges.
    assert!(off(Vec2::zeros()) > 0.8);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// 200 points with 30 % outliers, starting 5 cm and 2 degrees off.
    #[test]
    fn recovers_a_pose_among_outliers(
        truth in twist(2.0, 1.0),
        start in twist(0.05, 0.035),
        seed in any::<u64>(),
        depth in any::<bool>(),
    ) {
        let truth = Se3::exp(&truth);
        let (observations, good) = scene(&truth, 200, 0.3, depth, &mut Random(seed));
        let estimate = solve(&(Se3::exp(&start) * truth), &observations);
        let e = error(&estimate, &truth);
        let (translation, rotation) = (e.fixed_rows::<3>(0).norm(), e.fixed_rows::<3>(3).norm());
        prop_assert!(translation < 0.006 && rotation < 0.004, "{translation} m, {rotation} rad");
        let accepted_wrong = good.iter().zip(&estimate.inliers).filter(|(g, i)| !**g && **i).count();
        let kept = good.iter().zip(&estimate.inliers).filter(|(g, i)| **g && **i).count();
        prop_assert_eq!(accepted_wrong, 0);
        // The gate keeps 95 % of 140; fewer than 118 has odds below one in 10^5.
        prop_assert!(kept >= 118, "kept {}", kept);
        prop_assert_eq!(estimate.inlier_count, estimate.inliers.iter().filter(|i| **i).count());
    }

    #[test]
    fn without_noise_the_pose_is_exact(truth in twist(2.0, 1.0), start in twist(0.05, 0.035), seed in any::<u64>()) {
        let truth = Se3::exp(&truth);
        let (mut observations, _) = scene(&truth, 40, 0.0, true, &mut Random(seed));
        for o in &mut observations {
            let p = truth.transform(&o.point);
            o.measurement = Measurement::new(camera().project(&p), SIGMA_PX, Some((p.z, depth_sigma(p.z))));
        }
        let estimate = solve(&(Se3::exp(&start) * truth), &observations);
        prop_assert!(error(&estimate, &truth).norm() < 1e-6);
        prop_assert_eq!(estimate.inlier_count, 40);
    }

    #[test]
    fn random_observations_have_few_inliers(seed in any::<u64>()) {
        let random = &mut Random(seed);
        let (mut observations, _) = scene(&Se3::identity(), 60, 0.0, true, random);
        for o in &mut observations {
            o.measurement.pixel = Vec2::new(random.within(0.0, 640.0), random.within(0.0, 480.0));
        }
        let estimate = solve(&Se3::identity(), &observations);
        prop_assert!(estimate.inlier_count < 8, "{}", estimate.inlier_count);
    }

    #[test]
    fn same_input_gives_identical_results(seed in any::<u64>()) {
        let (observations, _) = scene(&Se3::identity(), 80, 0.2, true, &mut Random(seed));
        let start = Se3::exp(&Vec6::new(0.02, 0.0, -0.01, 0.01, 0.0, 0.005));
        let (a, b) = (solve(&start, &observations), solve(&start, &observations));
        prop_assert_eq!(a.camera_from_world, b.camera_from_world);
        prop_assert_eq!(a.information, b.information);
        prop_assert_eq!(a.inliers, b.inliers);
    }

    /// Two rays through a point meet there, for any length of their directions.
    #[test]
    fn triangulation_recovers_the_point(
        a in [-2.0..2.0f64, -2.0..2.0, -2.0..2.0],
        b in [-2.0..2.0f64, -2.0..2.0, -2.0..2.0],
        p in [-2.0..2.0f64, -2.0..2.0, 3.0..8.0],
        lengths in [0.1..10.0f64, 0.1..10.0],
    ) {
        let (a, b, p) = (Vec3::from(a), Vec3::from(b), Vec3::from(p));
        let cos = (p - a).normalize().dot(&(p - b).normalize());
        prop_assume!(cos < 0.999_9);
        let t = triangulate_midpoint(&a, &((p - a) * lengths[0]), &b, &((p - b) * lengths[1])).unwrap();
        prop_assert!((t.point - p).norm() < 1e-9);
        prop_assert!((t.cos_parallax - cos).abs() < 1e-12);
    }
}

/// A known position is an additional measurement: errors scaled with the combined information have variance 1 in each
/// of six directions.
#[test]
fn known_position_adds_its_information() {
    let (truth, runs, sigma) = (Se3::identity(), 400, [0.002, 0.000_5, 0.001]);
    let (in_a, random) = (Vec3::new(0.3, -0.2, 0.5), &mut Random(11));
    let information = Mat3::from_diagonal(&Vec3::from(sigma.map(|s: f64| 1.0 / (s * s))));
    let (mut sum, mut alone) = (0.0, 0.0);
    for _ in 0..runs {
        let (observations, _) = scene(&truth, 20, 0.0, true, random);
        let noise = Vec3::from(sigma.map(|s| s * random.normal()));
        let place = KnownPlace {
            in_a,
            in_b: truth.transform(&in_a) + noise,
            information,
        };
        let solve = |place: Option<KnownPlace>| {
            let options = PoseOptions {
                gate_scale: 1e3,
                place,
                ..PoseOptions::default()
            };
            optimise_pose(
                &Intrinsics::from(&camera()),
                &truth,
                &observations,
                &options,
            )
        };
        // Derivative of the point by a left perturbation, by differences.
        let moved = |k: usize| {
            let mut step = Vec6::zeros();
            step[k] = 1e-6;
            (Se3::exp(&step) * truth).transform(&in_a) - truth.transform(&in_a)
        };
        let by_pose =
            nalgebra::Matrix3x6::from_columns(&std::array::from_fn::<_, 6, _>(moved)) / 1e-6;
        let known = by_pose.transpose() * information * by_pose;
        let (with, without) = (solve(Some(place)), solve(None));
        let e = error(&with, &truth);
        sum += e.dot(&((with.information + known) * e));
        let e = error(&without, &truth);
        alone += e.dot(&((without.information + known) * e));
        // The information excludes the known position.
        assert!((with.information - without.information).norm() < 0.1 * without.information.norm());
    }
    let [mean, alone] = [sum, alone].map(|s| s / f64::from(runs));
    assert!((mean - 6.0).abs() < 0.8, "mean {mean}");
    assert!(alone > 1.5 * mean, "control: {alone} against {mean}");
}

#[test]
fn too_few_points_give_no_inliers() {
    let random = &mut Random(3);
    let initial = Se3::exp(&Vec6::new(0.1, 0.2, 0.3, 0.1, 0.2, 0.3));
    for count in 0..3 {
        let (observations, _) = scene(&initial, count, 0.0, true, random);
        let estimate = solve(&initial, &observations);
        assert_eq!(estimate.inlier_count, 0);
        assert_eq!(estimate.inliers, vec![false; count]);
        assert!((estimate.camera_from_world.to_matrix() - initial.to_matrix()).amax() < 1e-15);
        assert_eq!(estimate.information, Mat6::zeros());
    }
}

/// Three contradicting points: without the rejected one too few remain.
#[test]
fn few_contradicting_points_give_no_inliers() {
    let (mut observations, _) = scene(&Se3::identity(), 4, 0.0, true, &mut Random(5));
    let far = [
        Vec2::new(5.0, 400.0),
        Vec2::new(600.0, 30.0),
        Vec2::new(40.0, 20.0),
        Vec2::new(590.0, 460.0),
    ];
    for (o, px) in observations.iter_mut().zip(far) {
        o.measurement = Measurement::new(px, 0.1, Some((40.0, 0.001)));
    }
    let estimate = solve(&Se3::identity(), &observations);
    assert_eq!(estimate.inlier_count, 0);
    assert!(estimate.inliers.iter().all(|i| !i));
    assert!(estimate.camera_from_world.is_finite());
}

#[test]
fn points_behind_the_camera_are_no_inliers() {
    let (mut observations, _) = scene(&Se3::identity(), 30, 0.0, true, &mut Random(9));
    for o in &mut observations[..10] {
        o.point.z = -o.point.z;
    }
    let estimate = solve(&Se3::identity(), &observations);
    assert!(estimate.inliers[..10].iter().all(|i| !i));
    assert!(estimate.inlier_count >= 15);
    assert!(error(&estimate, &Se3::identity()).norm() < 0.02);
}

#[test]
fn rays_not_meeting_in_front_give_no_point() {
    let (a, b) = (Vec3::zeros(), Vec3::x());
    // Parallel, and crossing behind both.
    assert_eq!(triangulate_midpoint(&a, &Vec3::z(), &b, &Vec3::z()), None);
    let (left, right) = (Vec3::new(-1.0, 0.0, 1.0), Vec3::new(1.0, 0.0, 1.0));
    assert_eq!(triangulate_midpoint(&a, &left, &b, &right), None);
    assert_eq!(triangulate_midpoint(&a, &Vec3::zeros(), &b, &right), None);
    // Skew rays: half way between them.
    let t = triangulate_midpoint(&a, &Vec3::z(), &Vec3::new(-1.0, 0.2, 2.0), &Vec3::x()).unwrap();
    assert!((t.point - Vec3::new(0.0, 0.1, 2.0)).norm() < 1e-12);
    assert!(t.cos_parallax.abs() < 1e-12);
}
