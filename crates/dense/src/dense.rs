//! The subscriber that fuses a run's frames to a dense map and follows its corrections.
//!
//! The result depends only on the received frames: each frame is used with the map version of its own tracking, so that the order in which
//! events of different stages arrive does not matter. Frames are integrated at their tracked poses, and kept. When the map moves some of
//! them by more than half a voxel, a second volume is filled from all kept frames, a few per event, and then replaces the first. At the end
//! all kept frames are integrated once more, in time order, at the final poses.

use crate::config::{DenseConfig, DenseConfigError};
use crate::course::Course;
use crate::kept::{Anchor, Kept, Packing};
use crate::moving::{add_people, spread};
use crate::observation::{Observation, Rectifier};
use crate::poses::{FinalPose, at_depth};
use crate::world::DenseMap;
use std::collections::{BTreeSet, VecDeque};
use stillpoint_detection::MotionWeights;
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::{FrameId, RgbdFrame, Simd};
use stillpoint_map::SubmapId;
use stillpoint_slam::{Event, FrameEvent, FrameReport, Subscriber};

/// Divisor of the weight of frames in which it is undecided which regions move.
const UNDECIDED: u8 = 8;
/// Distance at which rotations are compared with translations, m.
const TYPICAL_DEPTH: f64 = 2.0;

/// Counters of the fusion.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DenseCounts {
    /// Number of integrated frames.
    pub integrated: usize,
    /// Number of those that are kept for re-integration.
    pub kept: usize,
    /// Number of frames that dropped their depth: they do not follow later corrections.
    pub given_up: usize,
    /// Number of complete re-integrations during the run, due to corrections.
    pub rebuilt: usize,
    /// Number of frames that were due and came without their image.
    pub without_image: usize,
    /// Size of the kept frames, bytes.
    pub kept_bytes: usize,
}

/// A volume that is filled to replace the current one.
struct Rebuild {
    map: DenseMap,
    next: usize,
    used: Vec<Option<Se3>>,
}

/// Fuses the frames of a run.
pub struct Dense {
    config: DenseConfig,
    simd: Simd,
    rectifier: Rectifier,
    weights: MotionWeights,
    course: Course,
    /// Frames to use, instead of choosing them by stamp.
    only: Option<BTreeSet<FrameId>>,
    last_stamp: Option<f64>,
    kept: VecDeque<Kept>,
    kept_bytes: usize,
    /// The volume of the frames that dropped their depth.
    base: DenseMap,
    map: DenseMap,
    rebuild: Option<Rebuild>,
    /// The previous volume, kept to reuse its memory: freeing and allocating it in small pieces would fragment memory, and double that of
    /// the process.
    spare: Option<DenseMap>,
    taken: Vec<FrameId>,
    counts: DenseCounts,
    scratch: Scratch,
}

#[derive(Default)]
struct Scratch {
    seen: Observation,
    again: Observation,
    moving: Vec<bool>,
    packing: Packing,
}

