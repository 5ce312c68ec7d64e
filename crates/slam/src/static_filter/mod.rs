//! The static filter: which features of a frame stand still.
//!
//! Answers per feature, with reasons, before the pose is measured from those that do. Owns the objects and what is
//! remembered of earlier frames; does not move the camera or change the map.

mod cells;
mod config;
mod corners;
mod depth;
mod diagonals;
mod epipolar;
mod flow_pair;
mod history;
mod mask;
mod memory;
mod mirrored;
mod moving;
mod outline;
mod paper;
mod rigid;
mod segments;
mod semantic;
mod sides;
mod standing;
mod surfaces;
mod surroundings;
mod things;
mod verdict;
mod visibility;

pub use config::{FilterParts, FilterSetup, Preset, StaticFilterConfig};
pub(crate) use flow_pair::FlowPair;
pub(crate) use history::CapturePose;
pub(crate) use memory::Memory;
pub use moving::Segments;
pub use semantic::MOVER;
pub use verdict::{FeatureVerdict, Reasons};

use crate::recycle::refill;
use cells::Cells;
use history::{History, Snapshot};
use rigid::Votes;
use semantic::Mover;
use std::sync::Arc;
use stillpoint_detection::{Detections, MotionWeights, Object, ObjectTracker};
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::{CoarseDepth, FrameId, RgbdFrame, workers};
use stillpoint_map::{KeyframeData, MapView};
use surfaces::{MOVES, Now, Surfaces};

/// Features that are judged together, at least, a number as in matching (`SEARCHED_TOGETHER`). Chosen: less is not worth a thread.
const JUDGED_TOGETHER: usize = 150;

/// What the filter is given of a frame.
pub(crate) struct FrameInput<'a> {
    pub(crate) frame: &'a RgbdFrame,
    pub(crate) view: &'a MapView,
    /// Camera at the colour stamp, as well as it is known before the pose is measured.
    pub(crate) world_from_camera: Se3,
    /// The camera's motion between the exposures of the depth and the colour image.
    pub(crate) camera_from_depth: Se3,
    /// Features: raw pixels.
    pub(crate) features: &'a [[f32; 2]],
    /// Their depths, m; 0 where there is none.
    pub(crate) depths: &'a [f32],
    /// Where they were in the frame before; empty when that is not known of any.
    pub(crate) pairs: &'a [Option<FlowPair>],
    /// The camera's motion back to the frame before.
    pub(crate) last_from_now: Se3,
    /// Whether the camera's motion rests on little else than corners without depth. Then all of these corners are kept, even if they move: if the pose follows
    /// a person who fills the view, they reveal it.
    pub(crate) few: bool,
}

/// What the filter says of a frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct Judgement {
    pub(crate) verdicts: Arc<[FeatureVerdict]>,
    pub(crate) objects: Arc<[Object]>,
    pub(crate) segments: Segments,
    /// Features that the starvation guard released.
    pub(crate) released: u32,
}

/// Detections that were of no use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Unused {
    /// Answers about frames that the history does not reach back to any more.
    pub(crate) too_late: u32,
    /// Answers about frames that have no pose.
    pub(crate) without_pose: u32,
}

/// Features of an earlier frame that turned out to lie on something that moves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Rejudged {
    pub(crate) frame: FrameId,
    pub(crate) features: Vec<u32>,
}

/// What stays the same in a run.
struct Rules {
    config: StaticFilterConfig,
    weights: MotionWeights,
    /// How long objects are believed in that are not seen, s.
    coast: f64,
    camera: Camera,
    seed: u64,
    cells: Cells,
}

/// Tells what stands still, and remembers what it saw. A value: judging a frame gives the filter of the frame after, so that a pose
/// that is tried and refused leaves nothing behind. A copy costs little, as what is large is shared.
#[derive(Clone)]
pub(crate) struct StaticFilter {
    rules: Arc<Rules>,
    objects: ObjectTracker,
    /// Detections of the frame to come: they wait for its first pose.
    waiting: Option<Detections>,
    unused: Unused,
    /// Whether there is a detector: it answered.
    detected: bool,
    history: History,
    surfaces: Arc<Surfaces>,
    /// The objects that may move in the frame judged last.
    movers: Arc<[Mover]>,
    /// The frame judged last, until its pose is known.
    present: Option<(FrameId, f64, Arc<CoarseDepth>)>,
}

