//! Tracking: the pose of every frame, and which frames the map needs.
//!
//! Owns the motion model and the last frame; sees the map only as a view. Does not change the map.

mod config;
mod demand;
mod ego_motion;
mod flow;
mod frame;
mod hearing;
mod keyframe;
mod last_frame;
mod local_map;
mod motion;
mod outcome;
mod pose;
mod relocalise;
mod self_calibration;
mod sight;
mod starved;
mod statistics;

pub use config::TrackingConfig;
pub use keyframe::KeyframeConfig;

use crate::association::Matches;
use crate::event::{FrameCounts, LostReason, Outcome};
use crate::evidence::{Cells, Evidence};
use crate::messages::Tracked;
use crate::sensor::{SensorConfig, Timing};
use crate::static_filter::{FeatureVerdict, FilterSetup, FrameInput, Judgement, StaticFilter};
use crate::trajectory::Trajectory;
use demand::Demand;
use ego_motion::EgoMotion;
use frame::Observer;
use local_map::LocalMap;
use motion::Motion;
use relocalise::Places;
use self_calibration::SelfCalibration;
use statistics::{Sightings, Statistics};
use std::sync::Arc;
use stillpoint_features::OrbConfig;
use stillpoint_geometry::{Camera, Mat6, Se3, Vec6};
use stillpoint_imaging::{FrameId, RgbdFrame, Simd};
use stillpoint_map::{KeyframeData, KeyframeId, LandmarkId, MapView, PieceId};

/// What of the configuration concerns the tracker: made from a [`Config`](crate::Config).
#[derive(Clone, Debug, PartialEq)]
pub struct TrackerSetup {
    /// How poses are tracked.
    pub tracking: TrackingConfig,
    /// When a frame becomes a keyframe.
    pub keyframes: KeyframeConfig,
    /// How features are extracted.
    pub features: OrbConfig,
    /// The depth sensor's range and noise.
    pub sensor: SensorConfig,
    /// What moves.
    pub filter: FilterSetup,
    /// Seed of every random choice.
    pub seed: u64,
}

/// The last frame whose pose is known.
struct LastFrame {
    stamp: f64,
    data: Arc<KeyframeData>,
    matches: Vec<Option<LandmarkId>>,
    reference: KeyframeId,
    reference_from_camera: Se3,
    /// The pose in the view of that time; used until the view holds the reference keyframe.
    world_from_camera: Se3,
}

/// Tracks the camera, frame by frame.
pub struct Tracker {
    config: TrackerSetup,
    observer: Observer,
    demand: Demand,
    filter: StaticFilter,
    view: Arc<MapView>,
    motion: Motion,
    calibration: SelfCalibration,
    last: Option<LastFrame>,
    /// The frame before, whatever became of it.
    previous: Option<Arc<RgbdFrame>>,
    local_map: LocalMap,
    /// What is around, where the local map is looked for again.
    surroundings: LocalMap,
    lost_since: Option<FrameId>,
    places: Places,
    /// The piece of map that the last pose was in.
    piece: Option<PieceId>,
    /// Whether frames become keyframes and new pieces are begun; else the map is only read.
    grows: bool,
    /// Keyframes of a piece that is not the first one, until it has [`YOUNG_KEYFRAMES`].
    young: Option<u32>,
    /// Frames of the present loss that showed enough to begin a map.
    unplaced: u32,
    /// Keyframe ids count on from here: below are those of a map that was there before.
    first_keyframe: u32,
    last_keyframe: Option<FrameId>,
    statistics: Statistics,
    trajectory: Trajectory,
}

/// What is noted of a frame on its way.
#[derive(Clone, Default)]
struct Notes {
    counts: FrameCounts,
    judgement: Judgement,
    /// The static filter as of this frame, once it was asked: it takes the place of the one before when the frame ends.
    filter: Option<StaticFilter>,
    evidence: Evidence,
}

/// A pose and the matches that agree with it.
struct Fix {
    camera_from_world: Se3,
    matches: Matches,
    /// How many of the matches speak for the pose.
    inliers: usize,
    /// How many matches the pose was sought from.
    matched: usize,
    /// Inverse covariance of the pose.
    information: Mat6,
    /// What was seen of the landmarks; empty where the map does not bear the pose out.
    sightings: Sightings,
}

/// A pose with all that led to it.
struct Solution {
    data: Arc<KeyframeData>,
    camera_from_world: Se3,
    reference: KeyframeId,
    matches: Vec<Option<LandmarkId>>,
    sightings: Sightings,
}

