//! Who listens to a session: what counts, writes, draws, and says how far it is.
//!
//! Answers: how those that write to files stop a run that cannot be written any more. Each is a subscriber of its own: inline and in a
//! replay they are called one after the other, in a live run each has a queue and a thread.

use crate::console::{self, Progress};
use crate::failure::Failure;
use crate::run::tally::Tally;
use crate::timing::Timing;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use stillpoint::imaging::FrameId;
use stillpoint::live::Watch;
use stillpoint::slam::{Event, Outcome, Subscriber};

/// The wish of a listener that the run ends, since it cannot go on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stop(Arc<AtomicBool>);

impl Stop {
    pub(crate) fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    pub(crate) fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Writes what events say.
pub(crate) trait Writer {
    /// Writes what is to be written of an event.
    fn write(&mut self, event: &Event) -> Result<(), Failure>;
}

/// A writer that listens. After it failed once it writes no more, and asks that the run ends.
pub(crate) struct Listening<W> {
    writer: W,
    failed: Option<Failure>,
    stop: Stop,
}

impl<W> Listening<W> {
    pub(crate) fn new(writer: W, stop: &Stop) -> Self {
        Self {
            writer,
            failed: None,
            stop: stop.clone(),
        }
    }

    /// The writer, or why it could not write.
    pub(crate) fn finish(self) -> Result<W, Failure> {
        self.failed.map_or(Ok(self.writer), Err)
    }
}

impl<W: Writer> Subscriber for Listening<W> {
    fn receive(&mut self, event: &Event) {
        if self.failed.is_some() {
            return;
        }
        if let Err(failure) = self.writer.write(event) {
            self.failed = Some(failure);
            self.stop.request();
        }
    }
}

/// A subscriber with a thread of its own: what it takes for an event is measured as a round of that thread.
pub(crate) struct Rounds<S> {
    pub(crate) subscriber: S,
    pub(crate) timing: &'static Timing,
}

impl<S: Subscriber> Subscriber for Rounds<S> {
    fn receive(&mut self, event: &Event) {
        self.subscriber.receive(event);
        self.timing.end_round();
    }
}

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

/// Who listens to a run in one thread, in this order.
pub(crate) struct Listeners<W> {
    pub(crate) tally: Tally,
    pub(crate) writers: W,
    pub(crate) progress: ProgressLine,
}

impl<W: Subscriber> Subscriber for Listeners<W> {
    fn receive(&mut self, event: &Event) {
        self.tally.receive(event);
        self.writers.receive(event);
        self.progress.receive(event);
    }
}

impl<W> Listeners<W> {
    /// Counts a frame that could not be read, and says so.
    pub(crate) fn skip(&mut self, reason: &dyn std::fmt::Display) {
        self.tally.skip(reason);
        self.progress.skipped.fetch_add(1, Ordering::Relaxed);
    }
}
