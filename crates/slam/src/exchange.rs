//! The stages of one run and the messages between them.
//!
//! Owns the stages and their inboxes, executes one run-log entry at a time and returns its event. The order of entries
//! comes from a schedule in [`System`](crate::System), from a log in [`Replay`](crate::Replay), and from threads in a
//! live run, which has its own inboxes but the same [`routing`].

use crate::event::Event;
use crate::gate::RefusedFrame;
use crate::loops::Loops;
use crate::messages::{LoopCloserMsg, MapperMsg};
use crate::report::LoopReport;
use crate::routing;
use crate::run_log::LogEntry;
use crate::stages::{MapUse, Stages, StartError};
use crate::subscriber::Subscriber;
use crate::timing::Timing;
use crate::trajectory::Trajectory;
use std::collections::VecDeque;
use std::sync::Arc;
use stillpoint_detection::{DetectError, Detections};
use stillpoint_imaging::{FrameId, RgbdFrame, Workers};
use stillpoint_map::{Correction, KeyframeId, Map, MapView};
use stillpoint_place::PlaceIndex;

/// An entry takes a message that was not sent.
#[derive(Clone, Debug, PartialEq)]
pub struct NotSent {
    /// The entry to execute.
    pub expected: Box<LogEntry>,
    /// The next message in that inbox, if any.
    pub found: Option<Box<LogEntry>>,
}

impl std::fmt::Display for NotSent {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "expected {:?}, found ", self.expected)?;
        match &self.found {
            Some(found) => write!(f, "{found:?}"),
            None => write!(f, "no such message"),
        }
    }
}

impl std::error::Error for NotSent {}

/// The stages of one run with their inboxes.
///
/// | a stage takes | it may send | to |
/// |---|---|---|
/// | tracker: a frame | a keyframe | mapper |
/// | | a revocation of the beginning of the map | mapper |
/// | tracker: the end of the stream | a revocation of the beginning of the map | mapper |
/// | tracker: detections | verdicts on an earlier keyframe | mapper |
/// | tracker: samples of an inertial sensor, or of odometry | nothing | |
/// | mapper: any message | a view of the map | tracker |
/// | | its report | loop closer |
/// | loop closer: any message | the place index | tracker |
/// | | a correction | mapper |
pub struct Exchange {
    stages: Stages,
    for_mapper: VecDeque<MapperMsg>,
    corrections: VecDeque<Correction>,
    for_loop_closer: VecDeque<LoopCloserMsg>,
    views: Numbered<Arc<MapView>>,
    places: Numbered<PlaceIndex<KeyframeId>>,
    view: Arc<MapView>,
    loops: Loops,
}

/// Numbered replies; taking one discards the older ones.
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

    /// Takes the reply with this number and drops all earlier ones.
    fn take(&mut self, number: u64) -> Option<T> {
        while let Some((n, value)) = self.waiting.pop_front() {
            if n == number {
                return Some(value);
            }
        }
        None
    }
}

impl From<Stages> for Exchange {
    fn from(stages: Stages) -> Self {
        Self {
            view: stages.tracker.view(),
            stages,
            for_mapper: VecDeque::new(),
            corrections: VecDeque::new(),
            for_loop_closer: VecDeque::new(),
            views: Numbered::default(),
            places: Numbered::default(),
            loops: Loops::default(),
        }
    }
}

impl Exchange {
    /// Shares the work on a frame among threads, see [`Tracker::with_workers`](crate::Tracker::with_workers). Call
    /// before the first frame.
    #[must_use]
    pub fn with_workers(self, workers: Workers) -> Self {
        Self::from(self.stages.with_workers(workers))
    }

    /// Starts from an existing map, see [`Stages::with_map`]. Call before the first frame.
    ///
    /// # Errors
    /// [`StartError`] if places of that map cannot be recognised.
    pub fn with_map(self, map: Map, map_use: MapUse) -> Result<Self, StartError> {
        Ok(Self::from(self.stages.with_map(map, map_use)?))
    }

