//! The inline driver: all stages in one thread, with replies delayed by fixed numbers of frames.

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

/// RGB-D SLAM, driven frame by frame. The same frames, configuration and seed give bit-identical results.
///
/// An [`Exchange`] with a schedule: at every frame it executes the entries that are due.
pub struct System {
    exchange: Exchange,
    schedule: Schedule,
    /// Views to deliver to the tracker, by number.
    views: Due<u64>,
    /// Place indices to deliver to the tracker, by number.
    places: Due<u64>,
    /// Corrections to deliver to the mapper.
    corrections: Due<()>,
    /// Detections to deliver to the tracker.
    detections: Due<Detections>,
    detector: Option<Box<dyn Detector>>,
    detector_stride: u64,
    step: u64,
    /// Executed entries, if a log is wanted.
    log: Option<Vec<LogEntry>>,
}

/// Items waiting for their step, in order of arrival.
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

    /// The next item that is due at this step.
    fn pop(&mut self, now: u64) -> Option<T> {
        self.0.front().filter(|(due, _)| *due <= now)?;
        self.0.pop_front().map(|(_, value)| value)
    }
}

/// The step at which everything is due: the largest number of a step, by definition.
const END: u64 = u64::MAX;

impl From<Stages> for System {
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
    /// [`ConfigError`] if a field is out of range.
    pub fn new(config: Config, camera: Camera, simd: Simd) -> Result<Self, ConfigError> {
        Stages::new(config, camera, simd).map(Self::from)
    }

    /// Adds a detector, which processes every frame, or every n-th (`detector.stride`) from the first on.
    #[must_use]
    pub fn with_detector(mut self, detector: Box<dyn Detector>) -> Self {
        self.detector = Some(detector);
        self
    }

    /// Shares the work on a frame among threads. Results stay bit-identical. Call before the first frame.
    #[must_use]
    pub fn with_workers(mut self, workers: Workers) -> Self {
        self.exchange = self.exchange.with_workers(workers);
        self
    }

    /// Starts with an existing map, to extend it or only localise in it. The camera is lost until a place in it is
    /// recognised. Call before the first frame.
    ///
    /// # Errors
    /// [`StartError`] if places of that map cannot be recognised.
    pub fn with_map(mut self, map: Map, map_use: MapUse) -> Result<Self, StartError> {
        self.exchange = self.exchange.with_map(map, map_use)?;
        Ok(self)
    }

    /// Records a log, available from [`System::log`] at any time: with the same frames, [`Replay`](crate::Replay)
    /// reproduces the results from it bit for bit, without a detector. Call before the first frame. Takes about 300
    /// bytes per frame, and 30 per detection.
    #[must_use]
    pub fn with_log(mut self) -> Self {
        self.log = Some(Vec::new());
        self
    }

    /// Processes the next frame and returns the events in the order documented at [`Event`]. An out-of-order frame
    /// changes nothing and returns only [`Event::Refused`].
    pub fn step(&mut self, frame: RgbdFrame) -> Vec<Event> {
        self.step_with(frame, None)
    }

    /// Processes the next frame with the caller's detections in it, best score first. They reach the tracker
    /// `schedule.detector` frames later, and replace the detector of [`System::with_detector`] for this frame. An empty
    /// list is a detection without objects; `None` is the same as [`System::step`].
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

    /// Takes samples of the inertial sensor in order of time: call before the frame that they lead to, preferably
    /// including the first sample after it. Ignored without a sensor ([`Stages::with_imu`]).
    pub fn receive_inertial(&mut self, samples: Vec<ImuSample>) {
        if samples.is_empty() || !self.exchange.stages().tracker.has_imu() {
            return;
        }
        let entry = LogEntry::TrackInertial { samples };
        self.carry_out(entry, None, &mut Vec::new());
    }

    /// Likewise for odometry samples, which are ignored without odometry ([`Stages::with_odometry`]).
    pub fn receive_odometry(&mut self, samples: Vec<OdometrySample>) {
        if samples.is_empty() || !self.exchange.stages().tracker.has_odometry() {
            return;
        }
        let entry = LogEntry::TrackOdometry { samples };
        self.carry_out(entry, None, &mut Vec::new());
    }