impl StaticFilter {
    pub(crate) fn new(setup: FilterSetup, camera: &Camera) -> Self {
        let cells = Cells::new(camera, setup.noise);
        let weights = match setup.filter.preset {
            Preset::Paper => setup.weights.published(),
            _ => setup.weights,
        };
        Self {
            surfaces: Arc::new(Surfaces::new(&cells)),
            rules: Arc::new(Rules {
                config: setup.filter,
                weights,
                coast: setup.objects.coast_seconds,
                camera: *camera,
                seed: setup.seed,
                cells,
            }),
            objects: ObjectTracker::new(setup.objects, *camera),
            waiting: None,
            unused: Unused::default(),
            detected: false,
            history: History::default(),
            movers: Arc::default(),
            present: None,
        }
    }

    /// Whether the filter makes use of flow.
    pub(crate) fn wants_flow(&self) -> bool {
        self.rules.config.preset != Preset::Off && self.rules.config.parts.geometry
    }

    /// Whether flow tells it something only of features that have a depth.
    pub(crate) fn measures_flow_by_depth(&self) -> bool {
        self.rules.config.preset == Preset::Default
    }

    /// Whether the filter makes use of detections.
    fn wants_detections(&self) -> bool {
        self.rules.config.preset != Preset::Off && self.rules.config.parts.objects
    }

    /// Forgets what was seen so far, as it was seen in another frame of reference.
    pub(crate) fn forget(&mut self) {
        self.objects.forget();
        self.surfaces = Arc::new(Surfaces::new(&self.rules.cells));
        self.history = History::default();
        self.movers = Arc::default();
        self.present = None;
    }

    /// Forgets what is only known by its stamp, as the clock was set back. What is remembered of earlier frames goes with the next one.
    pub(crate) fn forget_times(&mut self) {
        self.objects.forget();
    }

    /// Takes detections of the frame to come.
    pub(crate) fn receive(&mut self, detections: Detections) {
        if self.wants_detections() {
            self.detected = true;
            self.waiting = Some(detections);
        }
    }

    /// Ends a frame, whatever became of it. Returns which detections came since the last frame and were of no use: those of a
    /// frame that found no pose are none later either.
    pub(crate) fn end_frame(&mut self) -> Unused {
        self.unused.without_pose += u32::from(self.waiting.take().is_some());
        std::mem::take(&mut self.unused)
    }

    /// Judges the features of a frame. Returns what is said of them, and the filter of the frame after.
    pub(crate) fn judge(&self, input: &FrameInput<'_>, memory: &mut Memory) -> (Judgement, Self) {
        let _span = tracing::info_span!("filter").entered();
        let mut next = memory.copy(self);
        let judgement = next.take_in(input, memory);
        (judgement, next)
    }

    fn take_in(&mut self, input: &FrameInput<'_>, memory: &mut Memory) -> Judgement {
        if self.rules.config.preset == Preset::Off {
            let kept = input.features.iter().map(|f| FeatureVerdict::kept(*f));
            return Judgement {
                verdicts: kept.collect(),
                ..Judgement::default()
            };
        }
        let grid = memory.spent.coarse(&input.frame.depth);
        let stamp = input.frame.stamp;
        if let Some(detections) = self.waiting.take_if(|d| d.frame == input.frame.id) {
            self.objects
                .update(&detections, &input.world_from_camera, &grid);
        }
        let objects = self.objects.predict(stamp, &input.world_from_camera);
        let movers = self.movers(&objects, stamp);
        let mut verdicts = std::mem::take(&mut memory.verdicts);
        match self.rules.config.preset {
            Preset::Paper | Preset::Adapted => {
                verdicts = paper::judge(
                    &self.rules.config,
                    input,
                    &self.rules.camera,
                    &movers,
                    self.rules.seed,
                );
            }
            Preset::Default | Preset::Off => {
                self.judge_surfaces(input, &grid, &movers, (&mut verdicts, memory));
            }
        }
        let released =
            verdict::release_when_starving(&mut verdicts, self.rules.config.min_features);
        self.movers = if movers.is_empty() {
            Arc::default()
        } else {
            movers.into()
        };
        self.present = Some((input.frame.id, stamp, grid));
        let judgement = Judgement {
            verdicts: verdicts.as_slice().into(),
            objects: if objects.is_empty() {
                Arc::default()
            } else {
                objects.into()
            },
            segments: self.segments(),
            released,
        };
        memory.verdicts = verdicts;
        judgement
    }

    /// The objects that may move. Without D all that is in their boxes is theirs, whatever its depth.
    fn movers(&self, objects: &[Object], stamp: f64) -> Vec<Mover> {
        let mut movers = semantic::movers(objects, &self.rules.weights, stamp, self.rules.coast);
        if !self.rules.config.parts.depth {
            movers.iter_mut().for_each(|m| m.range = None);
        }
        movers
    }

