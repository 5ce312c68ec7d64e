//! Sensor samples between frames.

use std::sync::Arc;

/// Data with a stamp.
pub trait Stamped {
    /// Stamp, s.
    fn stamp(&self) -> f64;
}

/// Samples in temporal order, handed out frame by frame.
#[derive(Clone, Debug)]
pub struct SampleTrack<T> {
    samples: Arc<[T]>,
    next: usize,
}

impl<T> Default for SampleTrack<T> {
    fn default() -> Self {
        Self {
            samples: Arc::default(),
            next: 0,
        }
    }
}

impl<T: Stamped + Clone> SampleTrack<T> {
    /// Samples must be in temporal order.
    #[must_use]
    pub fn new(samples: Arc<[T]>) -> Self {
        Self { samples, next: 0 }
    }

    /// Drops samples older than `stamp`, s.
    pub fn skip_before(&mut self, stamp: f64) {
        let first = self.samples.partition_point(|s| s.stamp() < stamp);
        self.next = self.next.max(first);
    }

    /// The remaining samples up to `stamp`, s, and one after it, to interpolate at `stamp`.
    pub fn take_until(&mut self, stamp: f64) -> Vec<T> {
        let after = self.samples.partition_point(|s| s.stamp() < stamp);
        let end = (after + 1).min(self.samples.len());
        let taken = self
            .samples
            .get(self.next..end)
            .map_or_else(Vec::new, <[T]>::to_vec);
        self.next = self.next.max(end);
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ImuSample;

    fn track(stamps: &[f64]) -> SampleTrack<ImuSample> {
        let sample = |stamp: &f64| ImuSample {
            stamp: *stamp,
            ..ImuSample::default()
        };
        SampleTrack::new(stamps.iter().map(sample).collect())
    }

    fn stamps(taken: &[ImuSample]) -> Vec<f64> {
        taken.iter().map(|s| s.stamp).collect()
    }

    #[test]
    fn samples_are_taken_once_up_to_one_after_the_frame() {
        let mut track = track(&[0.0, 1.0, 2.0, 3.0, 4.0]);
        assert_eq!(stamps(&track.take_until(1.5)), [0.0, 1.0, 2.0]);
        assert!(track.take_until(1.8).is_empty());
        assert_eq!(stamps(&track.take_until(3.0)), [3.0]);
        assert_eq!(stamps(&track.take_until(9.0)), [4.0]);
        assert!(track.take_until(9.0).is_empty());
    }

    #[test]
    fn samples_before_the_first_frame_are_skipped() {
        let mut track = track(&[0.0, 1.0, 2.0, 3.0]);
        track.skip_before(1.5);
        assert_eq!(stamps(&track.take_until(2.5)), [2.0, 3.0]);
    }
}