    /// Ends the stream: delivers outstanding corrections, views and places, completes retracing of first frames, and
    /// returns the events.
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

    /// Delivers the views and place indices that are due to the tracker.
    fn deliver_map(&mut self, now: u64, events: &mut Vec<Event>) {
        while let Some(answer) = self.views.pop(now) {
            self.carry_out(LogEntry::TrackView { answer }, None, events);
        }
        while let Some(answer) = self.places.pop(now) {
            self.carry_out(LogEntry::TrackPlaces { answer }, None, events);
        }
    }

    /// Runs the detector if this frame is due. Detections are delivered some steps later; a failure is reported at
    /// once.
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

    fn expect(&mut self, detections: Detections) {
        let due = self.step + u64::from(self.schedule.detector);
        self.detections.push(due, detections);
    }

    /// Delivers the detections that are due, before frame `next`.
    fn deliver_detections(&mut self, next: FrameId, events: &mut Vec<Event>) {
        while let Some(detections) = self.detections.pop(self.step) {
            let said = Ok(detections);
            self.carry_out(LogEntry::TrackDetections { next, said }, None, events);
            self.build_map(events);
        }
    }

    /// Delivers the tracker's messages to the mapper.
    fn build_map(&mut self, events: &mut Vec<Event>) {
        while let Some(entry) = self.exchange.next_for_mapper() {
            self.map_message(entry, events);
        }
    }

    /// Delivers the corrections that are due to the mapper.
    fn deliver_corrections(&mut self, now: u64, events: &mut Vec<Event>) {
        while self.corrections.pop(now).is_some() {
            if let Some(entry) = self.exchange.next_correction() {
                self.map_message(entry, events);
            }
        }
    }

    /// Delivers a message to the mapper, and its report to the loop closer at once. Their replies are delivered some
    /// steps later.
    fn map_message(&mut self, entry: LogEntry, events: &mut Vec<Event>) {
        self.carry_out(entry, None, events);
        let due = self.step + 1 + u64::from(self.schedule.mapper);
        self.views.push(due, self.exchange.views_sent() - 1);
        while let Some(entry) = self.exchange.next_for_loop_closer() {
            self.carry_out(entry, None, events);
            let later = self.step + u64::from(self.schedule.loop_closer);
            self.places.push(later + 1, self.exchange.places_sent() - 1);
            // The loop closer closes no other loop until this one is applied: at most one correction waits.
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
            // Entries are made from messages waiting in the exchange.
            Err(e) => debug_assert!(false, "{e}"),
        }
    }

    /// The log up to this frame; `None` without [`System::with_log`]. Complete after [`System::finish`].
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

    /// All loop candidates and their outcomes, in the order of keyframes.
    #[must_use]
    pub fn loops(&self) -> &[LoopReport] {
        self.exchange.loops()
    }

    /// All tracked frames, each with its pose relative to a keyframe and as estimated at that frame.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        self.exchange.trajectory()
    }

    /// All tracked frames with poses `world_from_camera` from the newest version of the map, smoothed
    /// ([`Trajectory::smoothed`]).
    #[must_use]
    pub fn corrected_trajectory(&self) -> Vec<(TrajectoryEntry, Se3)> {
        self.trajectory().smoothed(&self.view())
    }

    /// Estimated exposure timing.
    #[must_use]
    pub fn timing(&self) -> Timing {
        self.exchange.timing()
    }

    /// The mapper's map, of which [`System::view`] is a view. [`Map::to_bytes`] makes a map file of it, at any time.
    #[must_use]
    pub fn map(&self) -> &Map {
        self.exchange.map()
    }

    /// The map at the end of the run.
    #[must_use]
    pub fn into_map(self) -> Map {
        self.exchange.into_map()
    }

    /// The newest version of the map, which the tracker may not have received yet.
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        self.exchange.view()
    }
}

#[cfg(test)]
mod tests;
