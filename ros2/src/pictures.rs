//! Verdicts drawn on the image, and the mask of moving regions. Drawn only while subscribed to.

use crate::outlet::Decided;
use crate::outputs::Outputs;
use crate::record::Recorder;
use std::sync::Arc;
use stillpoint::ros_events::{Publisher, Topic};
use stillpoint::slam::{Event, Subscriber};
use stillpoint::view::{Style, picture, write_jpeg};

/// JPEG quality, percent: marks stay sharp.
const QUALITY: u8 = 80;

/// Draws frames.
pub struct Pictures {
    publisher: Publisher,
    decided: Decided,
    applied: bool,
    outputs: Arc<Outputs>,
    recorder: Option<Recorder>,
    style: Style,
}

impl Pictures {
    /// For a run.
    #[must_use]
    pub fn new(
        publisher: Publisher,
        decided: &Decided,
        outputs: &Arc<Outputs>,
        recorder: Option<Recorder>,
        style: Style,
    ) -> Self {
        Self {
            publisher,
            decided: Arc::clone(decided),
            applied: false,
            outputs: Arc::clone(outputs),
            recorder,
            style,
        }
    }

    fn begin(&mut self) {
        if let Some(mounting) = self.decided.get().filter(|_| !self.applied) {
            self.applied = true;
            self.publisher = mounting.apply(self.publisher.clone());
        }
    }
}

impl Subscriber for Pictures {
    fn receive(&mut self, event: &Event) {
        self.begin();
        let Some(tracked) = event.as_frame() else {
            return;
        };
        let Some(frame) = tracked.frame.as_deref().filter(|_| self.applied) else {
            return;
        };
        self.publisher.at(tracked.report.stamp);
        if self.outputs.has_subscribers(Topic::Image) || self.recorder.is_some() {
            let drawn = picture(frame, &tracked.report, &self.style);
            let mut jpeg = Vec::new();
            if write_jpeg(&drawn, QUALITY, &mut jpeg).is_ok() {
                for message in self.publisher.picture(jpeg) {
                    self.outputs.send(&message);
                    if let Some(recorder) = &self.recorder {
                        recorder.found(&message);
                    }
                }
            }
        }
        if self.outputs.has_subscribers(Topic::Mask) {
            let mask = tracked.report.segments.mask(frame);
            let size = (mask.width() as u32, mask.height() as u32);
            let message = self.publisher.mask(size.0, size.1, mask.data());
            self.outputs.send(&message);
        }
    }
}
