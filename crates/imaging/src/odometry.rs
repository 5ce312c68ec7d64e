//! Wheel odometry samples between frames.

use crate::samples::{SampleTrack, Stamped};

/// Pose of a base by its wheels, `odom_from_base`. Only motions between two samples are meaningful: the frame of
/// reference is arbitrary and drifts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OdometrySample {
    /// Stamp, s, on the clock of the frames except for the odometry's time offset.
    pub stamp: f64,
    /// Position of the base, m.
    pub position: [f64; 3],
    /// Orientation of the base: a quaternion x y z w that rotates its axes to those of the odometry.
    pub orientation: [f64; 4],
    /// Standard deviations of position, m, and rotation, rad, about each axis, accumulated since the odometry started;
    /// `None` if unknown. Their increase is the error of a motion, if larger than the model's own figures.
    pub sigmas: Option<[f64; 2]>,
}

impl Default for OdometrySample {
    /// The origin of the odometry.
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
    /// Tolerance of the length 1 of an orientation, to allow for rounded text.
    pub const LENGTH_TOLERANCE: f64 = 1e-3;

    /// Whether all values are finite and the orientation has length 1.
    #[must_use]
    pub fn is_pose(&self) -> bool {
        let sigmas = self.sigmas.unwrap_or_default();
        let values = self.position.iter().chain(&sigmas);
        let finite = self.stamp.is_finite() && values.into_iter().all(|v| v.is_finite());
        finite && (self.length() - 1.0).abs() <= Self::LENGTH_TOLERANCE
    }

    /// Norm of the orientation.
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

/// Odometry samples, handed out frame by frame.
pub type OdometryTrack = SampleTrack<OdometrySample>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_odometry_sample_is_rejected() {
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
