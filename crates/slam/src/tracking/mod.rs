//! Tracking: the pose of every frame, and which frames the map needs.
//!
//! Owns the motion model and the last frame; sees the map only as a view. Does not change the map.

mod carry;
mod choice;
mod clock;
mod config;
mod demand;
mod ego_motion;
mod first_keyframe;
mod flow;
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
mod outcome;
mod pose;
mod relocalise;
mod self_calibration;
mod sensors;
mod sight;
mod starved;
mod state;
mod statistics;
mod vote;

pub(crate) use config::MIN_INITIAL_POINTS;
pub use config::{TrackerSetup, TrackingConfig};
pub use keyframe::KeyframeConfig;
pub(crate) use mirror::TurningPoint;
pub(crate) use vote::SOME_MOVE;

use crate::association::Matches;
use crate::evidence::{Cells, Evidence};
use crate::messages::{Exposure, NewKeyframe, Tracked};
use crate::pace::Pace;
use crate::report::{FrameCounts, LostReason};
use crate::static_filter::{Judgement, StaticFilter};
use crate::trajectory::Trajectory;
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
use vote::Vote;

/// Tracks the camera, frame by frame.
pub struct Tracker {
    setup: TrackerSetup,
    front_end: FrontEnd,
    filter: StaticFilter,
    map: KnownMap,
    state: State,
    beginning: Beginning,
    keyframes: Keyframes,
    /// How fast frames come.
    pace: Pace,
    /// Share of the keypoints that moved in the frame before.
    moving_share: f64,
    images: Images,
    trajectory: Trajectory,
    workers: Workers,
    sensors: Sensors,
    /// Whether it follows the beginning of a map backwards.
    goes_back: bool,
    memory: Memory,
}

/// The submap that the last pose was in, and how it began.
struct Beginning {
    submap: Option<SubmapId>,
    /// When that was, s.
    stamp: f64,
    /// Whether hardly anything moved then.
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

/// Which frames become keyframes.
#[derive(Default)]
struct Keyframes {
    since: SinceKeyframe,
    /// Whether the next frame with a pose becomes one, needed or not.
    wanted: bool,
    /// That which begins a map or a submap, while it waits for the next frame.
    first: Option<NewKeyframe>,
}

/// The images that came before.
#[derive(Default)]
struct Images {
    /// The frame before that was a new view, whatever became of it.
    previous: Option<Arc<RgbdFrame>>,
    /// Which images stand still.
    watch: StillWatch,
    /// The first frame without a new view.
    repeated: Option<FrameId>,
}

/// What is noted of a frame on its way.
#[derive(Clone, Default)]
struct Notes {
    still: Option<Standstill>,
    counts: FrameCounts,
    judgement: Judgement,
    /// The static filter as of this frame, once it was asked: it takes the place of the one before when the frame ends.
    filter: Option<StaticFilter>,
    evidence: Evidence,
    /// The vote of motions that sensors allow.
    bound: Option<Vote>,
}

/// A pose and the matches that agree with it.
struct Fix {
    camera_from_world: Se3,
    matches: Matches,
    /// How many of the matches speak for the pose.
    inliers: usize,
    /// How many matches the pose was sought from.
    matched: usize,
    precision: Precision,
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
    /// What `data` was measured with.
    exposure: Exposure,
    /// What stands still since the frame before, where flow tells.
    followed: Vec<RowPair>,
    /// The keyframe whose place was recognised, where the camera was not just followed.
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

    /// The tracker in a map that is there already: it is lost until it recognises a place. Unless the map `grows`, it is only read.
    #[must_use]
    pub fn in_map(mut self, view: Arc<MapView>, grows: bool) -> Self {
        self.map = KnownMap::new(view, grows);
        self
    }

    /// The tracker with threads that share its work on a frame. What it finds is the same, bit for bit.
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
            // At the first frame that fails: the longer the camera is lost, the less is known of where it can be.
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

    /// What of a frame stands still. Frames that come newest first were judged on their way here.
    fn watch(&mut self, frame: &Arc<RgbdFrame>) -> Option<Standstill> {
        if self.goes_back {
            return None;
        }
        self.images.watch.look(frame)
    }

    /// The frame that was tracked last, as it was tracked: without a depth image that stands still.
    pub(crate) fn as_tracked(&self, frame: &Arc<RgbdFrame>) -> Arc<RgbdFrame> {
        let own = self.images.previous.as_ref().filter(|p| p.id == frame.id);
        Arc::clone(own.unwrap_or(frame))
    }

    /// Whether there is nothing yet that a frame could be tracked in.
    fn is_first(&self) -> bool {
        self.state.last().is_none() && self.map.is_empty() && self.map.grows
    }

    /// Finds the pose from what stands still of the features `data`, following the camera from the frame before.
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

    /// From a first pose to the pose: filters, matches the local map, optimises.
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
        // The map before the flow: poses from flow drift, those from the map do not.
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
        // Few landmarks hold a pose less well than sensors do, and many that somebody wears no better.
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
        // Found is what agrees with the refined pose, not all that was matched.
        sightings.found(&matches);
        // Until the first view of a new submap arrives, the last frame's own points are what there is to track.
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

    /// Takes the pose if enough speaks for it.
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
