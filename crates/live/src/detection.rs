//! The detection thread.

use crate::boxes::{Boxes, QUEUE, Said, TrackingBox};
use crate::health::guarded;
use crate::measure::{Stage, WorkerEnd};
use crate::workers::{Hook, call};
use std::sync::Arc;
use std::time::Instant;
use stillpoint_detection::Detector;

/// Sends only to tracking, and does not publish events: a hanging detector would keep the event channel open forever.
pub(crate) struct DetectionWorker {
    pub(crate) boxes: Arc<Boxes>,
    pub(crate) hook: Option<Hook>,
    pub(crate) detector: Box<dyn Detector>,
}

impl DetectionWorker {
    /// Processes the newest frame until the stream ends.
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
                    frame: shown.frame.id,
                    answer,
                    arrived: shown.at,
                };
                let room = |b: &TrackingBox| b.said.len() < QUEUE;
                let handed_over = boxes.tracking.put_when(room, |b| b.said.push_back(said));
                if handed_over.is_none() {
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
