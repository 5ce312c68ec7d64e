//! What odometry beside the camera measures between frames.

use crate::samples::{SampleTrack, Stamped};

/// Where a base is by its wheels: the pose `odom_from_base`. Only motions between two samples mean something: the frame of reference is wherever the wheels began to count, and drifts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OdometrySample {
    /// When it was there, s, by the stamps of the frames but for the odometry's time offset.
    pub stamp: f64,
    /// Where the base is, m.
    pub position: [f64; 3],
    /// How it stands: a quaternion x y z w that turns its axes to those of the odometry.
    pub orientation: [f64; 4],
    /// Standard deviations of place, m, and direction, rad, about each axis, since the wheels began to count; none where the source knows none. What they grow by is what a motion
    /// errs by, if that is more than the odometry's own figures say.
    pub sigmas: Option<[f64; 2]>,
}

impl Default for OdometrySample {
    /// Where the wheels began to count.
    fn default() -> Self {
        Self {
            stamp: 0.0,
            position: [0.0; 3],
            orientation: [0.0, 0.0, 0.0, 1.0],
            sigmas: None,
        }
    }
}

impl OdometrySample {
    /// By how much the length of an orientation may differ from 1: it is written with some digits.
    pub const LENGTH_TOLERANCE: f64 = 1e-3;

    /// Whether it is a pose: of numbers, with an orientation of length 1.
    #[must_use]
    pub fn is_pose(&self) -> bool {
        let sigmas = self.sigmas.unwrap_or_default();
        let values = self.position.iter().chain(&sigmas);
        let finite = self.stamp.is_finite() && values.into_iter().all(|v| v.is_finite());
        finite && (self.length() - 1.0).abs() <= Self::LENGTH_TOLERANCE
    }

    /// The length of the orientation.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.orientation.iter().map(|q| q * q).sum::<f64>().sqrt()
    }
}

impl Stamped for OdometrySample {
    fn stamp(&self) -> f64 {
        self.stamp
    }
}

/// Samples of odometry, of which a source gives those that belong to a frame.
pub type OdometryTrack = SampleTrack<OdometrySample>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_pose_is_no_sample() {
        let good = OdometrySample::default();
        assert!(good.is_pose());
        let mut sample = good;
        sample.position[1] = f64::INFINITY;
        assert!(!sample.is_pose());
        let sigmas = Some([0.1, f64::NAN]);
        assert!(!OdometrySample { sigmas, ..good }.is_pose());
        for w in [0.0, 0.9, 2.0, f64::NAN] {
            let orientation = [0.0, 0.0, 0.0, w];
            assert!(
                !OdometrySample {
                    orientation,
                    ..good
                }
                .is_pose()
            );
        }
    }
}
