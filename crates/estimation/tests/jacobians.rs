//! Jacobians compared with central differences, and properties of measurements.

use proptest::prelude::*;
use stillpoint_estimation::{Intrinsics, Measurement, linearise};
use stillpoint_geometry::{Camera, Se3, Vec2, Vec3, Vec6, robust};

const CAMERA: Intrinsics = Intrinsics {
    fx: 520.0,
    fy: 515.0,
    cx: 320.0,
    cy: 240.0,
};

/// A visible point, 0.3 m to 10 m away.
fn point() -> impl Strategy<Value = Vec3> {
    (-0.7..0.7f64, -0.6..0.6f64, 0.3..10.0f64).prop_map(|(x, y, z)| Vec3::new(x * z, y * z, z))
}

/// A measurement with weights 1, so that residuals are in px and 1/m.
fn measurement() -> Measurement {
    Measurement {
        pixel: Vec2::new(300.0, 200.0),
        pixel_weight: 1.0,
        inverse_depth: 0.5,
        inverse_depth_weight: 1.0,
        edge: Vec2::new(0.6, -0.5),
    }
}

fn residual(p: &Vec3) -> Vec3 {
    Vec3::from(linearise(&CAMERA, &measurement(), p).residual)
}

/// Difference relative to the row's size; the derivative of the prediction is minus that of the residual.
fn differs(ahead: &Vec3, behind: &Vec3, step: f64, column: [f64; 3], size: [f64; 3]) -> f64 {
    let numeric = (behind - ahead) / (2.0 * step);
    (0..3)
        .map(|row| (numeric[row] - column[row]).abs() / size[row])
        .fold(0.0, f64::max)
}

proptest! {
    #[test]
    fn point_jacobian_matches_differences(p in point()) {
        let l = linearise(&CAMERA, &measurement(), &p);
        let size = l.by_point.map(|row| row.iter().fold(0.0, |a: f64, v| a.max(v.abs())));
        let step = 1e-6 * p.z;
        for axis in 0..3 {
            let mut d = Vec3::zeros();
            d[axis] = step;
            let column = l.by_point.map(|row| row[axis]);
            let error = differs(&residual(&(p + d)), &residual(&(p - d)), step, column, size);
            prop_assert!(error < 1e-6, "axis {axis}: {error:e}");
        }
    }

    #[test]
    fn pose_jacobian_matches_differences(p in point()) {
        let l = linearise(&CAMERA, &measurement(), &p);
        let size = l.by_pose.map(|row| row.iter().fold(0.0, |a: f64, v| a.max(v.abs())));
        let step = 1e-6 * p.z.min(1.0);
        for axis in 0..6 {
            let mut d = Vec6::zeros();
            d[axis] = step;
            let column = l.by_pose.map(|row| row[axis]);
            let ahead = residual(&Se3::exp(&d).transform(&p));
            let behind = residual(&Se3::exp(&-d).transform(&p));
            let error = differs(&ahead, &behind, step, column, size);
            prop_assert!(error < 1e-6, "axis {axis}: {error:e}");
        }
    }

    /// The squared distance is the sum of weighted residuals, with and without depth.
    #[test]
    fn chi2_is_the_weighted_sum_of_squared_residuals(p in point(), sigma_px in 0.5..4.0f64, depth in 0.5..8.0f64, sigma in 0.001..0.1f64) {
        for depth in [None, Some((depth, sigma))] {
            let m = Measurement::new(Vec2::new(310.0, 250.0), sigma_px, depth);
            let e = linearise(&CAMERA, &m, &p).residual;
            let mut expected = (e[0] * e[0] + e[1] * e[1]) / (sigma_px * sigma_px);
            if let Some((z, sigma)) = depth {
                let in_inverse = sigma / (z * z);
                expected += (e[2] / in_inverse) * (e[2] / in_inverse);
            }
            let got = m.chi2(&CAMERA, &p);
            prop_assert!((got - expected).abs() < 1e-9 * (1.0 + expected));
            prop_assert_eq!(m.has_depth(), depth.is_some());
        }
    }

    /// An exact projection has no residual.
    #[test]
    fn exact_projection_has_zero_residual(p in point()) {
        let camera = Camera::pinhole(640, 480, [520.0, 515.0, 320.0, 240.0]);
        let m = Measurement::new(camera.project(&p), 1.0, Some((p.z, 0.01)));
        let e = linearise(&Intrinsics::from(&camera), &m, &p).residual;
        prop_assert!(e.iter().all(|v| v.abs() < 1e-9));
        prop_assert!(m.chi2(&CAMERA, &p) < 1e-12);
    }
}

#[test]
fn gates_follow_the_degrees_of_freedom() {
    let pixel = Vec2::new(1.0, 2.0);
    assert_eq!(Measurement::new(pixel, 1.0, None).gate(), robust::CHI2_95_2);
    assert_eq!(
        Measurement::new(pixel, 1.0, Some((2.0, 0.01))).gate(),
        robust::CHI2_95_3
    );
}

#[test]
fn point_behind_the_camera_has_infinite_chi2() {
    let m = measurement();
    for z in [0.0, -1.0, 1e-4] {
        assert_eq!(m.chi2(&CAMERA, &Vec3::new(0.1, 0.1, z)), f64::INFINITY);
    }
}
