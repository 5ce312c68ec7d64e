//! The static filter: decides which features of a frame are static.
//!
//! Gives a verdict with reasons per feature, before the pose is measured from the static ones. Owns the tracked objects
//! and the history of frames.

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

pub(crate) struct FrameInput<'a> {
    pub(crate) frame: &'a RgbdFrame,
    pub(crate) view: &'a MapView,
    /// Camera pose at the colour stamp, before the pose is measured.
    pub(crate) world_from_camera: Se3,
    /// Camera motion between the exposures of the depth and the colour image.
    pub(crate) camera_from_depth: Se3,
    pub(crate) features: &'a [[f32; 2]],
    /// Their depths, m; 0 if unknown.
    pub(crate) depths: &'a [f32],
    /// Their flow from the last frame; empty if not available at all.
    pub(crate) pairs: &'a [Option<FlowPair>],
    pub(crate) last_from_now: Se3,
    /// Whether the camera motion rests mainly on corners without depth. Then all of these are kept, even if they move:
    /// if the pose follows a person who fills the view, they reveal it.
    pub(crate) few: bool,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Judgement {
    pub(crate) verdicts: Arc<[FeatureVerdict]>,
    pub(crate) objects: Arc<[Object]>,
    pub(crate) segments: Segments,
    /// Features released because too few static ones remained.
    pub(crate) released: u32,
}

/// Counts of unusable detections.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Unused {
    /// For frames older than the history.
    pub(crate) too_late: u32,
    /// For frames without a pose.
    pub(crate) without_pose: u32,
}

/// Features of an earlier frame found to be on a moving object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Rejudged {
    pub(crate) frame: FrameId,
    pub(crate) features: Vec<u32>,
}

/// The constant part.
struct Rules {
    config: StaticFilterConfig,
    weights: MotionWeights,
    /// How long unseen objects are kept, s.
    coast: f64,
    camera: Camera,
    seed: u64,
    cells: Cells,
}

/// The filter's state, a value: judging a frame returns the state after it, so a rejected pose has no side effects.
/// Clones are cheap, as large parts are shared.
#[derive(Clone)]
pub(crate) struct StaticFilter {
    rules: Arc<Rules>,
    objects: ObjectTracker,
    /// Detections of the next frame, waiting for its first pose.
    waiting: Option<Detections>,
    unused: Unused,
    /// Whether any detections have arrived.
    detected: bool,
    history: History,
    surfaces: Arc<Surfaces>,
    /// The objects that may move in the last judged frame.
    movers: Arc<[Mover]>,
    /// The last judged frame, until its pose is known.
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

    pub(crate) fn wants_flow(&self) -> bool {
        self.rules.config.preset != Preset::Off && self.rules.config.parts.geometry
    }

    /// Whether flow is useful only for features with depth.
    pub(crate) fn measures_flow_by_depth(&self) -> bool {
        self.rules.config.preset == Preset::Default
    }

    fn wants_detections(&self) -> bool {
        self.rules.config.preset != Preset::Off && self.rules.config.parts.objects
    }

    /// Resets after a change of the reference frame.
    pub(crate) fn forget(&mut self) {
        self.objects.forget();
        self.surfaces = Arc::new(Surfaces::new(&self.rules.cells));
        self.history = History::default();
        self.movers = Arc::default();
        self.present = None;
    }

    /// Drops state that depends on stamps after the clock was set back. The history is dropped with the next frame.
    pub(crate) fn forget_times(&mut self) {
        self.objects.forget();
    }

    /// Takes detections of the next frame.
    pub(crate) fn receive(&mut self, detections: Detections) {
        if self.wants_detections() {
            self.detected = true;
            self.waiting = Some(detections);
        }
    }

    /// Ends a frame. Returns the detections since the last frame that could not be used; those of a frame without pose
    /// are dropped.
    pub(crate) fn end_frame(&mut self) -> Unused {
        self.unused.without_pose += u32::from(self.waiting.take().is_some());
        std::mem::take(&mut self.unused)
    }

    /// Judges the features of a frame. Returns the verdicts and the filter for the next frame.
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
            Preset::Paper => {
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

    /// The objects that may move. Without D an object has no depth range and holds everything in its box.
    fn movers(&self, objects: &[Object], stamp: f64) -> Vec<Mover> {
        let mut movers = semantic::movers(objects, &self.rules.weights, stamp, self.rules.coast);
        if !self.rules.config.parts.depth {
            movers.iter_mut().for_each(|m| m.range = None);
        }
        movers
    }

    /// Preset `default`: verdicts from the surfaces that features lie on.
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
        workers::fill(verdicts, |i| {
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

    /// Adds the last judged frame to the history, once its pose is known.
    pub(crate) fn remember(&mut self, place: &CapturePose, memory: &mut Memory) {
        if let Some((frame, stamp, grid)) = self.present.take() {
            let moving = self.surfaces.motion.iter().map(|o| *o > MOVES);
            let known = (moving, place);
            self.history
                .push(frame, stamp, grid, known, &mut memory.spent);
        }
    }

    /// Processes detections of an earlier frame. If it became a keyframe (`data`), returns its features that move;
    /// `None` if there are none.
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

    /// Updates each object with the static share of its surface.
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
