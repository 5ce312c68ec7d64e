//! The inline driver: every stage in one thread, every reply after a fixed number of frames.

use crate::config::Config;
use crate::event::{Event, LoopReport, tell_applied};
use crate::messages::{LooperMsg, LooperOut, MapperMsg, MapperOut, MapperReport, Tracked};
use crate::sensor::Timing;
use crate::stages::{MapUse, Stages, StartError};
use crate::trajectory::Trajectory;
use crate::validation::ConfigError;
use std::collections::VecDeque;
use std::sync::Arc;
use stillpoint_detection::{Detections, Detector};
use stillpoint_geometry::Camera;
use stillpoint_imaging::{FrameId, RgbdFrame, Simd};
use stillpoint_map::{Correction, KeyframeId, Map, MapView};
use stillpoint_place::PlaceIndex;

/// RGB-D SLAM, driven frame by frame. The same frames, configuration and seed give the same result, bit for bit.
pub struct System {
    stages: Stages,
    /// Replies of the mapper that are not due yet, with the number of the step at which they are.
    replies: VecDeque<(u64, MapperOut)>,
    mapper_delay: u64,
    /// Known places that are not due yet, with the number of the step at which they are.
    places: VecDeque<(u64, PlaceIndex<KeyframeId>)>,
    /// Corrections that are not due yet, with the number of the step at which they are.
    corrections: VecDeque<(u64, Correction)>,
    looper_delay: u64,
    loops: Vec<LoopReport>,
    detector: Option<Box<dyn Detector>>,
    /// Answers of the detector that are not due yet, with the number of the step at which they are.
    detections: VecDeque<(u64, Detections)>,
    detector_delay: u64,
    detector_stride: u64,
    step: u64,
}

