//! Laws of rotations, rigid motions, cameras, kernels and alignment, on random input.
// Standard-library functions are an independent reference for the crate `libm`.
#![allow(clippy::disallowed_methods)]

use proptest::prelude::*;
use stillpoint_geometry::nalgebra::UnitQuaternion;
use stillpoint_geometry::{
    AlignmentError, BrownConrady, Camera, Se3, Vec2, Vec3, Vec6, align_umeyama, robust, so3,
};

fn vector(size: f64) -> impl Strategy<Value = Vec3> {
    [-size..size, -size..size, -size..size].prop_map(Vec3::from)
}

/// A rotation vector with an angle from 1e-12 to just below pi. The exponent is drawn uniformly, to cover both the
/// series near zero and the closed form.
fn rotation_vector() -> impl Strategy<Value = Vec3> {
    (
        vector(1.0),
        prop_oneof![(-12.0..0.0).prop_map(|e| 10f64.powf(e)), 0.0..3.13],
    )
        .prop_filter("an axis", |(v, _)| v.norm() > 0.1)
        .prop_map(|(v, angle)| v.normalize() * angle)
}

fn twist() -> impl Strategy<Value = Vec6> {
    (vector(5.0), rotation_vector()).prop_map(|(t, w)| Vec6::new(t.x, t.y, t.z, w.x, w.y, w.z))
}

fn motion() -> impl Strategy<Value = Se3> {
    (vector(10.0), rotation_vector()).prop_map(|(t, w)| Se3::new(so3::exp(&w), t))
}

fn close(a: &Se3, b: &Se3, tolerance: f64) -> bool {
    (a.to_matrix() - b.to_matrix()).amax() < tolerance
}

/// The TUM fr1 colour camera: the strongest distortion among the public RGB-D sequences.
pub(crate) fn fr1() -> Camera {
    let mut camera = Camera::pinhole(640, 480, [517.306408, 516.469215, 318.643040, 255.313989]);
    camera.distortion = BrownConrady {
        k1: 0.262383,
        k2: -0.953104,
        p1: -0.005358,
        p2: 0.002628,
        k3: 1.163314,
    };
    camera
}

