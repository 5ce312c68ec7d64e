//! The inline driver: every stage in one thread, every reply after a fixed number of frames.

use crate::config::{Config, Schedule};
use crate::event::Event;
use crate::exchange::Exchange;
use crate::report::LoopReport;
use crate::run_log::{LogEntry, RunLog};
use crate::stages::{MapUse, Stages, StartError};
use crate::timing::Timing;
use crate::trajectory::{Trajectory, TrajectoryEntry};
use crate::validation::ConfigError;
use std::collections::VecDeque;
use std::sync::Arc;
use stillpoint_detection::{Detection, Detections, Detector};
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::{FrameId, ImuSample, OdometrySample, RgbdFrame, Simd, Workers};
use stillpoint_map::{Map, MapView};

/// RGB-D SLAM, driven frame by frame. The same frames, configuration and seed give the same result, bit for bit.
///
/// It is an [`Exchange`] with a schedule: at every frame it carries out the entries that are due.
pub struct System {
    exchange: Exchange,
    schedule: Schedule,
    /// Views that the tracker is to take, by their numbers.
    views: Due<u64>,
    /// Places that the tracker is to take, by their numbers.
    places: Due<u64>,
    /// Corrections that the mapper is to take.
    corrections: Due<()>,
    /// What the detector said.
    detections: Due<Detections>,
    detector: Option<Box<dyn Detector>>,
    detector_stride: u64,
    /// Frames taken.
    step: u64,
    /// What was carried out, when that is wanted.
    log: Option<Vec<LogEntry>>,
}

/// What waits until its step comes, in the order in which it came.
struct Due<T>(VecDeque<(u64, T)>);

impl<T> Default for Due<T> {
    fn default() -> Self {
        Self(VecDeque::new())
    }
}

impl<T> Due<T> {
    fn push(&mut self, step: u64, value: T) {
        self.0.push_back((step, value));
    }

    /// The next one that is due at this step.
    fn pop(&mut self, now: u64) -> Option<T> {
        self.0.front().filter(|(due, _)| *due <= now)?;
        self.0.pop_front().map(|(_, value)| value)
    }
}

/// The step at which everything is due: the largest number of a step, by definition.
const END: u64 = u64::MAX;

impl From<Stages> for System {
    /// The inline driver for these stages.
    fn from(stages: Stages) -> Self {
        Self {
            schedule: stages.config().schedule,
            detector_stride: u64::from(stages.config().detector.stride),
            exchange: Exchange::from(stages),
            views: Due::default(),
            places: Due::default(),
            corrections: Due::default(),
            detections: Due::default(),
            detector: None,
            step: 0,
            log: None,
        }
    }
}

impl System {
    /// A system for one camera.
    ///
    /// # Errors
    /// [`ConfigError`] when a field is out of range.
    pub fn new(config: Config, camera: Camera, simd: Simd) -> Result<Self, ConfigError> {
        Stages::new(config, camera, simd).map(Self::from)
    }

    /// The system with a detector, which looks at every frame, or at every so many (`detector.stride`) from the first on.
    #[must_use]
    pub fn with_detector(mut self, detector: Box<dyn Detector>) -> Self {
        self.detector = Some(detector);
        self
    }

    /// The system with threads that share the work on a frame. The result is the same, bit for bit. To be called before the first frame.
    #[must_use]
    pub fn with_workers(mut self, workers: Workers) -> Self {
        self.exchange = self.exchange.with_workers(workers);
        self
    }

    /// The system with a map that is there already, to be resumed or to be localized in. Until a place in it is recognised
    /// the camera is lost. To be called before the first frame.
    ///
    /// # Errors
    /// [`StartError`] when nothing can be recognised in that map.
    pub fn with_map(mut self, map: Map, map_use: MapUse) -> Result<Self, StartError> {
        self.exchange = self.exchange.with_map(map, map_use)?;
        Ok(self)
    }

    /// The system with a log, which [`System::log`] gives at any time: with the same frames, [`Replay`](crate::Replay) gives the
    /// same result from it, bit for bit, and needs no detector. To be called before the first frame. It takes about 300 bytes
    /// per frame, and 30 per detection.
    #[must_use]
    pub fn with_log(mut self) -> Self {
        self.log = Some(Vec::new());
        self
    }

