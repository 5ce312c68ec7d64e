//! The subscriber that collects objects during a run and follows its corrections.

use super::ThingMap;
use super::build::build;
use super::look::{Grid, Look, Sighting};
use crate::course::Course;
use crate::moving::{add_people, spread};
use std::collections::{BTreeMap, BTreeSet};
use stillpoint_detection::{Motion, MotionWeights, Object, ObjectState};
use stillpoint_geometry::{Camera, Se3, Vec3};
use stillpoint_imaging::{FrameId, RgbdFrame};
use stillpoint_map::MapView;
use stillpoint_slam::{Event, FrameEvent, FrameReport, MOVER, Subscriber};

/// Settings of the object map.
#[derive(Clone, Debug, PartialEq)]
pub struct ThingsConfig {
    /// Minimum time between views, s. Range: 0 to 10. A detector that misses a third of all objects detects one that is visible for a
    /// second in six of ten views, but in three of five.
    pub interval: f64,
    /// Memory for views, bytes. Beyond it every second one is dropped, and the interval doubles: at 18 kB each this is after 6 minutes.
    pub budget: usize,
    /// Up direction in the map, within 45 degrees; the default assumes that the camera was first held upright.
    pub about_up: Vec3,
}

impl Default for ThingsConfig {
    fn default() -> Self {
        Self {
            interval: 0.1,
            budget: 64 << 20,
            about_up: -Vec3::y(),
        }
    }
}

/// Collects observations of objects.
pub struct Things {
    pub(crate) config: ThingsConfig,
    raw: Camera,
    pub(crate) grid: Grid,
    weights: MotionWeights,
    course: Course,
    /// Frames to use, instead of choosing them by stamp.
    only: Option<BTreeSet<FrameId>>,
    interval: f64,
    last_stamp: Option<f64>,
    /// By track, how often it has moved, and whether it is moving.
    runs: BTreeMap<u32, (u32, bool)>,
    pub(crate) looks: Vec<Look>,
    bytes: usize,
    taken: Vec<FrameId>,
    pub(crate) known: ThingMap,
    moving: Vec<bool>,
}

impl Things {
    /// A subscriber for a camera, before the first frame.
    #[must_use]
    pub fn new(config: &ThingsConfig, camera: &Camera) -> Self {
        Self {
            raw: *camera,
            grid: Grid::new(camera),
            weights: MotionWeights::default(),
            course: Course::default(),
            only: None,
            interval: config.interval,
            last_stamp: None,
            runs: BTreeMap::new(),
            looks: Vec::new(),
            bytes: 0,
            taken: Vec::new(),
            known: ThingMap::default(),
            moving: Vec::new(),
            config: config.clone(),
        }
    }

    /// For a run that starts with a map of this many keyframe ids.
    #[must_use]
    pub fn with_first_keyframe(mut self, ids: usize) -> Self {
        self.course.begin_with(ids);
        self
    }

    /// Sets the weights that decide which objects move by themselves and are excluded, instead of the defaults.
    #[must_use]
    pub fn with_weights(mut self, weights: MotionWeights) -> Self {
        self.weights = weights;
        self
    }

    /// Continues an existing object map.
    #[must_use]
    pub fn starting_with(mut self, known: ThingMap) -> Self {
        self.known = known;
        self
    }

    /// Uses exactly these frames, those of the run that is replayed.
    #[must_use]
    pub fn with_frames(mut self, frames: impl IntoIterator<Item = FrameId>) -> Self {
        self.only = Some(frames.into_iter().collect());
        self
    }

    /// The frames used up to now. A replay needs them, since in a live run frames whose images came too late are missing.
    #[must_use]
    pub fn taken(&self) -> &[FrameId] {
        &self.taken
    }

    /// Memory held, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// The current objects, at the poses of a map version.
    #[must_use]
    pub fn at(&self, view: &MapView) -> ThingMap {
        build(self, view)
    }

    fn take(&mut self, event: &FrameEvent) {
        let report = &event.report;
        self.course.follow(report);
        self.watch(&report.objects);
        let due = self.is_due(report);
        if let (Some(pose), Some(frame), true) = (report.world_from_camera, &event.frame, due) {
            self.look(frame, report, pose);
        }
    }

    fn is_due(&self, report: &FrameReport) -> bool {
        if let Some(only) = &self.only {
            return only.contains(&report.frame);
        }
        // Tolerates jitter of the stamps.
        let least = 0.9 * self.interval;
        self.last_stamp
            .is_none_or(|last| (report.stamp - last).abs() >= least)
    }

    /// Records which tracks move: their observations before and after a motion are of different places.
    fn watch(&mut self, objects: &[Object]) {
        for object in objects {
            let (run, moves) = self.runs.entry(object.id.0).or_default();
            let now = object.motion == Motion::Moving;
            *run += u32::from(*moves && !now);
            *moves = now;
        }
    }

    fn look(&mut self, frame: &RgbdFrame, report: &FrameReport, online: Se3) {
        self.last_stamp = Some(report.stamp);
        spread(&report.segments, frame, &mut self.moving);
        add_people(&report.objects, &self.weights, frame, &mut self.moving);
        let sightings = report.objects.iter().filter_map(|o| self.sighting(o));
        let look = Look {
            stamp: report.stamp,
            anchor: self.course.anchor(report, online),
            sightings: sightings.collect(),
            depths: self.grid.depths(&frame.depth, &self.moving),
        };
        self.bytes += look.bytes();
        self.looks.push(look);
        self.taken.push(frame.id);
        if self.bytes > self.config.budget {
            self.thin();
        }
    }

    fn sighting(&self, object: &Object) -> Option<Sighting> {
        let [near, far] = object.depth_range?;
        let b = &object.bounds;
        if b.area() <= 0.0 {
            return None;
        }
        let run = self.runs.get(&object.id.0);
        let counts = object.state == ObjectState::Confirmed
            && object.motion != Motion::Moving
            && self.weights.get(object.class) < MOVER;
        Some(Sighting {
            track: object.id.0,
            run: run.map_or(0, |r| r.0),
            class: object.class,
            score: object.score,
            counts,
            bounds: Grid::undistorted(&self.raw, [b.x0, b.y0, b.x1, b.y1]),
            depths: [near as f32, far as f32],
        })
    }

    fn thin(&mut self) {
        let mut number = 0;
        self.looks.retain(|_| {
            number += 1;
            number % 2 == 1
        });
        self.interval = 2.0 * self.interval.max(0.1);
        self.bytes = self.looks.iter().map(Look::bytes).sum();
    }
}

impl Subscriber for Things {
    fn receive(&mut self, event: &Event) {
        if let Some(view) = event.view() {
            self.course.expect(view);
        }
        if let Event::Frame(frame) = event {
            self.take(frame);
        }
    }
}