proptest! {
    #[test]
    fn so3_log_inverts_exp(w in rotation_vector()) {
        let q = so3::exp(&w);
        prop_assert!((so3::log(&q) - w).norm() < 1e-11 * (1.0 + w.norm()));
        prop_assert!((so3::angle(&q) - w.norm()).abs() < 1e-11);
        // q and -q are the same rotation.
        let negated = UnitQuaternion::new_unchecked(-q.into_inner());
        prop_assert!((so3::log(&negated) - w).norm() < 1e-11 * (1.0 + w.norm()));
    }

    /// Independent reference: Rodrigues' formula with sine and cosine of the standard library.
    #[test]
    fn so3_exp_matches_rodrigues_formula(axis in vector(1.0), angle in 0.01..6.0f64) {
        prop_assume!(axis.norm() > 0.1);
        let h = so3::hat(&axis.normalize());
        let expected = h * angle.sin() + h * h * (1.0 - angle.cos());
        let got = so3::exp(&(axis.normalize() * angle)).to_rotation_matrix().into_inner();
        prop_assert!((got - stillpoint_geometry::Mat3::identity() - expected).amax() < 1e-13);
    }

    #[test]
    fn so3_log_is_at_most_half_a_turn(axis in vector(1.0), angle in 3.2..6.2f64) {
        prop_assume!(axis.norm() > 0.1);
        let u = axis.normalize();
        let short = so3::log(&so3::exp(&(u * angle)));
        prop_assert!((short - u * (angle - std::f64::consts::TAU)).norm() < 1e-10);
    }

    #[test]
    fn hat_is_the_cross_product(w in vector(3.0), x in vector(3.0)) {
        prop_assert_eq!(so3::hat(&w) * x, w.cross(&x));
    }

    /// `exp(w + d) = exp(J d) exp(w)` to first order, by central differences along each axis.
    #[test]
    fn left_jacobian_is_the_derivative(w in rotation_vector()) {
        let (j, step) = (so3::left_jacobian(&w), 1e-5);
        for axis in 0..3 {
            let mut d = Vec3::zeros();
            d[axis] = step;
            let inverse = so3::exp(&w).inverse();
            let ahead = so3::log(&(so3::exp(&(w + d)) * inverse));
            let behind = so3::log(&(so3::exp(&(w - d)) * inverse));
            let numeric = (ahead - behind) / (2.0 * step);
            prop_assert!((numeric - j.column(axis)).norm() < 1e-8);
        }
    }

    #[test]
    fn left_jacobian_has_its_inverse(w in rotation_vector()) {
        let product = so3::left_jacobian(&w) * so3::left_jacobian_inverse(&w);
        prop_assert!((product - stillpoint_geometry::Mat3::identity()).amax() < 1e-11);
    }

    #[test]
    fn se3_log_inverts_exp(t in twist()) {
        prop_assert!((Se3::exp(&t).log() - t).norm() < 1e-9);
    }

    #[test]
    fn se3_exp_inverts_log(a in motion()) {
        prop_assert!(close(&Se3::exp(&a.log()), &a, 1e-9));
    }

    /// Steps along one twist add up; this couples translation and rotation of the exponential.
    #[test]
    fn se3_exp_is_a_one_parameter_group(t in twist(), s in -1.0..1.0f64) {
        let whole = Se3::exp(&t);
        let parts = Se3::exp(&(t * s)) * Se3::exp(&(t * (1.0 - s)));
        prop_assert!(close(&whole, &parts, 1e-10));
    }

    #[test]
    fn adjoint_moves_a_twist_to_the_left_side(a in motion(), t in twist()) {
        let left = a * Se3::exp(&t);
        let right = Se3::exp(&(a.adjoint() * t)) * a;
        prop_assert!(close(&left, &right, 1e-9));
    }

    #[test]
    fn composition_is_a_group(a in motion(), b in motion(), c in motion(), p in vector(10.0)) {
        prop_assert!(close(&(a * a.inverse()), &Se3::identity(), 1e-12));
        prop_assert!(close(&(a.inverse() * a), &Se3::identity(), 1e-12));
        prop_assert!(close(&((a * b) * c), &(a * (b * c)), 1e-11));
        prop_assert!(close(&(a * b).inverse(), &(b.inverse() * a.inverse()), 1e-11));
        prop_assert!(((a * b).transform(&p) - a.transform(&b.transform(&p))).norm() < 1e-11);
        prop_assert!((a.inverse().transform(&a.transform(&p)) - p).norm() < 1e-12 * 100.0);
        prop_assert!(((a * b).to_matrix() - a.to_matrix() * b.to_matrix()).amax() < 1e-11);
        let again = Se3::from_matrix(&a.rotation_matrix(), a.translation);
        prop_assert!(close(&a, &again, 1e-12));
    }

    #[test]
    fn interpolation_is_exact_at_its_ends_and_linear(a in motion(), b in motion(), s in 0.0..1.0f64) {
        prop_assert!(close(&a.interpolate(&b, 0.0), &a, 1e-12));
        prop_assert!(close(&a.interpolate(&b, 1.0), &b, 1e-9));
        let m = a.interpolate(&b, s);
        let whole = so3::angle(&(a.rotation.inverse() * b.rotation));
        let part = so3::angle(&(a.rotation.inverse() * m.rotation));
        prop_assert!((part - s * whole).abs() < 1e-9);
        prop_assert!((m.translation - (a.translation * (1.0 - s) + b.translation * s)).norm() < 1e-12 * 100.0);
    }

    #[test]
    fn distortion_round_trips_between_pixels(x in 0.0..639.0f64, y in 0.0..479.0f64) {
        let (camera, raw) = (fr1(), Vec2::new(x, y));
        prop_assert!((camera.distort(camera.undistort(raw)) - raw).norm() < 1e-6);
        prop_assert!((camera.undistort(camera.distort(raw)) - raw).norm() < 1e-6);
    }

    #[test]
    fn projection_inverts_backprojection(x in 0.0..639.0f64, y in 0.0..479.0f64, z in 0.1..20.0f64) {
        let (camera, px) = (fr1(), Vec2::new(x, y));
        let p = camera.backproject(px, z);
        prop_assert!((p.z - z).abs() < 1e-14 * z);
        prop_assert!((camera.project(&p) - px).norm() < 1e-10);
        prop_assert!((camera.project_distorted(&p) - camera.distort(px)).norm() < 1e-10);
        prop_assert!((camera.rectified().project_distorted(&p) - px).norm() < 1e-10);
    }

    #[test]
    fn umeyama_recovers_a_similarity(
        truth in motion(),
        scale in 0.05..20.0f64,
        points in prop::collection::vec(vector(3.0), 6..20),
    ) {
        prop_assume!(spread(&points) > 0.3);
        let target: Vec<Vec3> = points
            .iter()
            .map(|p| truth.rotation * p * scale + truth.translation)
            .collect();
        let found = align_umeyama(&points, &target, true).unwrap();
        prop_assert!((found.scale - scale).abs() < 1e-10 * scale);
        prop_assert!(close(&found.target_from_source, &truth, 1e-8));
        for (p, t) in points.iter().zip(&target) {
            prop_assert!((found.apply(p) - t).norm() < 1e-9 * (1.0 + scale));
        }
        let rigid = align_umeyama(&points, &target, false).unwrap();
        prop_assert_eq!(rigid.scale, 1.0);
        prop_assert!(so3::angle(&(rigid.target_from_source.rotation.inverse() * truth.rotation)) < 1e-8);
    }

    /// No rigid motion maps points to their mirror image, but the result must still be a rotation.
    #[test]
    fn umeyama_never_mirrors(points in prop::collection::vec(vector(3.0), 6..20)) {
        prop_assume!(spread(&points) > 0.3);
        let mirrored: Vec<Vec3> = points.iter().map(|p| Vec3::new(-p.x, p.y, p.z)).collect();
        let found = align_umeyama(&points, &mirrored, true).unwrap();
        let m = found.target_from_source.rotation_matrix();
        prop_assert!((m.determinant() - 1.0).abs() < 1e-9);
        prop_assert!((found.target_from_source.rotation.norm() - 1.0).abs() < 1e-9);
    }

    /// Equal points stay degenerate when their mean is rounded.
    #[test]
    fn umeyama_rejects_coincident_points(
        p in vector(100.0),
        others in prop::collection::vec(vector(3.0), 3..30),
    ) {
        let same = vec![p; others.len()];
        for with_scale in [false, true] {
            prop_assert_eq!(align_umeyama(&same, &others, with_scale), Err(AlignmentError::Degenerate));
            prop_assert_eq!(align_umeyama(&others, &same, with_scale), Err(AlignmentError::Degenerate));
        }
    }

    #[test]
    fn huber_cost_is_continuous_and_its_slope_is_the_weight(chi2 in 0.01..100.0f64, gate in 0.5..12.0f64) {
        let slope_is_weight = |x: f64| {
            let h = 1e-6 * x;
            let slope = (robust::huber_cost(x + h, gate) - robust::huber_cost(x - h, gate)) / (2.0 * h);
            (slope - robust::huber_weight(x, gate)).abs()
        };
        prop_assert!(slope_is_weight(chi2) < 1e-5);
        let (below, above) = (gate * (1.0 - 1e-12), gate * (1.0 + 1e-12));
        prop_assert!((robust::huber_cost(above, gate) - robust::huber_cost(below, gate)).abs() < 1e-9);
        prop_assert!((robust::huber_weight(above, gate) - robust::huber_weight(below, gate)).abs() < 1e-9);
        prop_assert!(robust::huber_cost(chi2, gate) <= chi2 * (1.0 + 1e-12));
        prop_assert!(robust::huber_weight(chi2, gate) <= 1.0);
    }
}

