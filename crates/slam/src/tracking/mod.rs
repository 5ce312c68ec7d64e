//! Tracking: estimates the pose of every frame and selects keyframes.
//!
//! Owns the motion model and the last frame; reads the map through views.

mod carry;
mod choice;
mod clock;
mod config;
mod crowd;
mod demand;
mod ego_motion;
mod first_keyframe;
mod flow;
mod flow_search;
mod frame;
mod front_end;
mod inbox;
mod judging;
mod keyframe;
mod known;
mod known_map;
mod last_frame;
mod local_map;
mod look;
mod memory;
mod mirror;
mod momentum;
mod motion;
mod motion_prior;
mod outcome;
mod pose;
mod relocalise;
mod rows;
mod self_calibration;
mod sensors;
mod sight;
mod starved;
mod state;
mod statistics;
mod vote;

pub(crate) use config::MIN_INITIAL_POINTS;
pub use config::{TrackerSetup, TrackingConfig};
pub(crate) use crowd::SOME_MOVE;
pub use keyframe::KeyframeConfig;
pub(crate) use mirror::TurningPoint;

use crate::association::Matches;
use crate::evidence::{Cells, Evidence};
use crate::messages::{Exposure, NewKeyframe, Tracked};
use crate::pace::Pace;
use crate::report::{FrameCounts, LostReason};
use crate::static_filter::{Judgement, StaticFilter};
use crate::trajectory::Trajectory;
use choice::Vote;
use ego_motion::EgoMotion;
use front_end::FrontEnd;
use known_map::KnownMap;
use memory::Memory;
use outcome::SinceKeyframe;
use pose::{PosePrior, Precision};
use self_calibration::RowPair;
use sensors::Sensors;
use state::State;
use statistics::Sightings;
use std::sync::Arc;
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::{FrameId, RgbdFrame, Simd, Standstill, Still, StillWatch, Workers};
use stillpoint_map::{KeyframeData, KeyframeId, LandmarkId, MapView, SubmapId};

/// Tracks the camera, frame by frame.
pub struct Tracker {
    setup: TrackerSetup,
    front_end: FrontEnd,
    filter: StaticFilter,
    map: KnownMap,
    state: State,
    beginning: Beginning,
    keyframes: Keyframes,
    pace: Pace,
    /// Share of moving keypoints in the last frame.
    moving_share: f64,
    images: Images,
    trajectory: Trajectory,
    workers: Workers,
    sensors: Sensors,
    /// Whether it tracks the beginning of a map backwards.
    goes_back: bool,
    memory: Memory,
}

/// The current submap and its beginning.
struct Beginning {
    submap: Option<SubmapId>,
    /// Start, s.
    stamp: f64,
    /// Whether hardly anything moved at its start.
    quiet: bool,
}

impl Default for Beginning {
    fn default() -> Self {
        Self {
            submap: None,
            stamp: f64::NEG_INFINITY,
            quiet: true,
        }
    }
}

#[derive(Default)]
struct Keyframes {
    since: SinceKeyframe,
    /// Whether the next frame with a pose becomes a keyframe regardless of need.
    wanted: bool,
    /// The first keyframe of a map or submap, waiting for the next frame.
    first: Option<NewKeyframe>,
}

#[derive(Default)]
struct Images {
    /// The last frame with a new view, tracked or not.
    previous: Option<Arc<RgbdFrame>>,
    watch: StillWatch,
    /// First frame of the current sequence of repeated images.
    repeated: Option<FrameId>,
}

/// Results collected while processing a frame.
#[derive(Clone, Default)]
struct Notes {
    still: Option<Standstill>,
    counts: FrameCounts,
    judgement: Judgement,
    /// The static filter after judging this frame, adopted when the frame ends.
    filter: Option<StaticFilter>,
    evidence: Evidence,
    /// The motion vote bound to the sensors.
    bound: Option<Vote>,
}

