//! The rotation group SO(3): hat operator, exponential and logarithm (Solà, Deray, Atchuthan,
//! "A micro Lie theory for state estimation in robotics", 2018, section on SO(3)).

use crate::{Mat3, Vec3};
use nalgebra::{Quaternion, UnitQuaternion};

/// The skew-symmetric matrix of `w`, so that `hat(w) * x == w.cross(&x)`.
#[must_use]
pub fn hat(w: &Vec3) -> Mat3 {
    Mat3::new(0.0, -w.z, w.y, w.z, 0.0, -w.x, -w.y, w.x, 0.0)
}

/// The rotation of the rotation vector `w` (axis times angle, rad).
#[must_use]
pub fn exp(w: &Vec3) -> UnitQuaternion<f64> {
    let angle2 = w.norm_squared();
    // sin(a/2)/a and cos(a/2), by series near zero where the quotient is 0/0.
    let (s, c) = if angle2 < 1e-10 {
        (0.5 - angle2 / 48.0, 1.0 - angle2 / 8.0)
    } else {
        let angle = angle2.sqrt();
        (libm::sin(0.5 * angle) / angle, libm::cos(0.5 * angle))
    };
    UnitQuaternion::new_normalize(Quaternion::new(c, s * w.x, s * w.y, s * w.z))
}

/// The rotation vector (rad, norm at most pi) of a rotation.
#[must_use]
pub fn log(q: &UnitQuaternion<f64>) -> Vec3 {
    let (v, mut w) = (q.imag(), q.w);
    let mut sign = 1.0;
    if w < 0.0 {
        (w, sign) = (-w, -1.0);
    }
    let n2 = v.norm_squared();
    let factor = if n2 < 1e-14 {
        2.0 / w - 2.0 * n2 / (3.0 * w * w * w)
    } else {
        let n = n2.sqrt();
        2.0 * libm::atan2(n, w) / n
    };
    v * (sign * factor)
}

/// Rotation angle in rad, in [0, pi].
#[must_use]
pub fn angle(q: &UnitQuaternion<f64>) -> f64 {
    2.0 * libm::atan2(q.imag().norm(), q.w.abs())
}

/// The left Jacobian of SO(3): `exp(w + d) ~ exp(left_jacobian(w) * d) * exp(w)`.
#[must_use]
pub fn left_jacobian(w: &Vec3) -> Mat3 {
    let angle2 = w.norm_squared();
    let h = hat(w);
    let (a, b) = if angle2 < 1e-8 {
        (0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0)
    } else {
        let angle = angle2.sqrt();
        (
            (1.0 - libm::cos(angle)) / angle2,
            (angle - libm::sin(angle)) / (angle2 * angle),
        )
    };
    Mat3::identity() + h * a + h * h * b
}

/// The inverse of [`left_jacobian`], in closed form; defined for angles below 2 pi.
#[must_use]
pub fn left_jacobian_inverse(w: &Vec3) -> Mat3 {
    let angle2 = w.norm_squared();
    let h = hat(w);
    let c = if angle2 < 1e-8 {
        1.0 / 12.0 + angle2 / 720.0
    } else {
        let angle = angle2.sqrt();
        let half = 0.5 * angle;
        (1.0 - half * libm::cos(half) / libm::sin(half)) / angle2
    };
    Mat3::identity() - h * 0.5 + h * h * c
}
