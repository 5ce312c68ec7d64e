//! Prior on a motion: its rotation, as from a gyroscope, or all of it, as from odometry.

use crate::{Intrinsics, MotionPair};
use stillpoint_geometry::nalgebra::UnitQuaternion;
use stillpoint_geometry::{Se3, Vec3, so3};

/// A known rotation of a motion `b_from_a`, with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownTurn {
    /// The rotation.
    pub b_from_a: UnitQuaternion<f64>,
    /// Standard deviation about each axis, rad.
    pub sigma: f64,
    /// Maximum deviation of a motion's rotation, rad.
    pub gate: f64,
    /// The translation, if known as well.
    pub shift: Option<KnownShift>,
}

/// A known translation of a motion `b_from_a`, with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownShift {
    /// The translation, m.
    pub b_from_a: Vec3,
    /// Standard deviation along each axis, m.
    pub sigma: f64,
    /// Maximum deviation of a motion's translation, m.
    pub gate: f64,
}

impl KnownTurn {
    /// The left rotation vector from a motion to the known rotation, rad.
    #[must_use]
    pub fn offset(&self, b_from_a: &Se3) -> Vec3 {
        so3::log(&(self.b_from_a * b_from_a.rotation.inverse()))
    }

    /// Whether a motion is within the gates.
    #[must_use]
    pub fn allows(&self, b_from_a: &Se3) -> bool {
        let shifts = |s: &KnownShift| self.shift_offset(s, b_from_a).norm() <= s.gate;
        self.offset(b_from_a).norm() <= self.gate && self.shift.as_ref().is_none_or(shifts)
    }

    /// Translation error after correcting the rotation from the left, m: the difference in the position of the origin
    /// of `a`.
    pub(crate) fn shift_offset(&self, shift: &KnownShift, b_from_a: &Se3) -> Vec3 {
        let turn = self.b_from_a * b_from_a.rotation.inverse();
        shift.b_from_a - turn * b_from_a.translation
    }

    /// The motion with the known rotation that maps three points to their observed positions on average.
    pub(crate) fn with_shift(&self, points: &[Vec3; 3], seen: &[Vec3; 3]) -> Se3 {
        let shift = |i: usize| seen[i] - self.b_from_a * points[i];
        Se3::new(self.b_from_a, (shift(0) + shift(1) + shift(2)) / 3.0)
    }
}

/// The ray of a pair's pixel, at depth 1.
pub(crate) fn ray(camera: &Intrinsics, pair: &MotionPair) -> Vec3 {
    let px = pair.measurement.pixel;
    Vec3::new(
        (px.x - camera.cx) / camera.fx,
        (px.y - camera.cy) / camera.fy,
        1.0,
    )
}
