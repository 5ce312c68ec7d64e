//! Rigid motions SE(3).

use crate::{Mat3, Mat6, Vec3, Vec6, so3};
use nalgebra::{Matrix4, UnitQuaternion};
use std::ops::Mul;

/// A rigid motion `x -> rotation * x + translation`, named `a_from_b` when it maps coordinates of b to a.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Se3 {
    /// Rotation part.
    pub rotation: UnitQuaternion<f64>,
    /// Translation part, m.
    pub translation: Vec3,
}

impl Default for Se3 {
    fn default() -> Self {
        Self::identity()
    }
}

impl Se3 {
    /// The identity.
    #[must_use]
    pub fn identity() -> Self {
        Self {
            rotation: UnitQuaternion::identity(),
            translation: Vec3::zeros(),
        }
    }

    /// From its two parts.
    #[must_use]
    pub fn new(rotation: UnitQuaternion<f64>, translation: Vec3) -> Self {
        Self {
            rotation,
            translation,
        }
    }

    /// From a rotation matrix (taken to be orthonormal) and a translation.
    #[must_use]
    pub fn from_matrix(rotation: &Mat3, translation: Vec3) -> Self {
        let r = nalgebra::Rotation3::from_matrix_unchecked(*rotation);
        Self::new(UnitQuaternion::from_rotation_matrix(&r), translation)
    }

    /// The 3x3 rotation matrix.
    #[must_use]
    pub fn rotation_matrix(&self) -> Mat3 {
        self.rotation.to_rotation_matrix().into_inner()
    }

    /// The homogeneous 4x4 matrix.
    #[must_use]
    pub fn to_matrix(&self) -> Matrix4<f64> {
        let mut m = Matrix4::identity();
        m.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&self.rotation_matrix());
        m.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.translation);
        m
    }

    /// The inverse motion: `b_from_a` of `a_from_b`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.inverse();
        Self::new(rotation, -(rotation * self.translation))
    }

    /// Maps a point.
    #[must_use]
    pub fn transform(&self, p: &Vec3) -> Vec3 {
        self.rotation * p + self.translation
    }

    /// Exponential of the twist `[translation; rotation]`.
    #[must_use]
    pub fn exp(twist: &Vec6) -> Self {
        let (rho, w) = (twist.fixed_rows::<3>(0).into(), twist.fixed_rows::<3>(3));
        let w: Vec3 = w.into();
        let rho: Vec3 = rho;
        Self::new(so3::exp(&w), so3::left_jacobian(&w) * rho)
    }

    /// Logarithm: the twist `[translation; rotation]`, rotation norm at most pi.
    #[must_use]
    pub fn log(&self) -> Vec6 {
        let w = so3::log(&self.rotation);
        let rho = so3::left_jacobian_inverse(&w) * self.translation;
        Vec6::new(rho.x, rho.y, rho.z, w.x, w.y, w.z)
    }

    /// The adjoint: `a * exp(t) == exp(a.adjoint() * t) * a`.
    #[must_use]
    pub fn adjoint(&self) -> Mat6 {
        let r = self.rotation_matrix();
        let mut m = Mat6::zeros();
        m.fixed_view_mut::<3, 3>(0, 0).copy_from(&r);
        m.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
        m.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(so3::hat(&self.translation) * r));
        m
    }

    /// The same motion with its quaternion renormalised (after long products).
    #[must_use]
    pub fn normalized(&self) -> Self {
        Self::new(
            UnitQuaternion::new_normalize(self.rotation.into_inner()),
            self.translation,
        )
    }

    /// Interpolates from `self` (`s` = 0) to `other` (1): linear in translation, slerp in rotation.
    #[must_use]
    pub fn interpolate(&self, other: &Self, s: f64) -> Self {
        let delta = so3::log(&(self.rotation.inverse() * other.rotation));
        Self::new(
            self.rotation * so3::exp(&(delta * s)),
            self.translation + (other.translation - self.translation) * s,
        )
    }

    /// True when every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.translation.iter().all(|x| x.is_finite())
            && self.rotation.coords.iter().all(|x| x.is_finite())
    }
}

impl Mul for Se3 {
    type Output = Se3;
    fn mul(self, rhs: Se3) -> Se3 {
        Se3::new(
            UnitQuaternion::new_unchecked(self.rotation.into_inner() * rhs.rotation.into_inner()),
            self.rotation * rhs.translation + self.translation,
        )
    }
}

impl Mul<&Vec3> for &Se3 {
    type Output = Vec3;
    fn mul(self, p: &Vec3) -> Vec3 {
        self.transform(p)
    }
}
