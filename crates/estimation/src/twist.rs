//! Derivatives on SE(3), for twists `[translation; rotation]`.

use stillpoint_geometry::{Mat3, Mat6, Vec3, Vec6, so3};

/// The inverse of the left Jacobian of SE(3): `log(exp(d) exp(x)) ~ x + left_jacobian_inverse(x) d` (Barfoot, Furgale,
/// "Associating uncertainty with three-dimensional poses for use in estimation problems", T-RO 2014, equations 100 to
/// 102).
pub(crate) fn left_jacobian_inverse(x: &Vec6) -> Mat6 {
    let (rho, phi) = (Vec3::new(x[0], x[1], x[2]), Vec3::new(x[3], x[4], x[5]));
    let j = so3::left_jacobian_inverse(&phi);
    let mut m = Mat6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(&j);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(&j);
    m.fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(-(j * coupling(&rho, &phi) * j)));
    m
}

/// The inverse of the right Jacobian: `log(exp(x) exp(d)) ~ x + right_jacobian_inverse(x) d`.
pub(crate) fn right_jacobian_inverse(x: &Vec6) -> Mat6 {
    left_jacobian_inverse(&-x)
}

/// The upper right block Q of the left Jacobian.
fn coupling(rho: &Vec3, phi: &Vec3) -> Mat3 {
    let (p, f) = (so3::hat(rho), so3::hat(phi));
    let t2 = phi.norm_squared();
    // The quotients are 0/0 at zero; the first omitted term of the series is below 1e-12.
    let (a, b, c) = if t2 < 1e-2 {
        (
            1.0 / 6.0 - t2 / 120.0 + t2 * t2 / 5040.0,
            -1.0 / 24.0 + t2 / 720.0 - t2 * t2 / 40320.0,
            -1.0 / 120.0 + t2 / 5040.0 - t2 * t2 / 362_880.0,
        )
    } else {
        let t = t2.sqrt();
        let (sin, cos) = libm::sincos(t);
        (
            (t - sin) / (t2 * t),
            (1.0 - 0.5 * t2 - cos) / (t2 * t2),
            (t - sin - t2 * t / 6.0) / (t2 * t2 * t),
        )
    };
    let (fp, pf) = (f * p, p * f);
    let fpf = fp * f;
    p * 0.5 + (fp + pf + fpf) * a
        - (f * fp + pf * f - fpf * 3.0) * b
        - (fpf * f + f * fpf) * (0.5 * (b - 3.0 * c))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use stillpoint_geometry::Se3;

    proptest! {
        /// Compared with central differences, at small and large angles.
        #[test]
        fn se3_jacobians_match_numerical_derivatives(x in prop::array::uniform6(-1.0..1.0f64), scale in 0.0..1.7f64) {
            let x = Vec6::from(x) * scale;
            let (left, right) = (left_jacobian_inverse(&x), right_jacobian_inverse(&x));
            let step = 1e-5;
            for k in 0..6 {
                let mut d = Vec6::zeros();
                d[k] = step;
                let at = |d: Vec6| (Se3::exp(&d) * Se3::exp(&x)).log();
                let numeric = (at(d) - at(-d)) / (2.0 * step);
                prop_assert!((numeric - left.column(k)).amax() < 1e-8, "{}", numeric - left.column(k));
                let at = |d: Vec6| (Se3::exp(&x) * Se3::exp(&d)).log();
                let numeric = (at(d) - at(-d)) / (2.0 * step);
                prop_assert!((numeric - right.column(k)).amax() < 1e-8);
            }
        }

        /// The series meets the closed form.
        #[test]
        fn series_and_closed_form_are_continuous(x in prop::array::uniform6(-1.0..1.0f64)) {
            let x = Vec6::from(x);
            let norm = Vec3::new(x[3], x[4], x[5]).norm();
            prop_assume!(norm > 1e-3);
            let near = |t: f64| left_jacobian_inverse(&(x * (t / norm)));
            prop_assert!((near(0.1 - 1e-13) - near(0.1 + 1e-13)).amax() < 1e-9 / norm);
        }
    }
}
