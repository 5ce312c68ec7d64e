//! The thread of detection: what it is shown, and when it rests.

use crate::boxes::{Boxes, QUEUE, Said, TrackingBox};
use crate::health::guarded;
use crate::measure::{Stage, WorkerEnd};
use crate::workers::{Hook, call};
use std::sync::Arc;
use std::time::{Duration, Instant};
use stillpoint_detection::Detector;

/// The detector rests no longer than this.
const LONGEST_REST: Duration = Duration::from_secs(1);

/// What detection is shown, and when it worked last.
pub(crate) struct DetectionBox<T> {
    shown: Option<T>,
    /// It may take one part in so many of the time; all of it with 1.
    rarer: u64,
    /// When it was done last, and how long it had worked.
    last: Option<(Instant, Duration)>,
}

impl<T> Default for DetectionBox<T> {
    fn default() -> Self {
        Self {
            shown: None,
            rarer: 1,
            last: None,
        }
    }
}

impl<T> DetectionBox<T> {
    /// Shows the newest frame, of which the detector is to take one part in so many of the time.
    pub(crate) fn show(&mut self, frame: T, rarer: u64) {
        self.shown = Some(frame);
        self.rarer = rarer;
    }

    /// Hears when the detector was done with a frame, and how long it had worked.
    pub(crate) fn done(&mut self, at: Instant, worked: Duration) {
        self.last = Some((at, worked));
    }

    /// The newest frame, unless the detector is to rest still: then the frame is kept, and may give way to newer ones.
    pub(crate) fn next(&mut self, now: Instant) -> Option<T> {
        let rests = self.last.is_some_and(|(at, worked)| {
            let times = u32::try_from(self.rarer.saturating_sub(1)).unwrap_or(u32::MAX);
            now.saturating_duration_since(at) < worked.saturating_mul(times).min(LONGEST_REST)
        });
        if rests { None } else { self.shown.take() }
    }
}

/// Detection. It tells nobody but tracking, and has no desk: one that hangs would keep the channel of events open forever.
pub(crate) struct DetectionWorker {
    pub(crate) boxes: Arc<Boxes>,
    pub(crate) hook: Option<Hook>,
    pub(crate) detector: Box<dyn Detector>,
}

impl DetectionWorker {
    /// Looks at the newest frame until the stream ends.
    pub(crate) fn run(&mut self) -> WorkerEnd {
        let boxes = Arc::clone(&self.boxes);
        let end = guarded(&boxes, Stage::Detection, || {
            call(self.hook.as_ref(), Stage::Detection);
            while let Some(shown) = boxes.detection.take(|b| b.next(Instant::now())) {
                boxes.begins(Stage::Detection);
                let began = Instant::now();
                let span = tracing::info_span!("detect");
                let answer = span.in_scope(|| self.detector.detect(&shown.frame));
                let worked = began.elapsed();
                boxes.detection.put(|b| b.done(Instant::now(), worked));
                let said = Said {
                    answer,
                    arrived: shown.at,
                };
                let room = |b: &TrackingBox| b.said.len() < QUEUE;
                let told = boxes.tracking.put_when(room, |b| b.said.push_back(said));
                if told.is_none() {
                    break;
                }
                call(self.hook.as_ref(), Stage::Detection);
                boxes.rests(Stage::Detection);
            }
        });
        boxes.detection.close();
        end
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn a_detector_rests_as_long_as_it_is_told() {
        let start = Instant::now();
        let mut shown = DetectionBox::default();
        // The first frame need not wait, nor does any where there is time.
        shown.show(1, 8);
        assert_eq!(shown.next(start), Some(1));
        shown.done(start, 50 * MS);
        shown.show(2, 1);
        assert_eq!(shown.next(start), Some(2));
        shown.done(start, 50 * MS);
        // Three quarters of the time it rests, and then looks at the newest frame.
        for (frame, after) in [(3, 10), (4, 149)] {
            shown.show(frame, 4);
            assert_eq!(shown.next(start + after * MS), None);
        }
        assert_eq!(shown.next(start + 150 * MS), Some(4));
        assert_eq!(shown.next(start + 150 * MS), None);
        // A slow one does not rest for ever.
        shown.done(start, 3000 * MS);
        shown.show(5, 16);
        assert_eq!(shown.next(start + 999 * MS), None);
        assert_eq!(shown.next(start + 1000 * MS), Some(5));
    }
}
