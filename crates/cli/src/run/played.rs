//! Wrappers between a source and a driver.

use crate::run::stop::Stop;
use crate::timing::Timing;
use std::time::Instant;
use stillpoint::imaging::{FrameSource, ImuSample, OdometrySample, RgbdFrame, SourceError};

type Item = Result<RgbdFrame, SourceError>;

/// Measures the reading time of a source, on its thread.
pub(crate) struct Reading<S> {
    source: S,
    timing: &'static Timing,
}

impl<S: FrameSource> Reading<S> {
    pub(crate) fn new(source: S, timing: &'static Timing) -> Self {
        Self { source, timing }
    }
}

impl<S: FrameSource> FrameSource for Reading<S> {
    fn next_frame(&mut self) -> Option<Item> {
        let next = tracing::info_span!("read").in_scope(|| self.source.next_frame());
        self.timing.end_round();
        next
    }

    fn take_inertial(&mut self) -> Vec<ImuSample> {
        self.source.take_inertial()
    }

    fn take_odometry(&mut self) -> Vec<OdometrySample> {
        self.source.take_odometry()
    }

    fn remaining(&self) -> Option<usize> {
        self.source.remaining()
    }

    fn is_live(&self) -> bool {
        self.source.is_live()
    }
}

/// Longest time between two frames that is waited for, s, as in the driver for cameras.
const LONGEST_GAP: f64 = 5.0;

/// Measures whether frames are ready at camera time.
#[derive(Default)]
struct Pace {
    /// A moment and the stamp that corresponds to it.
    anchor: Option<(Instant, f64)>,
    last: f64,
    late: Vec<f64>,
}

impl Pace {
    fn came(&mut self, stamp: f64, now: Instant) {
        let gap = stamp - self.last;
        self.last = stamp;
        match self.anchor {
            Some((at, first)) if (0.0..=LONGEST_GAP).contains(&gap) => {
                let late = now.duration_since(at).as_secs_f64() - (stamp - first);
                self.late.push(late.max(0.0));
            }
            _ => self.anchor = Some((now, stamp)),
        }
    }
}

/// A source played as a camera: measures the lateness of frames, and ends when a sink stops the run.
pub(crate) struct Watched<'a> {
    source: &'a mut dyn FrameSource,
    stop: Stop,
    timing: &'static Timing,
    pace: Pace,
}

impl<'a> Watched<'a> {
    pub(crate) fn new(
        source: &'a mut dyn FrameSource,
        stop: &Stop,
        timing: &'static Timing,
    ) -> Self {
        Self {
            source,
            stop: stop.clone(),
            timing,
            pace: Pace::default(),
        }
    }

    /// Lateness of frames relative to their stamps, s, for each frame but the first.
    pub(crate) fn late(&self) -> &[f64] {
        &self.pace.late
    }
}

impl FrameSource for Watched<'_> {
    fn next_frame(&mut self) -> Option<Item> {
        if self.stop.requested() {
            return None;
        }
        let next = tracing::info_span!("wait").in_scope(|| self.source.next_frame());
        // Ends the timing round, which holds the waiting time.
        self.timing.end_round();
        if let Some(Ok(frame)) = &next
            && !self.source.is_live()
        {
            self.pace.came(frame.stamp, Instant::now());
        }
        next
    }

    fn take_inertial(&mut self) -> Vec<ImuSample> {
        self.source.take_inertial()
    }

    fn take_odometry(&mut self) -> Vec<OdometrySample> {
        self.source.take_odometry()
    }

    fn remaining(&self) -> Option<usize> {
        self.source.remaining()
    }

    fn is_live(&self) -> bool {
        self.source.is_live()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;
    use stillpoint::imaging::{DepthImage, FrameId, GrayImage};

    struct Numbers(u32);

    impl FrameSource for Numbers {
        fn next_frame(&mut self) -> Option<Item> {
            self.0 += 1;
            Some(Ok(RgbdFrame {
                id: FrameId(self.0),
                stamp: f64::from(self.0),
                depth_stamp: f64::from(self.0),
                gray: GrayImage::new(1, 1),
                colour: None,
                depth: DepthImage::default(),
            }))
        }
    }

    #[test]
    fn stop_request_ends_the_stream() {
        let (mut numbers, stop) = (Numbers(0), Stop::default());
        let timing: &'static Timing = Box::leak(Box::default());
        let mut source = Watched::new(&mut numbers, &stop, timing);
        assert!(source.next_frame().is_some());
        stop.request();
        assert!(source.next_frame().is_none());
        assert_eq!(source.late().len(), 0);
    }

    #[test]
    fn late_frames_are_distinguished_from_stamp_gaps() {
        let mut pace = Pace::default();
        let start = Instant::now();
        for (stamp, ms) in [
            (100.0, 0),
            (100.5, 100),
            (101.0, 1250),
            (300.0, 1250),
            (300.5, 1800),
        ] {
            pace.came(stamp, start + Duration::from_millis(ms));
        }
        let late: Vec<u32> = pace.late.iter().map(|s| (s * 1e3).round() as u32).collect();
        assert_eq!(late, [0, 250, 50]);
    }
}
