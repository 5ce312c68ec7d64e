//! Replay: runs again what threads and clocks decided, from the log of a run.
//!
//! Answers: what the stages said when they took these messages in this order. The same stages, frames and log give the same
//! events, trajectory and map as the run that left the log, bit for bit; no network is needed, since what the detector said
//! is in the log.

use crate::event::{Event, LoopReport, tell_applied};
use crate::messages::{LooperMsg, LooperOut, MapperMsg, MapperReport, Tracked};
use crate::run_log::{LogEntry, RunLog};
use crate::stages::Stages;
use crate::trajectory::Trajectory;
use std::collections::VecDeque;
use std::sync::Arc;
use stillpoint_imaging::{FrameId, FrameSource, RgbdFrame, SourceError};
use stillpoint_map::{Correction, KeyframeId, Map, MapView};
use stillpoint_place::PlaceIndex;

/// A log cannot be run again.
#[derive(Debug)]
#[non_exhaustive]
pub enum ReplayError {
    /// The log was made with another configuration, camera or first map.
    OtherStages,
    /// The source has no such frame.
    NoFrame {
        /// Number of the entry, from 0.
        entry: usize,
        /// The frame.
        frame: FrameId,
        /// Its colour stamp, s.
        stamp: f64,
    },
    /// The source failed.
    Source(SourceError),
    /// The entry takes a message that nobody sent: these are not the frames or not the program of that run.
    NotSent {
        /// Number of the entry, from 0.
        entry: usize,
        /// What was taken.
        expected: Box<LogEntry>,
        /// What was sent instead, if anything.
        found: Option<Box<LogEntry>>,
    },
    /// All messages were taken, and another trajectory came out.
    OtherTrajectory,
}

impl std::fmt::Display for ReplayError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::OtherStages => write!(
                f,
                "expected the configuration, camera and first map of the run that left the log, found others; use the config.toml beside it"
            ),
            Self::NoFrame {
                entry,
                frame,
                stamp,
            } => write!(
                f,
                "entry {entry}: expected frame {frame} with stamp {stamp:.6} s, found none; use the frames of the run that left the log"
            ),
            Self::Source(e) => e.fmt(f),
            Self::NotSent {
                entry,
                expected,
                found,
            } => {
                write!(f, "entry {entry}: expected {expected:?}, found ")?;
                match found {
                    Some(found) => write!(f, "{found:?}")?,
                    None => write!(f, "no such message")?,
                }
                write!(f, "; use the frames and the program of that run")
            }
            Self::OtherTrajectory => write!(
                f,
                "expected the trajectory of the run that left the log, found another; use the frames and the program of that run"
            ),
        }
    }
}

impl std::error::Error for ReplayError {}

/// Runs a log again.
pub struct Replay {
    stages: Stages,
    log: RunLog,
    /// Number of the next entry.
    at: usize,
    /// What the tracker told the mapper, and was not taken yet.
    for_mapper: VecDeque<MapperMsg>,
    /// What the looper told the mapper, and was not taken yet.
    corrections: VecDeque<Correction>,
    for_looper: VecDeque<LooperMsg>,
    views: Numbered<Arc<MapView>>,
    places: Numbered<PlaceIndex<KeyframeId>>,
    /// The newest version of the map.
    view: Arc<MapView>,
    loops: Vec<LoopReport>,
}

/// Answers by their numbers, of which newer ones replace older ones.
struct Numbered<T> {
    next: u64,
    waiting: VecDeque<(u64, T)>,
}

impl<T> Default for Numbered<T> {
    fn default() -> Self {
        Self {
            next: 0,
            waiting: VecDeque::new(),
        }
    }
}

impl<T> Numbered<T> {
    fn push(&mut self, value: T) {
        self.waiting.push_back((self.next, value));
        self.next += 1;
    }

    /// The answer with this number; those before it are gone then.
    fn take(&mut self, number: u64) -> Option<T> {
        while let Some((n, value)) = self.waiting.pop_front() {
            if n == number {
                return Some(value);
            }
        }
        None
    }
}

impl Replay {
    /// A replay of a log by stages that are as those of the run were before its first frame.
    ///
    /// # Errors
    /// [`ReplayError::OtherStages`] when they are not.
    pub fn new(stages: Stages, log: RunLog) -> Result<Self, ReplayError> {
        if stages.fingerprint() != log.fingerprint {
            return Err(ReplayError::OtherStages);
        }
        Ok(Self {
            view: stages.tracker.view(),
            stages,
            log,
            at: 0,
            for_mapper: VecDeque::new(),
            corrections: VecDeque::new(),
            for_looper: VecDeque::new(),
            views: Numbered::default(),
            places: Numbered::default(),
            loops: Vec::new(),
        })
    }

    /// Carries out the next entry, for which the source is asked if it is a frame, and says what happened; `None` when there
    /// is no further entry. The source yields the frames of the run and may yield others between them.
    ///
    /// # Errors
    /// [`ReplayError`] when the log does not fit the frames. There is no going on after that.
    pub fn step(
        &mut self,
        source: &mut dyn FrameSource,
    ) -> Result<Option<Vec<Event>>, ReplayError> {
        let Some(entry) = self.log.entries.get(self.at).cloned() else {
            return Ok(None);
        };
        let events = self.carry_out(entry, source)?;
        self.at += 1;
        Ok(Some(events))
    }