    /// Admits or refuses the next frame. Call before anything else is done with a frame.
    ///
    /// # Errors
    /// As [`FrameGate::admit`](crate::FrameGate::admit).
    pub fn admit(&mut self, frame: &RgbdFrame) -> Result<(), RefusedFrame> {
        self.stages.gate.admit(frame)
    }

    /// Executes one entry: a stage takes a message, and its replies go to the inboxes of their receivers. Returns the
    /// event, if any. `frame` is required for [`LogEntry::TrackFrame`] only.
    ///
    /// # Errors
    /// [`NotSent`] if the message is not the next in that stage's inbox. Then nothing was taken, except views and
    /// places older than the one named.
    pub fn take(
        &mut self,
        entry: &LogEntry,
        frame: Option<&Arc<RgbdFrame>>,
    ) -> Result<Option<Event>, NotSent> {
        let event = match entry {
            LogEntry::TrackFrame { .. } => Some(self.track(entry, frame)?),
            LogEntry::TrackDetections { next, said } => {
                Some(self.receive_detections(said.clone(), *next))
            }
            LogEntry::TrackView { answer } => {
                let view = self.views.take(*answer);
                let view = view.ok_or_else(|| not_sent(entry, None))?;
                self.stages.tracker.receive(view);
                None
            }
            LogEntry::TrackPlaces { answer } => {
                let places = self.places.take(*answer);
                let places = places.ok_or_else(|| not_sent(entry, None))?;
                self.stages.tracker.receive_places(places);
                None
            }
            LogEntry::TrackInertial { samples } => {
                self.stages.tracker.receive_inertial(samples);
                None
            }
            LogEntry::TrackOdometry { samples } => {
                self.stages.tracker.receive_odometry(samples);
                None
            }
            LogEntry::TrackEnd => {
                let Stages {
                    tracker, retracer, ..
                } = &mut self.stages;
                self.for_mapper.extend(routing::finish(tracker, retracer));
                None
            }
            LogEntry::TrackEffort { features } => {
                self.stages.tracker.set_features(*features);
                None
            }
            LogEntry::MapEffort { effort } => {
                self.stages.mapper.set_effort(*effort);
                None
            }
            LogEntry::MapKeyframe { .. }
            | LogEntry::MapRejudge { .. }
            | LogEntry::MapRevoke { .. } => {
                let message = take_named(&mut self.for_mapper, entry, |m| Some(m.into()))?;
                Some(self.build_map(message))
            }
            LogEntry::MapCorrect { .. } => {
                let named = |c: &Correction| Some(LogEntry::of_correction(c));
                let correction = take_named(&mut self.corrections, entry, named)?;
                Some(self.build_map(MapperMsg::Correct(correction)))
            }
            LogEntry::LoopKeyframe { .. }
            | LogEntry::LoopRejudged { .. }
            | LogEntry::LoopRevoked { .. }
            | LogEntry::LoopCorrected { .. } => {
                let message =
                    take_named(&mut self.for_loop_closer, entry, LogEntry::of_loop_closer)?;
                self.look_for_loop(message)
            }
        };
        event.iter().for_each(|e| self.loops.receive(e));
        Ok(event)
    }

    fn track(
        &mut self,
        entry: &LogEntry,
        frame: Option<&Arc<RgbdFrame>>,
    ) -> Result<Event, NotSent> {
        let found = frame.map(|f| LogEntry::of_frame(f));
        let frame = frame.filter(|_| found.as_ref() == Some(entry));
        let frame = frame.ok_or_else(|| not_sent(entry, found))?;
        let Stages {
            tracker,
            retracer,
            health,
            ..
        } = &mut self.stages;
        let (event, keyframe) = routing::track(tracker, retracer, health, frame);
        let about_earlier = routing::retrace(tracker, retracer);
        self.for_mapper
            .extend(keyframe.into_iter().chain(about_earlier));
        Ok(event)
    }

