//! A motion that is known from elsewhere: its rotation, as by a gyroscope, or all of it, as by odometry.

use crate::{Intrinsics, MotionPair};
use stillpoint_geometry::nalgebra::UnitQuaternion;
use stillpoint_geometry::{Se3, Vec3, so3};

/// The rotation of a motion `b_from_a`, and by how much it may be wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownTurn {
    /// The rotation.
    pub b_from_a: UnitQuaternion<f64>,
    /// Standard deviation about each axis, rad.
    pub sigma: f64,
    /// A motion that turns otherwise by more is not that of the camera, rad.
    pub gate: f64,
    /// The translation, where that is known as well.
    pub shift: Option<KnownShift>,
}

/// The translation of a motion `b_from_a`, and by how much it may be wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownShift {
    /// The translation, m.
    pub b_from_a: Vec3,
    /// Standard deviation along each axis, m.
    pub sigma: f64,
    /// A motion that moves otherwise by more is not that of the camera, m.
    pub gate: f64,
}

impl KnownTurn {
    /// The rotation vector that is to be applied from the left to bring a motion to this turn, rad.
    #[must_use]
    pub fn offset(&self, b_from_a: &Se3) -> Vec3 {
        so3::log(&(self.b_from_a * b_from_a.rotation.inverse()))
    }

    /// Whether a motion may be the camera's.
    #[must_use]
    pub fn allows(&self, b_from_a: &Se3) -> bool {
        let shifts = |s: &KnownShift| self.shift_offset(s, b_from_a).norm() <= s.gate;
        self.offset(b_from_a).norm() <= self.gate && self.shift.as_ref().is_none_or(shifts)
    }

    /// What is to be added from the left to bring a motion to this one once it turns so, m: where the two see the origin of `b`.
    pub(crate) fn shift_offset(&self, shift: &KnownShift, b_from_a: &Se3) -> Vec3 {
        let turn = self.b_from_a * b_from_a.rotation.inverse();
        shift.b_from_a - turn * b_from_a.translation
    }

    /// The motion that turns so and brings three points to where they were seen; in the mean, as their depths are noisy.
    pub(crate) fn with_shift(&self, points: &[Vec3; 3], seen: &[Vec3; 3]) -> Se3 {
        let shift = |i: usize| seen[i] - self.b_from_a * points[i];
        Se3::new(self.b_from_a, (shift(0) + shift(1) + shift(2)) / 3.0)
    }
}

/// Where the ray of a pair's pixel goes, at depth 1.
pub(crate) fn ray(camera: &Intrinsics, pair: &MotionPair) -> Vec3 {
    let px = pair.measurement.pixel;
    Vec3::new(
        (px.x - camera.cx) / camera.fx,
        (px.y - camera.cy) / camera.fy,
        1.0,
    )
}