impl From<Stages> for System {
    /// The inline driver for these stages.
    fn from(stages: Stages) -> Self {
        let (schedule, detector) = (stages.config().schedule, stages.config().detector);
        Self {
            stages,
            replies: VecDeque::new(),
            mapper_delay: u64::from(schedule.mapper),
            places: VecDeque::new(),
            corrections: VecDeque::new(),
            looper_delay: u64::from(schedule.looper),
            loops: Vec::new(),
            detector: None,
            detections: VecDeque::new(),
            detector_delay: u64::from(schedule.detector),
            detector_stride: u64::from(detector.stride),
            step: 0,
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

    /// The system with a map that is there already, to be gone on with or to be localized in. Until a place in it is recognised
    /// the camera is lost. To be called before the first frame.
    ///
    /// # Errors
    /// [`StartError`] when nothing can be recognised in that map.
    pub fn with_map(mut self, map: Map, map_use: MapUse) -> Result<Self, StartError> {
        self.stages = self.stages.with_map(map, map_use)?;
        Ok(self)
    }

    /// The map, when the run is over.
    #[must_use]
    pub fn into_map(self) -> Map {
        self.stages.mapper.into_map()
    }

    /// The detector, if there is one.
    #[must_use]
    pub fn detector(&self) -> Option<&dyn Detector> {
        self.detector.as_deref()
    }

    /// Takes the next frame and says what happened, the frame's own report and its health first.
    /// A frame that does not follow the one before changes nothing: [`Event::Refused`] is all that is said then.
    pub fn step(&mut self, frame: RgbdFrame) -> Vec<Event> {
        if let Err(refused) = self.stages.gate.admit(&frame) {
            return vec![Event::Refused(refused)];
        }
        let mut events = Vec::new();
        self.deliver(self.step);
        let frame = Arc::new(frame);
        self.detect(&frame, &mut events);
        self.deliver_detections(frame.id, &mut events);
        let tracked = self.stages.tracker.track(&frame);
        let health = self.stages.health.judge(&frame, &tracked);
        let Tracked {
            report, keyframe, ..
        } = tracked;
        let first = [Event::Frame(report), Event::Health(Box::new(health))];
        events.splice(0..0, first);
        if let Some(keyframe) = keyframe {
            self.tell_mapper(MapperMsg::Keyframe(Box::new(keyframe)), &mut events);
        }
        self.deliver_corrections(self.step);
        self.step += 1;
        events
    }

    /// Lets the detector look at a frame whose turn it is; its answer is due some steps later.
    fn detect(&mut self, frame: &RgbdFrame, events: &mut Vec<Event>) {
        let Some(detector) = &mut self.detector else {
            return;
        };
        if !self.step.is_multiple_of(self.detector_stride) {
            return;
        }
        let _span = tracing::info_span!("detect").entered();
        match detector.detect(frame) {
            Ok(detections) => self
                .detections
                .push_back((self.step + self.detector_delay, detections)),
            Err(e) => events.push(Event::DetectorFailed(e)),
        }
    }

    fn deliver_detections(&mut self, next: FrameId, events: &mut Vec<Event>) {
        while self
            .detections
            .front()
            .is_some_and(|(due, _)| *due <= self.step)
        {
            let Some((_, detections)) = self.detections.pop_front() else {
                return;
            };
            events.push(Event::Detected(detections.clone()));
            self.stages.health.receive(&detections);
            if let Some(message) = self.stages.tracker.receive_detections(detections, next) {
                self.tell_mapper(message, events);
            }
        }
    }

    /// Tells the mapper, whose view is due some steps later, and the looper what it did.
    fn tell_mapper(&mut self, message: MapperMsg, events: &mut Vec<Event>) {
        let out = self.stages.mapper.step(message);
        events.extend(out.event());
        if let MapperReport::Corrected(applied) = out.report {
            tell_applied(&mut self.loops, applied);
        }
        let told = out.for_looper();
        self.replies
            .push_back((self.step + 1 + self.mapper_delay, out));
        self.tell_looper(told, events);
    }

    /// Tells the looper; the places that it knows then are due some steps later, and so is its correction.
    fn tell_looper(&mut self, message: LooperMsg, events: &mut Vec<Event>) {
        // No place is new by that.
        let nothing_new = matches!(message, LooperMsg::Corrected { .. });
        let LooperOut {
            correction,
            report,
            places,
        } = self.stages.looper.step(message);
        if !nothing_new {
            let due = self.step + 1 + self.looper_delay;
            self.places.push_back((due, places));
        }
        if let Some(correction) = correction {
            let due = self.step + self.looper_delay;
            self.corrections.push_back((due, correction));
        }
        if let Some(report) = report {
            events.push(Event::Looped(report.clone()));
            self.loops.push(report);
        }
    }

    /// Hands the mapper the corrections that are due.
    fn deliver_corrections(&mut self, now: u64) {
        while self.corrections.front().is_some_and(|(due, _)| *due <= now) {
            let Some((_, correction)) = self.corrections.pop_front() else {
                return;
            };
            // What a correction did is told by the report of its loop.
            self.tell_mapper(MapperMsg::Correct(correction), &mut Vec::new());
        }
    }

    /// The places that were recognised so far, with what became of them, in the order of keyframes.
    #[must_use]
    pub fn loops(&self) -> &[LoopReport] {
        &self.loops
    }

    /// Ends the stream: delivers every reply that is still outstanding.
    pub fn finish(&mut self) -> Vec<Event> {
        self.deliver_corrections(u64::MAX);
        self.deliver(u64::MAX);
        Vec::new()
    }

    fn deliver(&mut self, now: u64) {
        while self.replies.front().is_some_and(|(due, _)| *due <= now) {
            if let Some((_, out)) = self.replies.pop_front() {
                self.stages.tracker.receive(out.view);
            }
        }
        while self.places.front().is_some_and(|(due, _)| *due <= now) {
            if let Some((_, places)) = self.places.pop_front() {
                self.stages.tracker.receive_places(places);
            }
        }
    }

    /// The frames tracked so far.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        self.stages.tracker.trajectory()
    }

    /// When the parts of a frame are exposed, as estimated so far.
    #[must_use]
    pub fn timing(&self) -> Timing {
        self.stages.tracker.timing()
    }

    /// The map as the mapper has it. After [`System::finish`] it is what [`System::view`] shows.
    #[must_use]
    pub fn map(&self) -> &Map {
        self.stages.mapper.map()
    }

    /// The newest version of the map, whether the tracker has seen it yet or not.
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        self.replies.back().map_or_else(
            || self.stages.tracker.view(),
            |(_, out)| Arc::clone(&out.view),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_detection::{DetectError, DetectorInfo, DetectorKind};
    use stillpoint_imaging::{DepthImage, GrayImage};

    /// A detector that notes which frames it was shown, and tells them in its remark.
    struct Witness(Vec<u32>);

    impl Detector for Witness {
        fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
            self.0.push(frame.id.0);
            Ok(Detections {
                frame: frame.id,
                stamp: frame.stamp,
                items: Vec::new(),
            })
        }

        fn info(&self) -> DetectorInfo {
            DetectorInfo::new(DetectorKind::None, "")
        }

        fn remark(&self) -> Option<String> {
            Some(format!("{:?}", self.0))
        }
    }

    /// Runs ten black frames with the ids 7, 10, ..., 34; returns the frames that were looked at, and for each frame that
    /// detections reached, of which frame they were.
    fn looked_at(stride: u32, delay: u32) -> (String, Vec<(u32, u32)>) {
        let mut config = Config::default();
        config.detector.stride = stride;
        config.schedule.detector = delay;
        let camera = Camera::pinhole(64, 48, [50.0, 50.0, 31.5, 23.5]);
        let system = System::new(config, camera, Simd::Scalar).unwrap();
        let mut system = system.with_detector(Box::new(Witness(Vec::new())));
        let mut came = Vec::new();
        for i in 0..10 {
            let id = FrameId(7 + 3 * i);
            let events = system.step(RgbdFrame {
                id,
                stamp: f64::from(i),
                depth_stamp: f64::from(i),
                gray: GrayImage::new(64, 48),
                colour: None,
                depth: DepthImage::from_vec(64, 48, vec![0.0; 64 * 48]).unwrap(),
            });
            for event in events {
                if let Event::Detected(d) = event {
                    came.push((id.0, d.frame.0));
                }
            }
        }
        let seen = system.detector().and_then(Detector::remark);
        (seen.unwrap(), came)
    }

    #[test]
    fn the_detector_looks_at_every_so_many_frames_of_the_run() {
        assert_eq!(looked_at(1, 0).0, "[7, 10, 13, 16, 19, 22, 25, 28, 31, 34]");
        let looks = "[7, 19, 31]".to_owned();
        let at_once = vec![(7, 7), (19, 19), (31, 31)];
        assert_eq!(looked_at(4, 0), (looks.clone(), at_once));
        // The answer to the last look is not there yet when the run ends.
        assert_eq!(looked_at(4, 3), (looks, vec![(16, 7), (28, 19)]));
        assert_eq!(looked_at(100, 2), ("[7]".to_owned(), vec![(13, 7)]));
    }
}