    fn receive_detections(
        &mut self,
        said: Result<Detections, DetectError>,
        next: FrameId,
    ) -> Event {
        let Stages {
            tracker,
            retracer,
            health,
            ..
        } = &mut self.stages;
        let (event, message) = routing::detections(tracker, retracer, health, said, next);
        self.for_mapper.extend(message);
        event
    }

    fn build_map(&mut self, message: MapperMsg) -> Event {
        let out = self.stages.mapper.step(message);
        self.for_loop_closer.push_back(out.for_loop_closer());
        self.view = Arc::clone(&out.view);
        self.views.push(Arc::clone(&out.view));
        out.into_event()
    }

    fn look_for_loop(&mut self, message: LoopCloserMsg) -> Option<Event> {
        let out = self.stages.loop_closer.step(message);
        self.places.push(out.places);
        self.corrections.extend(out.correction);
        out.report.map(|report| Event::Looped(Box::new(report)))
    }

    /// Entry for the mapper's next message from the tracker, if one is queued.
    #[must_use]
    pub fn next_for_mapper(&self) -> Option<LogEntry> {
        self.for_mapper.front().map(LogEntry::from)
    }

    /// Entry for the mapper's next correction, if one is queued.
    #[must_use]
    pub fn next_correction(&self) -> Option<LogEntry> {
        self.corrections.front().map(LogEntry::of_correction)
    }

    /// Entry for the loop closer's next message, if one is queued.
    #[must_use]
    pub fn next_for_loop_closer(&self) -> Option<LogEntry> {
        self.for_loop_closer
            .front()
            .and_then(LogEntry::of_loop_closer)
    }

    /// Entry that ends the stream for the tracker, or `None` if that has no effect.
    #[must_use]
    pub fn end_of_tracking(&self) -> Option<LogEntry> {
        let on_the_way = self.stages.retracer.is_on_the_way();
        on_the_way.then_some(LogEntry::TrackEnd)
    }

    /// Number of views sent to the tracker; the newest has this number less one.
    #[must_use]
    pub fn views_sent(&self) -> u64 {
        self.views.next
    }

    /// Number of place indices sent to the tracker; the newest has this number less one.
    #[must_use]
    pub fn places_sent(&self) -> u64 {
        self.places.next
    }

    /// The stages.
    #[must_use]
    pub fn stages(&self) -> &Stages {
        &self.stages
    }

    /// All tracked frames.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        self.stages.tracker.trajectory()
    }

    /// The newest version of the map, which the tracker may not have received yet.
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        Arc::clone(&self.view)
    }

    /// All loop candidates and their outcomes, in keyframe order.
    #[must_use]
    pub fn loops(&self) -> &[LoopReport] {
        self.loops.reports()
    }

    /// Estimated exposure timing.
    #[must_use]
    pub fn timing(&self) -> Timing {
        self.stages.tracker.timing()
    }

    /// The mapper's map, of which [`Exchange::view`] is a view.
    #[must_use]
    pub fn map(&self) -> &Map {
        self.stages.mapper.map()
    }

    /// The map at the end of the run.
    #[must_use]
    pub fn into_map(self) -> Map {
        self.stages.mapper.into_map()
    }
}

/// Takes the first message of an inbox if it is the one named by the entry.
fn take_named<M>(
    inbox: &mut VecDeque<M>,
    entry: &LogEntry,
    name: impl Fn(&M) -> Option<LogEntry>,
) -> Result<M, NotSent> {
    let found = inbox.front().and_then(name);
    let message = match found.as_ref() == Some(entry) {
        true => inbox.pop_front(),
        false => None,
    };
    message.ok_or_else(|| not_sent(entry, found))
}

fn not_sent(expected: &LogEntry, found: Option<LogEntry>) -> NotSent {
    NotSent {
        expected: Box::new(expected.clone()),
        found: found.map(Box::new),
    }
}

#[cfg(test)]
mod tests;
