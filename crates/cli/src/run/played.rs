//! What passes between a source and a driver that takes its frames in its own time.

use crate::failure::Failure;
use crate::run::overlay::OverlayFolder;
use crate::run::priority;
use crate::timing::Timing;
use std::collections::VecDeque;
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;
use stillpoint::imaging::{FrameId, FrameSource, RgbdFrame, SourceError};
use stillpoint::live::Stage;
use stillpoint::slam::FrameReport;

type Item = Result<RgbdFrame, SourceError>;

/// Measures what a source takes, on the thread that reads it.
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

    fn remaining(&self) -> Option<usize> {
        self.source.remaining()
    }
}

/// The frames that went to a driver, and of which it has said nothing yet.
pub(crate) struct Passing {
    /// Every so many frames a copy is kept, to be drawn; none without pictures.
    every: Option<usize>,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    frames: VecDeque<(FrameId, Option<RgbdFrame>)>,
    arrived: usize,
    dropped: usize,
    closed: bool,
    pace: Pace,
}

/// Longest time between two frames that is waited for, s, as the driver for cameras has it.
const LONGEST_GAP: f64 = 5.0;

/// Whether frames are there when a camera would have them.
#[derive(Default)]
struct Pace {
    /// A moment and the stamp that it stands for.
    anchor: Option<(Instant, f64)>,
    last: f64,
    /// By how much each frame came too late, s.
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

impl Passing {
    /// With copies of every so many frames.
    pub(crate) fn new(every: Option<usize>) -> Self {
        let state = Mutex::default();
        Self { every, state }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets no further frame in.
    pub(crate) fn close(&self) {
        self.lock().closed = true;
    }

    fn enter(&self, frame: &RgbdFrame) {
        let mut state = self.lock();
        let wanted = self.every.is_some_and(|n| state.arrived.is_multiple_of(n));
        let kept = wanted.then(|| frame.clone());
        state.frames.push_back((frame.id, kept));
        state.arrived += 1;
        state.pace.came(frame.stamp, Instant::now());
    }

    /// By how much frames came later than their stamps say, s, one per frame but the first.
    pub(crate) fn late(&self) -> Vec<f64> {
        self.lock().pace.late.clone()
    }

    /// The driver has reported on a frame, and so never will on those before it. Returns its copy, if one was kept.
    pub(crate) fn leave(&self, id: FrameId) -> Option<RgbdFrame> {
        let mut state = self.lock();
        while let Some((passed, kept)) = state.frames.pop_front() {
            if passed == id {
                return kept;
            }
            state.dropped += 1;
        }
        None
    }

    /// A frame that was refused is not one that was dropped. One of the same number may still be on its way.
    pub(crate) fn refused(&self, id: FrameId) {
        let mut state = self.lock();
        let last = state.frames.iter().rposition(|(passed, _)| *passed == id);
        last.map(|i| state.frames.remove(i));
    }

    /// Frames of which nothing was said, up to the last that something was said of.
    pub(crate) fn dropped(&self) -> usize {
        self.lock().dropped
    }

    /// A source whose frames pass here.
    pub(crate) fn watch<'a>(&'a self, source: &'a mut dyn FrameSource) -> Watched<'a> {
        let passing = self;
        Watched { source, passing }
    }
}

/// See [`Passing::watch`].
pub(crate) struct Watched<'a> {
    source: &'a mut dyn FrameSource,
    passing: &'a Passing,
}

impl FrameSource for Watched<'_> {
    fn next_frame(&mut self) -> Option<Item> {
        if self.passing.lock().closed {
            return None;
        }
        let next = tracing::info_span!("wait").in_scope(|| self.source.next_frame());
        if let Some(Ok(frame)) = &next {
            self.passing.enter(frame);
        }
        next
    }

    fn remaining(&self) -> Option<usize> {
        self.source.remaining()
    }
}

/// Pictures that wait to be drawn, at most: some 20 MB.
const PICTURES: usize = 8;

/// Draws pictures on a thread of its own, so that frames still arrive in time meanwhile.
pub(crate) struct Drawing {
    sender: SyncSender<(RgbdFrame, FrameReport)>,
    thread: JoinHandle<Result<OverlayFolder, Failure>>,
    /// Whether pictures are waited for when there is no more room. Else they are left out.
    patient: bool,
    left_out: usize,
}

impl Drawing {
    /// Begins to draw into a folder.
    pub(crate) fn start(mut folder: OverlayFolder, patient: bool) -> Result<Self, Failure> {
        let (sender, receiver) = sync_channel::<(RgbdFrame, FrameReport)>(PICTURES);
        let thread = std::thread::Builder::new().name("drawing".to_owned());
        let thread = thread.spawn(move || {
            // As what else is not urgent.
            priority::lower(Stage::Looping);
            for (frame, report) in receiver {
                tracing::info_span!("overlay").in_scope(|| folder.add(&frame, &report))?;
            }
            Ok(folder)
        });
        Ok(Self {
            sender,
            thread: thread.map_err(Failure::thread)?,
            patient,
            left_out: 0,
        })
    }

    /// Has a frame drawn. False when drawing has failed: [`Drawing::finish`] says why.
    pub(crate) fn draw(&mut self, frame: RgbdFrame, report: &FrameReport) -> bool {
        let picture = (frame, report.clone());
        if self.patient {
            return self.sender.send(picture).is_ok();
        }
        match self.sender.try_send(picture) {
            Ok(()) => true,
            Err(TrySendError::Full(_)) => {
                self.left_out += 1;
                true
            }
            Err(TrySendError::Disconnected(_)) => false,
        }
    }

    /// Waits for the pictures. Returns the folder, and how many were left out.
    pub(crate) fn finish(self) -> Result<(OverlayFolder, usize), Failure> {
        drop(self.sender);
        let drawn = self.thread.join();
        let folder = drawn.unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        Ok((folder, self.left_out))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;
    use stillpoint::imaging::{DepthImage, GrayImage};

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
    fn frames_of_which_nothing_is_said_were_dropped() {
        let passing = Passing::new(Some(2));
        let mut numbers = Numbers(0);
        let mut source = passing.watch(&mut numbers);
        for _ in 0..6 {
            source.next_frame();
        }
        // 1, 3 and 5 were kept.
        assert_eq!(passing.leave(FrameId(1)).unwrap().id, FrameId(1));
        assert!(passing.leave(FrameId(2)).is_none());
        assert_eq!(passing.dropped(), 0);
        assert_eq!(passing.leave(FrameId(5)).unwrap().id, FrameId(5));
        assert_eq!(passing.dropped(), 2);
        passing.refused(FrameId(6));
        source.next_frame();
        passing.leave(FrameId(7));
        assert_eq!(passing.dropped(), 2);
        passing.close();
        assert!(source.next_frame().is_none());
    }

    #[test]
    fn frames_that_come_too_late_are_told_from_gaps_in_the_stamps() {
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
