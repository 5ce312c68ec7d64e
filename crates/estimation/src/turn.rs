//! A rotation that is known from elsewhere, as by a gyroscope.

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
        self.offset(b_from_a).norm() <= self.gate
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