/// A pose with its inlier matches.
struct Fix {
    camera_from_world: Se3,
    matches: Matches,
    /// Number of supporting matches.
    inliers: usize,
    /// Number of matches before optimisation.
    matched: usize,
    precision: Precision,
    /// Landmark observations; empty if the map does not confirm the pose.
    sightings: Sightings,
}

/// A pose with all data behind it.
struct Solution {
    data: Arc<KeyframeData>,
    camera_from_world: Se3,
    reference: KeyframeId,
    matches: Vec<Option<LandmarkId>>,
    sightings: Sightings,
    /// Exposure assumed for `data`.
    exposure: Exposure,
    /// Static flow pairs since the last frame, if available.
    followed: Vec<RowPair>,
    /// The recognised keyframe, if relocalised.
    recognised: Option<KeyframeId>,
}

impl Tracker {
    /// A tracker for one camera.
    #[must_use]
    pub fn new(setup: impl Into<TrackerSetup>, camera: Camera, simd: Simd) -> Self {
        let setup = setup.into();
        Self {
            front_end: FrontEnd::new(&setup, camera, simd),
            filter: StaticFilter::new(setup.filter.clone(), &camera),
            setup,
            map: KnownMap::new(Arc::default(), true),
            state: State::default(),
            beginning: Beginning::default(),
            keyframes: Keyframes::default(),
            pace: Pace::default(),
            moving_share: 0.0,
            images: Images::default(),
            trajectory: Trajectory::default(),
            workers: Workers::default(),
            sensors: Sensors::default(),
            goes_back: false,
            memory: Memory::default(),
        }
    }

    /// Starts in an existing map: lost until a place is recognised. The map is read-only unless it `grows`.
    #[must_use]
    pub fn in_map(mut self, view: Arc<MapView>, grows: bool) -> Self {
        self.map = KnownMap::new(view, grows);
        self
    }

    /// Shares the work on a frame among threads. Results stay bit-identical.
    #[must_use]
    pub fn with_workers(mut self, workers: Workers) -> Self {
        self.workers = workers;
        self
    }

    /// Tracks a frame.
    pub fn track(&mut self, frame: &Arc<RgbdFrame>) -> Tracked {
        let workers = self.workers.clone();
        workers.run(|| self.track_here(frame))
    }

    fn track_here(&mut self, frame: &Arc<RgbdFrame>) -> Tracked {
        let _span = tracing::info_span!("frame").entered();
        self.handle_clock(frame.stamp);
        self.pace.next(frame);
        self.front_end.clock.take(frame);
        let mut notes = Notes {
            still: self.watch(frame),
            ..Notes::default()
        };
        let frame = match notes.still.map(|s| s.what) {
            Some(Still::Colour | Still::Frame) => return self.pass_over(frame, notes),
            Some(Still::Depth) => &Arc::new(frame.without_depth()),
            Some(Still::Rest) | None => frame,
        };
        self.images.repeated = None;
        let data = self.observe(frame, &mut notes);
        let ending = if self.is_first() {
            self.begin_submap(frame, &data, &mut notes)
        } else {
            let followed = self.locate(frame, &data, &mut notes);
            // Immediately: the longer the camera is lost, the less its position is constrained.
            match followed.or_else(|reason| self.relocalise(frame, &data, reason, &mut notes)) {
                Ok(solution) => self.accept(frame, solution, &notes),
                Err(reason) => match self.carry(frame, &data, &mut notes) {
                    Some(ending) => ending,
                    None => self.give_up(frame, &data, reason, &mut notes),
                },
            }
        };
        self.images.previous = Some(Arc::clone(frame));
        self.conclude(frame, notes, ending)
    }

    /// Detects repeated images. Backward tracking repeats frames that were already checked.
    fn watch(&mut self, frame: &Arc<RgbdFrame>) -> Option<Standstill> {
        if self.goes_back {
            return None;
        }
        self.images.watch.look(frame)
    }