    /// Preset `default`: each feature moves with the surface that it lies on.
    fn judge_surfaces(
        &mut self,
        input: &FrameInput<'_>,
        grid: &CoarseDepth,
        movers: &[Mover],
        (verdicts, memory): (&mut Vec<FeatureVerdict>, &mut Memory),
    ) {
        let stamp = input.frame.stamp;
        let now = Now {
            stamp,
            grid,
            world_from_depth: input.world_from_camera * input.camera_from_depth,
            view: input.view,
            history: &self.history,
        };
        self.count_rigid(input, &mut memory.votes);
        let (cells, votes) = (&self.rules.cells, &memory.votes);
        self.surfaces = refill(memory.surfaces.take(), |next| {
            self.surfaces
                .next(cells, &now, movers, votes, (next, &mut memory.judging));
        });
        self.measure_rigidity(stamp, grid, movers);
        verdicts.clear();
        verdicts.resize(input.features.len(), FeatureVerdict::kept([0.0; 2]));
        let votes = &memory.votes;
        let depth = (&input.frame.depth, grid.data());
        workers::fill(verdicts, JUDGED_TOGETHER, |i| {
            let pixel = input.features[i];
            let moves = |odds| {
                odds > -MOVES
                    && self.moves_near(pixel)
                    && self.hole_moves(pixel, votes)
                    && votes.contradicts(&self.rules.camera, input, i)
            };
            self.judge_feature(pixel, depth, movers, moves)
        });
    }

    /// Keeps the frame just judged for later comparison, once its pose is known.
    pub(crate) fn remember(&mut self, place: &CapturePose, memory: &mut Memory) {
        if let Some((frame, stamp, grid)) = self.present.take() {
            let moving = self.surfaces.motion.iter().map(|o| *o > MOVES);
            let known = (moving, place);
            self.history
                .push(frame, stamp, grid, known, &mut memory.spent);
        }
    }

    /// Takes in detections of an earlier frame, and if that became a keyframe (`data`), judges its features again. `None` when
    /// none of them moves.
    pub(crate) fn take_late(
        &mut self,
        detections: &Detections,
        view: &MapView,
        data: Option<Arc<KeyframeData>>,
    ) -> Option<Rejudged> {
        if !self.wants_detections() {
            return None;
        }
        let frame = detections.frame;
        self.detected = true;
        let Some(s) = self.history.get(frame) else {
            if self.history.forgot(frame) {
                self.unused.too_late += 1;
            } else {
                self.unused.without_pose += 1;
            }
            return None;
        };
        let pose = s.world_from_camera(view);
        self.objects.update(detections, &pose, &s.grid);
        let features = self.features_on_movers(s, &pose, &*data?);
        (!features.is_empty()).then_some(Rejudged { frame, features })
    }

    fn features_on_movers(&self, s: &Snapshot, pose: &Se3, data: &KeyframeData) -> Vec<u32> {
        let objects = self.objects.predict(s.stamp, pose);
        let movers = self.movers(&objects, s.stamp);
        let on_mover = |i: &u32| {
            let (k, z) = (&data.keypoints[*i as usize], data.depths[*i as usize]);
            let (u, v) = (f64::from(k.x), f64::from(k.y));
            movers.iter().any(|m| m.odds(u, v, z) > MOVES)
        };
        (0..data.len() as u32).filter(on_mover).collect()
    }

    /// Counts what the flow of each feature says of the surface it lies on.
    fn count_rigid(&self, input: &FrameInput<'_>, votes: &mut Votes) {
        if !self.rules.config.parts.geometry {
            return votes.clear();
        }
        let distance = |pair: &Option<FlowPair>, z: f32| {
            rigid::distance_px(&self.rules.camera, pair.as_ref()?, z, &input.last_from_now)
        };
        let sigma = |p: &Option<FlowPair>| p.as_ref().map_or(0.0, FlowPair::sigma);
        let features = input.features.iter().zip(input.pairs).zip(input.depths);
        let features = features.map(|((f, pair), z)| (f, distance(pair, *z), sigma(pair)));
        votes.count(&self.rules.cells, features);
        if !input.few && self.asks_holes() {
            votes.count_holes(&self.rules.cells, &self.rules.camera, input);
        }
    }

    /// Tells the objects which part of their surface stands still.
    fn measure_rigidity(&mut self, stamp: f64, grid: &CoarseDepth, movers: &[Mover]) {
        for m in movers {
            let [agreeing, tested] = standing::counts(m, movers, grid, &self.surfaces.evidence);
            if tested > 0 {
                self.objects.observe_rigidity(m.id, stamp, agreeing, tested);
            }
        }
    }
}

#[cfg(test)]
mod tests;
