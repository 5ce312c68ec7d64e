//! What an inertial sensor beside the camera measures between frames.

/// One reading of a gyroscope and an accelerometer, in the axes of the sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImuSample {
    /// When it was taken, s, by the stamps of the frames but for the sensor's time offset.
    pub stamp: f64,
    /// Angular rate, rad/s.
    pub angular_rate: [f64; 3],
    /// Specific force, m/s^2: of a sensor at rest that of gravity, upwards.
    pub specific_force: [f64; 3],
}

impl ImuSample {
    /// Whether all of it are numbers.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let values = self.angular_rate.iter().chain(&self.specific_force);
        self.stamp.is_finite() && values.into_iter().all(|v| v.is_finite())
    }
}

/// Samples in order of time, of which a source gives those that belong to a frame.
#[derive(Clone, Debug, Default)]
pub struct ImuTrack {
    samples: std::sync::Arc<[ImuSample]>,
    next: usize,
}

impl ImuTrack {
    /// Samples in order of time.
    #[must_use]
    pub fn new(samples: std::sync::Arc<[ImuSample]>) -> Self {
        Self { samples, next: 0 }
    }

    /// Leaves out what is older than `stamp`, s.
    pub fn skip_before(&mut self, stamp: f64) {
        let first = self.samples.partition_point(|s| s.stamp < stamp);
        self.next = self.next.max(first);
    }

    /// What was not taken yet up to `stamp`, s, and one sample after it: between both lies the angular rate at the frame.
    pub fn take_until(&mut self, stamp: f64) -> Vec<ImuSample> {
        let after = self.samples.partition_point(|s| s.stamp < stamp);
        let end = (after + 1).min(self.samples.len());
        let taken = self
            .samples
            .get(self.next..end)
            .map_or_else(Vec::new, <[ImuSample]>::to_vec);
        self.next = self.next.max(end);
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(stamps: &[f64]) -> ImuTrack {
        let sample = |stamp: &f64| ImuSample {
            stamp: *stamp,
            ..ImuSample::default()
        };
        ImuTrack::new(stamps.iter().map(sample).collect())
    }

    fn stamps(taken: &[ImuSample]) -> Vec<f64> {
        taken.iter().map(|s| s.stamp).collect()
    }

    #[test]
    fn every_sample_is_taken_once_and_one_lies_behind_the_frame() {
        let mut track = track(&[0.0, 1.0, 2.0, 3.0, 4.0]);
        assert_eq!(stamps(&track.take_until(1.5)), [0.0, 1.0, 2.0]);
        assert!(track.take_until(1.8).is_empty());
        assert_eq!(stamps(&track.take_until(3.0)), [3.0]);
        assert_eq!(stamps(&track.take_until(9.0)), [4.0]);
        assert!(track.take_until(9.0).is_empty());
    }

    #[test]
    fn what_is_before_the_first_frame_is_left_out() {
        let mut track = track(&[0.0, 1.0, 2.0, 3.0]);
        track.skip_before(1.5);
        assert_eq!(stamps(&track.take_until(2.5)), [2.0, 3.0]);
    }

    #[test]
    fn what_is_no_number_is_no_sample() {
        let mut sample = ImuSample::default();
        assert!(sample.is_finite());
        sample.specific_force[2] = f64::NAN;
        assert!(!sample.is_finite());
    }
}