    /// The last tracked frame as used: without a repeated depth image.
    pub(crate) fn as_tracked(&self, frame: &Arc<RgbdFrame>) -> Arc<RgbdFrame> {
        let own = self.images.previous.as_ref().filter(|p| p.id == frame.id);
        Arc::clone(own.unwrap_or(frame))
    }

    /// Whether the next frame starts a map.
    fn is_first(&self) -> bool {
        self.state.last().is_none() && self.map.is_empty() && self.map.grows
    }

    /// Estimates the pose from the static features of `data`, tracking from the last frame.
    fn locate(
        &mut self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        notes: &mut Notes,
    ) -> Result<Solution, LostReason> {
        let now = self.front_end.clock.now();
        let before = self.state.last().map(|l| l.world_from_camera);
        let (reference, predicted) = self.state.predict(&self.map.view, now);
        self.note_correction(before);
        let predicted = self.moved(predicted);
        let motion = self.estimate_motion(frame, data, reference, &predicted, notes)?;
        let solution = self.settle(frame, reference, &motion, notes);
        self.memory.give(motion);
        solution
    }

    /// From a first pose to the final one: static filter, local map, optimisation.
    fn settle(
        &mut self,
        frame: &RgbdFrame,
        reference: KeyframeId,
        motion: &EgoMotion,
        notes: &mut Notes,
    ) -> Result<Solution, LostReason> {
        self.judge(frame, motion, notes);
        let (data, matches) = self.keep_static(motion, notes);
        let (reference, matches, sightings) =
            self.match_map(frame, &data, reference, motion, matches, &mut notes.counts);
        let fix = self.refine(&data, reference, motion, matches, sightings);
        // Map before flow: poses from flow drift, those from the map do not.
        let fix = self.regain_map_when_starved(frame.id, &data, fix);
        let fix = self.bridge_when_starved(&data, motion, &notes.judgement.verdicts, fix);
        let fix = self.refuse_riding(motion, fix, data.len())?;
        let mut solution = self.confirm(data, reference, fix, notes)?;
        solution.exposure = self.front_end.exposure(motion.velocity);
        solution.followed = self.memory.rows.take();
        let rows = &mut solution.followed;
        self.followed(motion, &notes.judgement.verdicts, rows);
        Ok(solution)
    }

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
        // With few landmarks sensors are more accurate, and many may be on a person.
        let few = matched < known::FEW || self.was_blind();
        let prior = PosePrior {
            turn: self
                .known_pose()
                .filter(|_| few)
                .or_else(|| self.known_pose_in_crowd())
                .filter(|_| motion.follows),
            place: self.known_place(start).filter(|_| motion.follows),
        };
        let (matches, pose, precision) = self
            .memory
            .solver
            .solve_with_precision(data, start, matches, prior);
        // A landmark counts as found only if it is an inlier of the refined pose.
        sightings.found(&matches);
        // Until the first view of a new submap arrives, only temporary points exist.
        let inliers = if self.map.view.resolve_keyframe(reference).is_none() {
            matches.count
        } else {
            matches.landmarks()
        };
        Fix {
            camera_from_world: pose,
            matches,
            inliers,
            matched,
            precision,
            sightings,
        }
    }

    /// Accepts the pose if it has enough inliers.
    fn confirm(
        &mut self,
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
            information: Some(fix.precision.information),
            scatter: fix.precision.scatter,
            reference: Some(reference),
            ..notes.evidence
        };
        if fix.inliers < self.setup.tracking.min_inliers {
            return Err(LostReason::FewInliers);
        }
        let mut matches = self.memory.landmarks.take();
        matches.extend(targets.iter().map(|t| t.and_then(|t| t.landmark)));
        self.memory.matching.targets.give(fix.matches.targets);
        Ok(Solution {
            data,
            camera_from_world: fix.camera_from_world,
            reference,
            matches,
            sightings: fix.sightings,
            exposure: Exposure::default(),
            followed: Vec::new(),
            recognised: None,
        })
    }
}