    /// Takes the next frame and says what happened, in the order that [`Event`] states.
    /// A frame that does not follow the one before changes nothing: [`Event::Refused`] is all that is said then.
    pub fn step(&mut self, frame: RgbdFrame) -> Vec<Event> {
        self.step_with(frame, None)
    }

    /// Takes the next frame with what a detector of the caller's saw in it, best score first. It reaches the tracker
    /// `schedule.detector` frames later, as the answer of [`System::with_detector`] does, which is not asked then. An empty list means
    /// that somebody looked and saw nothing; `None` is [`System::step`].
    pub fn step_with(&mut self, frame: RgbdFrame, seen: Option<Vec<Detection>>) -> Vec<Event> {
        if let Err(refused) = self.exchange.admit(&frame) {
            return vec![Event::Refused(refused)];
        }
        let frame = Arc::new(frame);
        let mut events = Vec::new();
        self.deliver_map(self.step, &mut events);
        match seen {
            Some(items) => self.expect(Detections {
                frame: frame.id,
                stamp: frame.stamp,
                items,
            }),
            None => self.detect(&frame, &mut events),
        }
        self.deliver_detections(frame.id, &mut events);
        self.carry_out(LogEntry::of_frame(&frame), Some(&frame), &mut events);
        self.build_map(&mut events);
        self.deliver_corrections(self.step, &mut events);
        self.step += 1;
        events
    }

    /// Takes samples of the inertial sensor, in order of time: before the frame that they lead to, and where there is one with the first sample after
    /// it. Without a sensor ([`Stages::with_imu`]) they are left out.
    pub fn receive_inertial(&mut self, samples: Vec<ImuSample>) {
        if samples.is_empty() || !self.exchange.stages().tracker.has_imu() {
            return;
        }
        let entry = LogEntry::TrackInertial { samples };
        self.carry_out(entry, None, &mut Vec::new());
    }

    /// The same of odometry: without any ([`Stages::with_odometry`]) its samples are left out.
    pub fn receive_odometry(&mut self, samples: Vec<OdometrySample>) {
        if samples.is_empty() || !self.exchange.stages().tracker.has_odometry() {
            return;
        }
        let entry = LogEntry::TrackOdometry { samples };
        self.carry_out(entry, None, &mut Vec::new());
    }

    /// Ends the stream: delivers the corrections, views and places that are still outstanding, tracks first frames of the map again that were still to
    /// be, and says what happened.
    pub fn finish(&mut self) -> Vec<Event> {
        let mut events = Vec::new();
        self.deliver_corrections(END, &mut events);
        self.deliver_map(END, &mut events);
        if let Some(entry) = self.exchange.end_of_tracking() {
            self.carry_out(entry, None, &mut events);
            self.build_map(&mut events);
            self.deliver_corrections(END, &mut events);
            self.deliver_map(END, &mut events);
        }
        events
    }

    /// Shows the tracker the views and places that are due.
    fn deliver_map(&mut self, now: u64, events: &mut Vec<Event>) {
        while let Some(answer) = self.views.pop(now) {
            self.carry_out(LogEntry::TrackView { answer }, None, events);
        }
        while let Some(answer) = self.places.pop(now) {
            self.carry_out(LogEntry::TrackPlaces { answer }, None, events);
        }
    }

    /// Lets the detector look at a frame whose turn it is. Its answer is due some steps later; a failure is reported at once.
    fn detect(&mut self, frame: &RgbdFrame, events: &mut Vec<Event>) {
        let Some(detector) = &mut self.detector else {
            return;
        };
        if !self.step.is_multiple_of(self.detector_stride) {
            return;
        }
        let span = tracing::info_span!("detect");
        match span.in_scope(|| detector.detect(frame)) {
            Ok(detections) => self.expect(detections),
            Err(e) => {
                let (next, said) = (frame.id, Err(e));
                self.carry_out(LogEntry::TrackDetections { next, said }, None, events);
            }
        }
    }

    /// Has detections be due when the schedule says.
    fn expect(&mut self, detections: Detections) {
        let due = self.step + u64::from(self.schedule.detector);
        self.detections.push(due, detections);
    }

