//! Inertial samples between frames.

use crate::samples::{SampleTrack, Stamped};

/// One reading of a gyroscope and an accelerometer, in the axes of the sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImuSample {
    /// Stamp, s, on the clock of the frames except for the sensor's time offset.
    pub stamp: f64,
    /// Angular rate, rad/s.
    pub angular_rate: [f64; 3],
    /// Specific force, m/s^2: at rest it points up with the magnitude of gravity.
    pub specific_force: [f64; 3],
}

impl ImuSample {
    /// True when all values are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let values = self.angular_rate.iter().chain(&self.specific_force);
        self.stamp.is_finite() && values.into_iter().all(|v| v.is_finite())
    }
}

impl Stamped for ImuSample {
    fn stamp(&self) -> f64 {
        self.stamp
    }
}

/// Inertial samples, handed out frame by frame.
pub type ImuTrack = SampleTrack<ImuSample>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn non_finite_inertial_sample_is_invalid() {
        let mut sample = ImuSample::default();
        assert!(sample.is_finite());
        sample.specific_force[2] = f64::NAN;
        assert!(!sample.is_finite());
    }
}