impl Dense {
    /// A subscriber for a camera, before the first frame.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn new(
        config: &DenseConfig,
        camera: &Camera,
        simd: Simd,
    ) -> Result<Self, DenseConfigError> {
        config.validate()?;
        let map = DenseMap::new(config, simd);
        Ok(Self {
            rectifier: Rectifier::new(camera, config),
            config: config.clone(),
            simd,
            weights: MotionWeights::default(),
            course: Course::default(),
            only: None,
            last_stamp: None,
            kept: VecDeque::new(),
            kept_bytes: 0,
            base: map.clone(),
            map,
            rebuild: None,
            spare: None,
            taken: Vec::new(),
            counts: DenseCounts::default(),
            scratch: Scratch::default(),
        })
    }

    /// For a run that starts with a map of this many keyframe ids.
    #[must_use]
    pub fn with_first_keyframe(mut self, ids: usize) -> Self {
        self.course.begin_with(ids);
        self
    }

    /// Sets the weights that decide which objects move by themselves, instead of the defaults.
    #[must_use]
    pub fn with_weights(mut self, weights: MotionWeights) -> Self {
        self.weights = weights;
        self
    }

    /// Continues an existing map, which keeps its pose.
    #[must_use]
    pub fn starting_with(mut self, map: DenseMap) -> Self {
        self.base = map.clone();
        self.map = map;
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

    /// The current map.
    #[must_use]
    pub fn map(&self) -> &DenseMap {
        &self.map
    }

    /// The current counters.
    #[must_use]
    pub fn counts(&self) -> DenseCounts {
        DenseCounts {
            kept: self.kept.len(),
            kept_bytes: self.kept_bytes,
            ..self.counts.clone()
        }
    }

    /// Memory held, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let rebuild = self.rebuild.as_ref().map(|r| &r.map);
        let others = rebuild.into_iter().chain(&self.spare);
        let others: usize = others.map(DenseMap::bytes).sum();
        self.map.bytes() + self.base.bytes() + others + self.kept_bytes
    }

    /// Re-integrates all kept frames in time order at the final poses; frames without one are left out.
    #[must_use]
    pub fn finish(mut self, poses: &[FinalPose]) -> DenseMap {
        (self.rebuild, self.spare) = (None, None);
        let mut map = self.base;
        let seen = &mut self.scratch.again;
        for kept in &self.kept {
            if let Some(pose) = at_depth(poses, kept.frame, kept.depth_stamp) {
                kept.unpack(seen);
                map.integrate(seen, &self.rectifier.camera, &pose);
            }
        }
        map
    }

    fn take(&mut self, event: &FrameEvent) {
        let report = &event.report;
        self.follow(report);
        if let Some(pose) = report.world_from_camera.filter(|_| self.is_due(report)) {
            match &event.frame {
                Some(frame) => self.integrate(frame, report, pose),
                None => self.counts.without_image += 1,
            }
        }
        self.go_on_rebuilding();
    }

    fn is_due(&self, report: &FrameReport) -> bool {
        if let Some(only) = &self.only {
            return only.contains(&report.frame);
        }
        // Tolerates jitter of the stamps.
        let least = 0.9 * self.config.interval;
        self.last_stamp
            .is_none_or(|last| (report.stamp - last).abs() >= least)
    }

    fn integrate(&mut self, frame: &RgbdFrame, report: &FrameReport, online: Se3) {
        self.last_stamp = Some(report.stamp);
        let mut scratch = std::mem::take(&mut self.scratch);
        spread(&report.segments, frame, &mut scratch.moving);
        add_people(&report.objects, &self.weights, frame, &mut scratch.moving);
        let doubt = if report.is_undecided() { UNDECIDED } else { 1 };
        let seen = &mut scratch.seen;
        self.rectifier.take(frame, &scratch.moving, doubt, seen);
        let anchor = self.course.anchor(report, online);
        let mut kept = Kept::pack(
            seen,
            frame.id,
            frame.depth_stamp,
            anchor,
            &mut scratch.packing,
        );
        kept.used = self.pose(&anchor);
        if let Some(pose) = &kept.used {
            self.map.integrate(seen, &self.rectifier.camera, pose);
        }
        self.scratch = scratch;
        self.taken.push(frame.id);
        self.counts.integrated += 1;
        self.kept_bytes += kept.bytes();
        self.kept.push_back(kept);
        while self.kept_bytes > self.config.depth_budget && self.kept.len() > 1 {
            self.give_up();
        }
    }

    /// The submap of the volume: that of the first kept frame.
    fn submap(&self) -> Option<SubmapId> {
        let view = self.course.view();
        self.kept
            .iter()
            .find_map(|k| k.anchor.pose(view).and_then(|p| p.1))
    }

    /// The pose of a frame, if it is in the submap of the volume.
    fn pose(&self, anchor: &Anchor) -> Option<Se3> {
        let (pose, submap) = anchor.pose(self.course.view())?;
        let main = self.submap();
        (main.is_none() || submap.is_none() || submap == main).then_some(pose)
    }

    /// Switches to the map version that tracking uses.
    fn follow(&mut self, report: &FrameReport) {
        let changed = self.course.follow(report);
        if changed && self.rebuild.is_none() && self.has_moved() {
            let map = match self.spare.take() {
                Some(mut spare) => {
                    spare.clone_from(&self.base);
                    spare
                }
                None => self.base.clone(),
            };
            self.rebuild = Some(Rebuild {
                map,
                next: 0,
                used: Vec::new(),
            });
        }
    }

    /// Whether any integrated frame is off by more than half a voxel.
    fn has_moved(&self) -> bool {
        let (view, main) = (self.course.view(), self.submap());
        self.kept.iter().any(|k| {
            let now = k.anchor.pose(view);
            let now = now.filter(|p| p.1.is_none() || main.is_none() || p.1 == main);
            match (now, &k.used) {
                (None, None) => false,
                (Some((now, _)), Some(then)) => {
                    let step = (then.inverse() * now).log();
                    let (shift, turn) = (step.fixed_rows::<3>(0), step.fixed_rows::<3>(3));
                    shift.norm() + TYPICAL_DEPTH * turn.norm() > 0.5 * self.config.voxel
                }
                _ => true,
            }
        })
    }

    /// Re-integrates a few kept frames, if a rebuild is in progress.
    fn go_on_rebuilding(&mut self) {
        let Some(mut rebuild) = self.rebuild.take() else {
            return;
        };
        for _ in 0..self.config.rebuild_per_event {
            let Some(kept) = self.kept.get(rebuild.next) else {
                break;
            };
            let pose = self.pose(&kept.anchor);
            if let Some(pose) = &pose {
                let seen = &mut self.scratch.again;
                kept.unpack(seen);
                rebuild.map.integrate(seen, &self.rectifier.camera, pose);
            }
            rebuild.used.push(pose);
            rebuild.next += 1;
        }
        if rebuild.next < self.kept.len() {
            self.rebuild = Some(rebuild);
            return;
        }
        self.spare = Some(std::mem::replace(&mut self.map, rebuild.map));
        for (kept, pose) in self.kept.iter_mut().zip(rebuild.used) {
            kept.used = pose;
        }
        self.counts.rebuilt += 1;
    }

    /// Drops the depth of the oldest frame, preferably of one that is no keyframe: it stays at its current pose.
    fn give_up(&mut self) {
        let old = self.kept.len() - 1;
        let redundant = self
            .kept
            .iter()
            .take(old)
            .position(|k| k.anchor.own.is_none());
        let at = redundant.unwrap_or(0);
        let Some(pose) = self.kept.get(at).map(|k| self.pose(&k.anchor)) else {
            return;
        };
        let Some(kept) = self.kept.remove(at) else {
            return;
        };
        self.counts.given_up += 1;
        self.kept_bytes -= kept.bytes();
        let seen = &mut self.scratch.again;
        kept.unpack(seen);
        if let Some(pose) = &pose {
            self.base.integrate(seen, &self.rectifier.camera, pose);
        }
        if let Some(rebuild) = &mut self.rebuild {
            if at < rebuild.next {
                rebuild.next -= 1;
                rebuild.used.remove(at);
            } else if let Some(pose) = &pose {
                rebuild.map.integrate(seen, &self.rectifier.camera, pose);
            }
        }
    }

    /// The instruction set in use.
    #[must_use]
    pub fn simd(&self) -> Simd {
        self.simd
    }
}

impl Subscriber for Dense {
    fn receive(&mut self, event: &Event) {
        if let Some(view) = event.view() {
            self.course.expect(view);
        }
        if let Event::Frame(frame) = event {
            self.take(frame);
        }
    }
}