fn spread(points: &[Vec3]) -> f64 {
    let n = points.len() as f64;
    let mean = points.iter().fold(Vec3::zeros(), |a, p| a + p) / n;
    let c = points
        .iter()
        .fold(stillpoint_geometry::Mat3::zeros(), |a, p| {
            a + (p - mean) * (p - mean).transpose() / n
        });
    c.symmetric_eigenvalues().min().max(0.0).sqrt()
}

#[test]
fn lens_distortion_round_trips_over_the_whole_image() {
    let camera = fr1();
    let mut moved = 0.0f64;
    for y in (0..480).step_by(3).chain([479]) {
        for x in (0..640).step_by(3) {
            let px = Vec2::new(f64::from(x), f64::from(y));
            let flat = camera.undistort(px);
            moved = moved.max((flat - px).norm());
            assert!((camera.distort(flat) - px).norm() < 1e-6, "raw {px}");
            let bent = camera.distort(px);
            assert!(
                (camera.undistort(bent) - px).norm() < 1e-6,
                "undistorted {px}"
            );
        }
    }
    assert!(moved > 5.0, "the lens bends: {moved} px");
}

#[test]
fn undistorted_bounds_contain_the_image() {
    let camera = fr1();
    let [x0, y0, x1, y1] = camera.undistorted_bounds();
    for y in (0..480).step_by(7).chain([479]) {
        for x in (0..640).step_by(7).chain([639]) {
            let q = camera.undistort(Vec2::new(f64::from(x), f64::from(y)));
            // The border is sampled every ten pixels: between samples it may bulge by a few hundredths.
            assert!(q.x >= x0 - 0.05 && q.x <= x1 + 0.05 && q.y >= y0 - 0.05 && q.y <= y1 + 0.05);
        }
    }
    let flat = camera.rectified().undistorted_bounds();
    assert_eq!(flat, [0.0, 0.0, 639.0, 479.0]);
}

