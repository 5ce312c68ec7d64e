//! What is said while frames go by: how far the run is, and why the camera is lost.

use crate::console::{self, Progress};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use stillpoint::imaging::FrameId;
use stillpoint::live::Watch;
use stillpoint::slam::{Event, Outcome, Subscriber};

/// The progress line.
pub(crate) struct ProgressLine {
    progress: Progress,
    frames: usize,
    without_pose: usize,
    /// Frames that could not be read or were refused.
    skipped: Arc<AtomicUsize>,
    /// In a live run, how it is.
    watch: Option<Watch>,
}

impl ProgressLine {
    /// Of a run over so many frames.
    pub(crate) fn new(frames: Option<usize>) -> Self {
        Self {
            progress: Progress::new(frames),
            frames: 0,
            without_pose: 0,
            skipped: Arc::default(),
            watch: None,
        }
    }

    /// Of a live run: it tells how the run is instead of drawing a bar. Of frames it may see only the newest.
    pub(crate) fn of_live(frames: Option<usize>, watch: Watch) -> Self {
        Self {
            progress: Progress::new(frames).without_bar(),
            watch: Some(watch),
            ..Self::new(frames)
        }
    }

    /// Counts the frames that could not be read.
    pub(crate) fn skipped(&self) -> Arc<AtomicUsize> {
        Arc::clone(&self.skipped)
    }

    /// Removes the line.
    pub(crate) fn finish(&self) {
        self.progress.finish();
    }
}

impl Subscriber for ProgressLine {
    fn receive(&mut self, event: &Event) {
        let Some(frame) = event.as_frame() else {
            self.skipped.fetch_add(
                usize::from(matches!(event, Event::Refused(_))),
                Ordering::Relaxed,
            );
            return;
        };
        self.frames += 1;
        let lost = matches!(frame.report.outcome, Outcome::Lost { .. });
        self.without_pose += usize::from(lost);
        let (mut done, mut note) = (self.frames, String::new());
        let health = self.watch.as_ref().map(Watch::health);
        if let Some(health) = &health {
            done = health.tracked as usize + health.dropped as usize;
            if health.dropped > 0 {
                note += &format!(", {} dropped", health.dropped);
            }
        }
        match &health {
            // Of a live run it sees the newest frames only, and cannot count; how things stand says whether the camera is lost.
            Some(health) => note += &format!(" | {health}"),
            None if self.without_pose > 0 => note += &format!(", {} lost", self.without_pose),
            None => {}
        }
        done += self.skipped.load(Ordering::Relaxed);
        self.progress.show(done, &note);
    }
}

/// Time after which it is said why the camera is lost, s.
const TELL_LOSS: f64 = 1.0;

/// Says why the camera is lost, once, when that lasts.
#[derive(Default)]
pub(crate) struct LossLine {
    /// The last loss that was reported.
    reported: Option<FrameId>,
}

impl Subscriber for LossLine {
    fn receive(&mut self, event: &Event) {
        if let Some(frame) = event.as_frame()
            && let Some(loss) = &frame.health.loss
            && loss.seconds >= TELL_LOSS
            && self.reported != Some(loss.since)
        {
            self.reported = Some(loss.since);
            console::warn(&loss.to_string());
        }
    }
}