    /// Carries out all entries that are left, and compares the trajectory with that of the run. Events go to `each`.
    ///
    /// # Errors
    /// [`ReplayError`] when the log does not fit the frames, or the trajectory is another.
    pub fn run(
        &mut self,
        source: &mut dyn FrameSource,
        mut each: impl FnMut(Event),
    ) -> Result<(), ReplayError> {
        while let Some(events) = self.step(source)? {
            events.into_iter().for_each(&mut each);
        }
        if self.trajectory().digest(&self.view) != self.log.trajectory {
            return Err(ReplayError::OtherTrajectory);
        }
        Ok(())
    }

    fn carry_out(
        &mut self,
        entry: LogEntry,
        source: &mut dyn FrameSource,
    ) -> Result<Vec<Event>, ReplayError> {
        let tracker = &mut self.stages.tracker;
        match entry {
            LogEntry::TrackFrame { frame, stamp } => {
                let frame = self.read(frame, stamp, source)?;
                Ok(self.track(&Arc::new(frame)))
            }
            LogEntry::TrackView { answer } => match self.views.take(answer) {
                Some(view) => {
                    tracker.receive(view);
                    Ok(Vec::new())
                }
                None => Err(self.not_sent(entry, None)),
            },
            LogEntry::TrackPlaces { answer } => match self.places.take(answer) {
                Some(places) => {
                    tracker.receive_places(places);
                    Ok(Vec::new())
                }
                None => Err(self.not_sent(entry, None)),
            },
            LogEntry::TrackDetections { next, said } => match said {
                Ok(detections) => {
                    let event = Event::Detected(detections.clone());
                    self.stages.health.receive(&detections);
                    let message = tracker.receive_detections(detections, next);
                    self.for_mapper.extend(message);
                    Ok(vec![event])
                }
                Err(e) => Ok(vec![Event::DetectorFailed(e)]),
            },
            LogEntry::TrackEffort { features } => {
                tracker.set_features(features);
                Ok(Vec::new())
            }
            LogEntry::MapEffort { effort } => {
                self.stages.mapper.set_effort(effort);
                Ok(Vec::new())
            }
            LogEntry::MapKeyframe { .. } | LogEntry::MapRejudge { .. } => {
                let message = self.for_mapper.pop_front();
                self.map(entry, message)
            }
            LogEntry::MapCorrect { .. } => {
                let message = self.corrections.pop_front().map(MapperMsg::Correct);
                self.map(entry, message)
            }
            LogEntry::LoopKeyframe { .. }
            | LogEntry::LoopRejudged { .. }
            | LogEntry::LoopCorrected { .. } => self.look_for_loop(entry),
        }
    }

    /// Reads on to a frame.
    fn read(
        &self,
        frame: FrameId,
        stamp: f64,
        source: &mut dyn FrameSource,
    ) -> Result<RgbdFrame, ReplayError> {
        loop {
            match source.next_frame() {
                Some(Ok(f)) if f.id == frame && f.stamp.to_bits() == stamp.to_bits() => {
                    return Ok(f);
                }
                // Frames that the run dropped, or could not read either.
                Some(Ok(_)) => {}
                Some(Err(e)) if e.recoverable => {}
                Some(Err(e)) => return Err(ReplayError::Source(e)),
                None => {
                    return Err(ReplayError::NoFrame {
                        entry: self.at,
                        frame,
                        stamp,
                    });
                }
            }
        }
    }

    fn track(&mut self, frame: &Arc<RgbdFrame>) -> Vec<Event> {
        let tracked = self.stages.tracker.track(frame);
        let health = self.stages.health.judge(frame, &tracked);
        let Tracked {
            report, keyframe, ..
        } = tracked;
        let message = keyframe.map(|k| MapperMsg::Keyframe(Box::new(k)));
        self.for_mapper.extend(message);
        vec![Event::Frame(report), Event::Health(Box::new(health))]
    }

    fn map(
        &mut self,
        entry: LogEntry,
        message: Option<MapperMsg>,
    ) -> Result<Vec<Event>, ReplayError> {
        let found = message.as_ref().map(LogEntry::from);
        let Some(message) = message.filter(|_| found.as_ref() == Some(&entry)) else {
            return Err(self.not_sent(entry, found));
        };
        let out = self.stages.mapper.step(message);
        if let MapperReport::Corrected(applied) = out.report {
            tell_applied(&mut self.loops, applied);
        }
        self.for_looper.push_back(out.for_looper());
        let event = out.event();
        self.view = Arc::clone(&out.view);
        self.views.push(out.view);
        Ok(event.into_iter().collect())
    }

    fn look_for_loop(&mut self, entry: LogEntry) -> Result<Vec<Event>, ReplayError> {
        let message = self.for_looper.pop_front();
        let found = message.as_ref().and_then(LogEntry::of_looper);
        let Some(message) = message.filter(|_| found.as_ref() == Some(&entry)) else {
            return Err(self.not_sent(entry, found));
        };
        let LooperOut {
            correction,
            report,
            places,
        } = self.stages.looper.step(message);
        self.places.push(places);
        self.corrections.extend(correction);
        self.loops.extend(report.clone());
        Ok(report.map(Event::Looped).into_iter().collect())
    }

    fn not_sent(&self, expected: LogEntry, found: Option<LogEntry>) -> ReplayError {
        ReplayError::NotSent {
            entry: self.at,
            expected: Box::new(expected),
            found: found.map(Box::new),
        }
    }

    /// The frames tracked so far.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        self.stages.tracker.trajectory()
    }

    /// The newest version of the map.
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        Arc::clone(&self.view)
    }

    /// The places that were recognised so far, with what became of them.
    #[must_use]
    pub fn loops(&self) -> &[LoopReport] {
        &self.loops
    }

    /// The map, when the replay is over.
    #[must_use]
    pub fn into_map(self) -> Map {
        self.stages.mapper.into_map()
    }
}
