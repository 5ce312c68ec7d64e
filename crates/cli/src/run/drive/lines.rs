//! Messages during a run: its progress, and why tracking is lost.

use crate::console::{self, Progress};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use stillpoint::imaging::FrameId;
use stillpoint::live::Watch;
use stillpoint::slam::{Event, Outcome, Subscriber};

pub(crate) struct ProgressLine {
    progress: Progress,
    frames: usize,
    without_pose: usize,
    skipped: Arc<AtomicUsize>,
    /// The state of a live run.
    watch: Option<Watch>,
}

impl ProgressLine {
    pub(crate) fn new(frames: Option<usize>) -> Self {
        Self {
            progress: Progress::new(frames),
            frames: 0,
            without_pose: 0,
            skipped: Arc::default(),
            watch: None,
        }
    }

    /// For a live run: prints its state instead of a bar. It may see only the newest frames.
    pub(crate) fn of_live(frames: Option<usize>, watch: Watch) -> Self {
        Self {
            progress: Progress::new(frames).without_bar(),
            watch: Some(watch),
            ..Self::new(frames)
        }
    }

    /// The count of unreadable frames, to be updated by the caller.
    pub(crate) fn skipped(&self) -> Arc<AtomicUsize> {
        Arc::clone(&self.skipped)
    }

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
            // In a live run it sees only the newest frames and cannot count; the state says whether tracking is lost.
            Some(health) => note += &format!(" | {health}"),
            None if self.without_pose > 0 => note += &format!(", {} lost", self.without_pose),
            None => {}
        }
        done += self.skipped.load(Ordering::Relaxed);
        self.progress.show(done, &note);
    }
}

/// Duration of a loss after which its reason is printed, s.
const TELL_LOSS: f64 = 1.0;

/// Prints why tracking is lost, once per loss.
#[derive(Default)]
pub(crate) struct LossLine {
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