impl Tracker {
    /// A tracker for one camera.
    #[must_use]
    pub fn new(setup: impl Into<TrackerSetup>, camera: Camera, simd: Simd) -> Self {
        let config = setup.into();
        Self {
            calibration: SelfCalibration::new(config.sensor.timing()),
            filter: StaticFilter::new(config.filter.clone(), &camera),
            observer: Observer::new(camera, config.sensor.clone(), &config.features, simd),
            demand: Demand::new(config.features.features),
            config,
            view: Arc::default(),
            motion: Motion::default(),
            last: None,
            previous: None,
            local_map: LocalMap::default(),
            surroundings: LocalMap::default(),
            lost_since: None,
            places: Places::default(),
            piece: None,
            grows: true,
            young: None,
            unplaced: 0,
            first_keyframe: 0,
            last_keyframe: None,
            statistics: Statistics::default(),
            trajectory: Trajectory::default(),
        }
    }

    /// The tracker in a map that is there already: it is lost until it recognises a place. Unless the map `grows`, it is only read.
    #[must_use]
    pub fn in_map(mut self, view: Arc<MapView>, grows: bool) -> Self {
        self.first_keyframe = view.keyframe_bound() as u32;
        self.view = view;
        self.grows = grows;
        self
    }

    /// The frames tracked so far.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        &self.trajectory
    }

    /// When the parts of a frame are exposed, as estimated so far.
    #[must_use]
    pub fn timing(&self) -> Timing {
        *self.calibration.timing()
    }

    /// The view in use.
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        Arc::clone(&self.view)
    }

    /// Tracks a frame.
    pub fn track(&mut self, frame: &Arc<RgbdFrame>) -> Tracked {
        let _span = tracing::info_span!("frame").entered();
        self.heed_clock(frame.stamp);
        let tracked = self.track_frame(frame);
        self.previous = Some(Arc::clone(frame));
        tracked
    }

    fn track_frame(&mut self, frame: &RgbdFrame) -> Tracked {
        let mut notes = Notes::default();
        let data = self.observe(frame, &mut notes);
        if self.last.is_none() && self.view.keyframe_count() == 0 && self.grows {
            return self.initialise(frame, &data, notes);
        }
        let reason = match self.locate(frame, &data, &mut notes) {
            Ok(solution) => {
                let outcome = match self.lost_since {
                    None => Outcome::Tracked,
                    Some(since) => Outcome::Relocalised {
                        since,
                        with: solution.reference,
                    },
                };
                return self.accept(frame, notes, solution, outcome);
            }
            Err(reason) => reason,
        };
        if let Some((with, solution)) = self.relocalise(frame, &data, &mut notes) {
            let since = self.lost_since.unwrap_or(frame.id);
            let outcome = Outcome::Relocalised { since, with };
            return self.accept(frame, notes, solution, outcome);
        }
        if self.is_piece_due(frame.stamp, &notes) {
            self.leave_piece(&mut notes);
            return self.initialise(frame, &data, notes);
        }
        self.lose(frame, notes, reason)
    }

    /// Finds the pose from what stands still of the features `data`.
    fn locate(
        &mut self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        notes: &mut Notes,
    ) -> Result<Solution, LostReason> {
        let (reference, predicted) = self.predict(frame.stamp);
        let motion = self.estimate_motion(frame, data, reference, &predicted, notes)?;
        self.settle(frame, data, reference, &motion, notes)
    }

    /// From a first pose to the pose: filters, matches the local map, optimises.
    fn settle(
        &mut self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        reference: KeyframeId,
        motion: &EgoMotion,
        notes: &mut Notes,
    ) -> Result<Solution, LostReason> {
        self.judge(frame, data, motion, notes);
        let (data, matches) = self.keep_static(frame, motion, notes);
        let (reference, matches, sightings) =
            self.match_map(frame, &data, reference, motion, matches, &mut notes.counts);
        let fix = self.refine(&data, reference, motion, matches, sightings);
        let fix = self.regain_map_when_starved(frame.id, &data, fix);
        let fix = self.bridge_when_starved(&data, motion, &notes.judgement.verdicts, fix);
        self.conclude(data, reference, fix, notes)
    }

    /// Extracts the features of a frame and reads their depths.
    fn observe(&mut self, frame: &RgbdFrame, notes: &mut Notes) -> Arc<KeyframeData> {
        let wanted = self.demand.next(self.config.tracking.min_inliers);
        self.observer.extractor.set_wanted(wanted);
        self.observer.extract(frame);
        let velocity = self.motion.velocity();
        let data = self
            .observer
            .measure(frame, velocity, self.calibration.timing(), None);
        // What is said of a frame that gives no pose: nothing against any feature.
        let kept = data
            .keypoints
            .iter()
            .map(|k| FeatureVerdict::kept([k.x, k.y]));
        notes.judgement.verdicts = kept.collect();
        notes.counts.keypoints = data.len() as u32;
        notes.counts.with_depth = data.depths.iter().filter(|z| **z > 0.0).count() as u32;
        data
    }

    /// Asks the static filter about the features `data` of a frame.
    fn judge(&self, frame: &RgbdFrame, data: &KeyframeData, motion: &EgoMotion, notes: &mut Notes) {
        let features: Vec<[f32; 2]> = data.keypoints.iter().map(|k| [k.x, k.y]).collect();
        let last = self.last.as_ref().map(|l| l.world_from_camera);
        let world_from_camera = motion.camera_from_world.inverse();
        let filter = notes.filter.as_ref().unwrap_or(&self.filter);
        let (judgement, next) = filter.judge(&FrameInput {
            frame,
            view: &self.view,
            world_from_camera,
            camera_from_depth: self.camera_from_depth(frame, motion.velocity.as_ref()),
            features: &features,
            depths: &data.depths,
            pairs: &motion.pairs,
            last_from_now: last.unwrap_or_default().inverse() * world_from_camera,
        });
        (notes.judgement, notes.filter) = (judgement, Some(next));
        let verdicts = &notes.judgement.verdicts;
        notes.counts.dynamic = verdicts.iter().filter(|v| v.dynamic).count() as u32;
        notes.counts.released = notes.judgement.released;
        notes.evidence.judged = true;
    }

    /// The features that the static filter left, brought to the frame's stamp by its own motion, and their matches.
    fn keep_static(
        &self,
        frame: &RgbdFrame,
        motion: &EgoMotion,
        notes: &Notes,
    ) -> (Arc<KeyframeData>, Matches) {
        let verdicts = &notes.judgement.verdicts;
        let velocity = motion.velocity.as_ref();
        let data =
            self.observer
                .measure(frame, velocity, self.calibration.timing(), Some(verdicts));
        let kept = verdicts.iter().map(|v| !v.dynamic);
        (data, motion.matches.select(kept))
    }

    /// Optimises the pose with all matches, and learns from it.
    fn refine(
        &mut self,
        data: &KeyframeData,
        reference: KeyframeId,
        motion: &EgoMotion,
        matches: Matches,
        mut sightings: Sightings,
    ) -> Fix {
        let matched = matches.count;
        let start = &motion.camera_from_world;
        let (matches, pose, information) = pose::solve_with_information(data, start, matches);
        sightings.found(&matches);
        let wanted = self.config.sensor.self_calibrate;
        if let Some(v) = motion.velocity.filter(|_| wanted) {
            self.calibration
                .learn(&self.observer, data, &matches, &pose, &v);
        }
        // Until the first view of a new piece of map arrives, the last frame's own points are what there is to track.
        let inliers = if self.view.resolve_keyframe(reference).is_none() {
            matches.count
        } else {
            matches.landmarks()
        };
        Fix {
            camera_from_world: pose,
            matches,
            inliers,
            matched,
            information,
            sightings,
        }
    }

    /// Takes the pose if enough speaks for it.
    fn conclude(
        &self,
        data: Arc<KeyframeData>,
        reference: KeyframeId,
        fix: Fix,
        notes: &mut Notes,
    ) -> Result<Solution, LostReason> {
        notes.counts.inliers = fix.inliers as u32;
        let targets = &fix.matches.targets;
        notes.evidence = Evidence {
            matched: fix.matched as u32,
            agreed: fix.matches.count as u32,
            cells: Cells::of(&data, |i| targets[i].is_some()),
            information: Some(fix.information),
            ..notes.evidence
        };
        if fix.inliers < self.config.tracking.min_inliers {
            return Err(LostReason::FewInliers);
        }
        Ok(Solution {
            data,
            camera_from_world: fix.camera_from_world,
            reference,
            matches: targets.iter().map(|t| t.and_then(|t| t.landmark)).collect(),
            sightings: fix.sightings,
        })
    }

    /// The camera's motion from the depth image's exposure to the colour image's.
    fn camera_from_depth(&self, frame: &RgbdFrame, velocity: Option<&Vec6>) -> Se3 {
        let dt = frame.depth_stamp - frame.stamp - self.calibration.timing().depth_delay;
        velocity.map_or(Se3::identity(), |v| Se3::exp(&(v * dt)).inverse())
    }
}