    /// Tells the tracker the detections that are due, before it takes the frame `next`.
    fn deliver_detections(&mut self, next: FrameId, events: &mut Vec<Event>) {
        while let Some(detections) = self.detections.pop(self.step) {
            let said = Ok(detections);
            self.carry_out(LogEntry::TrackDetections { next, said }, None, events);
            self.build_map(events);
        }
    }

    /// Hands the mapper what the tracker sent it.
    fn build_map(&mut self, events: &mut Vec<Event>) {
        while let Some(entry) = self.exchange.next_for_mapper() {
            self.map_message(entry, events);
        }
    }

    /// Hands the mapper the corrections that are due.
    fn deliver_corrections(&mut self, now: u64, events: &mut Vec<Event>) {
        while self.corrections.pop(now).is_some() {
            if let Some(entry) = self.exchange.next_correction() {
                self.map_message(entry, events);
            }
        }
    }

    /// Has the mapper take a message. Its view is due some steps later; the loop closer gets it at once, and what that
    /// answers is due some steps later.
    fn map_message(&mut self, entry: LogEntry, events: &mut Vec<Event>) {
        self.carry_out(entry, None, events);
        let due = self.step + 1 + u64::from(self.schedule.mapper);
        self.views.push(due, self.exchange.views_sent() - 1);
        while let Some(entry) = self.exchange.next_for_loop_closer() {
            self.carry_out(entry, None, events);
            let later = self.step + u64::from(self.schedule.loop_closer);
            self.places.push(later + 1, self.exchange.places_sent() - 1);
            // The loop closer finds no other loop before this one is in the map: one correction waits at most.
            if self.corrections.0.is_empty() && self.exchange.next_correction().is_some() {
                self.corrections.push(later, ());
            }
        }
    }

    fn carry_out(
        &mut self,
        entry: LogEntry,
        frame: Option<&Arc<RgbdFrame>>,
        events: &mut Vec<Event>,
    ) {
        match self.exchange.take(&entry, frame) {
            Ok(event) => {
                events.extend(event);
                if let Some(log) = &mut self.log {
                    log.push(entry);
                }
            }
            // Entries are made from what waits in the exchange.
            Err(e) => debug_assert!(false, "{e}"),
        }
    }

    /// The log of the run until now; none unless [`System::with_log`] was called. After [`System::finish`] it is that of the whole
    /// run.
    #[must_use]
    pub fn log(&self) -> Option<RunLog> {
        let entries = self.log.clone()?;
        Some(RunLog {
            fingerprint: self.exchange.stages().fingerprint(),
            about: String::new(),
            entries,
            trajectory: self.trajectory().digest(&self.view()),
        })
    }

    /// The detector, if there is one.
    #[must_use]
    pub fn detector(&self) -> Option<&dyn Detector> {
        self.detector.as_deref()
    }

    /// All loop candidates so far and their outcomes, in the order of keyframes.
    #[must_use]
    pub fn loops(&self) -> &[LoopReport] {
        self.exchange.loops()
    }

    /// The frames tracked so far, each with its pose relative to a keyframe and as it was known at that frame.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        self.exchange.trajectory()
    }

    /// The frames tracked so far with their poses `world_from_camera` after all corrections until now: through the newest
    /// version of the map, and smoothed ([`Trajectory::smoothed`]).
    #[must_use]
    pub fn corrected_trajectory(&self) -> Vec<(TrajectoryEntry, Se3)> {
        self.trajectory().smoothed(&self.view())
    }

    /// When the parts of a frame are exposed, as estimated so far.
    #[must_use]
    pub fn timing(&self) -> Timing {
        self.exchange.timing()
    }

    /// The map as the mapper has it now: that of [`System::view`]. [`Map::to_bytes`] of it is a map file, at any time.
    #[must_use]
    pub fn map(&self) -> &Map {
        self.exchange.map()
    }

    /// The map, when the run is over.
    #[must_use]
    pub fn into_map(self) -> Map {
        self.exchange.into_map()
    }

    /// The newest version of the map, whether the tracker has seen it yet or not.
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        self.exchange.view()
    }
}

#[cfg(test)]
mod tests;