#[test]
fn undistorted_camera_moves_no_pixel() {
    let camera = fr1().rectified();
    let px = Vec2::new(12.25, 470.5);
    assert_eq!(camera.distort(px), px);
    assert_eq!(camera.undistort(px), px);
    assert!(camera.contains(Vec2::new(639.0, 479.0)));
    assert!(!camera.contains(Vec2::new(639.1, 0.0)));
    assert!(!camera.contains(Vec2::new(0.0, -0.1)));
    assert!(!camera.contains(Vec2::new(f64::NAN, 0.0)));
}

#[test]
fn umeyama_rejects_degenerate_input() {
    let p = [
        Vec3::new(0.0, 0.0, 0.0),
        Vec3::new(1.0, 0.0, 0.0),
        Vec3::new(0.0, 1.0, 0.0),
    ];
    assert!(align_umeyama(&p, &p, true).is_ok());
    assert_eq!(
        align_umeyama(&p[..2], &p[..2], true),
        Err(AlignmentError::TooFewPairs)
    );
    assert_eq!(
        align_umeyama(&p, &p[..2], false),
        Err(AlignmentError::TooFewPairs)
    );
    assert_eq!(
        align_umeyama(&[], &[], false),
        Err(AlignmentError::TooFewPairs)
    );
    for bad in [f64::NAN, f64::INFINITY] {
        let mut q = p;
        q[1].y = bad;
        assert_eq!(align_umeyama(&p, &q, true), Err(AlignmentError::Degenerate));
        assert_eq!(align_umeyama(&q, &p, true), Err(AlignmentError::Degenerate));
    }
}

/// Integrates the chi-square density from 0 to `x` with Simpson's rule. With `x = t^2` the density of one degree of
/// freedom loses its pole at zero.
fn chi_square_probability(degrees: i32, x: f64) -> f64 {
    let k = f64::from(degrees);
    let density = |t: f64| {
        2.0 * t.powi(degrees - 1) * (-0.5 * t * t).exp()
            / (2f64.powf(0.5 * k) * libm::tgamma(0.5 * k))
    };
    let (n, end) = (2000, x.sqrt());
    let h = end / f64::from(n);
    let inner: f64 = (1..n)
        .map(|i| density(f64::from(i) * h) * if i % 2 == 1 { 4.0 } else { 2.0 })
        .sum();
    (density(0.0) + inner + density(end)) * h / 3.0
}

#[test]
fn chi2_gates_are_the_stated_quantiles() {
    for (degrees, p, quantile) in [
        (1, 0.95, robust::CHI2_95_1),
        (2, 0.95, robust::CHI2_95_2),
        (3, 0.95, robust::CHI2_95_3),
    ] {
        let error = chi_square_probability(degrees, quantile) - p;
        assert!(
            error.abs() < 1e-11,
            "{degrees} degrees of freedom, {p}: off by {error:e}"
        );
    }
}
