//! The trajectory, as tracked and after all corrections.

use crate::anchored_pose::AnchoredPose;
use crate::fingerprint::Fingerprint;
use crate::shutter::TYPICAL_DEPTH;
use crate::smoothing::smooth;
use stillpoint_geometry::{Se3, Vec3, so3};
use stillpoint_imaging::FrameId;
use stillpoint_map::{KeyframeId, MapView};

/// One frame of the trajectory, with its pose relative to a keyframe that may still be optimised. Rewritten only by
/// retracing ([`Retracer`](crate::Retracer)).
#[derive(Clone, Copy, Debug)]
pub struct TrajectoryEntry {
    /// The frame.
    pub frame: FrameId,
    /// Its colour stamp, s.
    pub stamp: f64,
    /// Pose relative to keyframes.
    pub pose: AnchoredPose,
    /// Inlier landmark matches.
    pub inliers: u32,
    /// Whether the pose was propagated without enough visual measurements
    /// ([`Outcome::Carried`](crate::Outcome::Carried)).
    pub carried: bool,
}

/// All frames with a pose, in order.
#[derive(Clone, Debug, Default)]
pub struct Trajectory {
    entries: Vec<TrajectoryEntry>,
    revision: u64,
}

/// Later frames.
impl Extend<TrajectoryEntry> for Trajectory {
    fn extend<I: IntoIterator<Item = TrajectoryEntry>>(&mut self, entries: I) {
        self.entries.extend(entries);
    }
}

impl Trajectory {
    pub(crate) fn push(&mut self, entry: TrajectoryEntry) {
        self.entries.push(entry);
    }

    /// Replaces the entries from one frame to another by `new`, which is in order.
    pub(crate) fn replace(&mut self, first: FrameId, last: FrameId, new: Vec<TrajectoryEntry>) {
        let from = self.entries.partition_point(|e| e.frame < first);
        let to = self.entries.partition_point(|e| e.frame <= last);
        self.entries.splice(from..to.max(from), new);
        self.revision += 1;
    }

    pub(crate) fn keep_newest(&mut self, most: usize) {
        let old = self.entries.len().saturating_sub(most);
        if old > 0 {
            self.entries.drain(..old);
            self.revision += 1;
        }
    }

    /// Number of times that existing entries were replaced or dropped.
    #[must_use]
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The entries, in the order of frames.
    #[must_use]
    pub fn entries(&self) -> &[TrajectoryEntry] {
        &self.entries
    }

    /// Final pose of every entry: that of the keyframe made from the frame, else relative to its reference keyframe in
    /// `view`. Culled keyframes resolve through their tombstones; an entry without keyframes in `view` keeps its online
    /// pose.
    ///
    /// Corrections of a keyframe since it was measured (bundle adjustment, loops) are distributed over the frames
    /// before it, linearly in time, if these were measured from the same keyframe, and as far as they exceed the
    /// keyframe's own error.
    pub fn resolve<'a>(
        &'a self,
        view: &'a MapView,
    ) -> impl Iterator<Item = (TrajectoryEntry, Se3)> + 'a {
        let nodes: Vec<Node> = self.entries.iter().filter_map(Node::of(view)).collect();
        let mut next = 0;
        self.entries.iter().map(move |entry| {
            let pose = entry.pose.best_world_from_camera(view);
            next += usize::from(nodes.get(next).is_some_and(|n| n.frame < entry.frame));
            let before = next.checked_sub(1).map(|k| &nodes[k]);
            let learnt = nodes
                .get(next)
                .and_then(|after| after.spread_to(entry, before));
            (*entry, learnt.map_or(pose, |l| l.apply(&pose)))
        })
    }

    /// The final poses of [`Trajectory::resolve`], smoothed to the most probable camera path: their jitter exceeds the
    /// motion of hands and robots. Applies to consecutive frames of one submap without a gap of a quarter of a second;
    /// propagated poses are unchanged. Linear time: a tenth of a second for 10 minutes at 30 Hz.
    #[must_use]
    pub fn smoothed(&self, view: &MapView) -> Vec<(TrajectoryEntry, Se3)> {
        let mut all: Vec<(TrajectoryEntry, Se3)> = self.resolve(view).collect();
        let submap = |e: &TrajectoryEntry| view.submap_of(e.pose.reference);
        let follows = |a: &TrajectoryEntry, b: &TrajectoryEntry| {
            let gap = b.stamp - a.stamp;
            let in_row = (SHORTEST_GAP..LONGEST_GAP).contains(&gap) && submap(a) == submap(b);
            in_row && !a.carried && !b.carried
        };
        for run in all.chunk_by_mut(|a, b| follows(&a.0, &b.0)) {
            let stamps: Vec<f64> = run.iter().map(|(e, _)| e.stamp).collect();
            let mut poses: Vec<Se3> = run.iter().map(|(_, p)| *p).collect();
            smooth(&stamps, &mut poses);
            for ((_, pose), smoothed) in run.iter_mut().zip(poses) {
                *pose = smoothed;
            }
        }
        all
    }

    /// Hash of all bits of every entry and its final pose; equal for bit-identical runs.
    #[must_use]
    pub fn digest(&self, view: &MapView) -> u64 {
        let mut f = Fingerprint::default();
        for (entry, pose) in self.resolve(view) {
            f.number(u64::from(entry.frame.0));
            f.number(entry.stamp.to_bits());
            f.number(u64::from(entry.pose.reference.0));
            f.number(u64::from(entry.inliers));
            if entry.carried {
                f.number(1);
            }
            for pose in [
                &entry.pose.reference_from_camera,
                &entry.pose.online_world_from_camera,
                &pose,
            ] {
                f.pose(pose);
            }
        }
        f.value()
    }
}

/// A frame whose keyframe is in the map.
struct Node {
    frame: FrameId,
    stamp: f64,
    keyframe: KeyframeId,
    /// Keyframe relative to which its pose was measured.
    reference: KeyframeId,
    /// Correction since.
    learnt: Learnt,
}

/// Random error of a keyframe's measurement, rad: a third of a pixel of a usual camera, or 1.4 mm at [`TYPICAL_DEPTH`].
/// It is the keyframe's own and does not apply to the frames before it. A third of a pixel is the measured error of
/// flow (decision 21).
const NOISE: f64 = 0.0007;

/// Maximum interval between frames smoothed together, s: chosen, as long as errors of poses last
/// (`covariance::LASTS_S`).
const LONGEST_GAP: f64 = 0.25;
/// Minimum interval between two frames, s: chosen, as no camera takes 10 000 frames per second.
const SHORTEST_GAP: f64 = 1e-4;

/// Difference of a pose from the measured one.
#[derive(Clone, Copy, Default)]
struct Learnt {
    /// Rotation vector in the world's axes, rad.
    rotation: Vec3,
    /// m.
    translation: Vec3,
}

impl Node {
    fn of(view: &MapView) -> impl Fn(&TrajectoryEntry) -> Option<Self> + use<'_> {
        |entry| {
            let keyframe = entry.pose.keyframe?;
            let own = view.world_from_keyframe(keyframe)?;
            let reference = entry.pose.reference;
            let measured = view.world_from_keyframe(reference)? * entry.pose.reference_from_camera;
            let learnt = Learnt {
                rotation: so3::log(&(own.rotation * measured.rotation.inverse())),
                translation: own.translation - measured.translation,
            };
            Some(Self {
                frame: entry.frame,
                stamp: entry.stamp,
                keyframe,
                reference,
                learnt,
            })
        }
    }

    /// Correction of a frame before this one, if measured from the same keyframe: its share by time since the keyframe
    /// before.
    fn spread_to(&self, entry: &TrajectoryEntry, before: Option<&Self>) -> Option<Learnt> {
        let reference = entry.pose.reference;
        let before = before.filter(|_| reference == self.reference && entry.frame < self.frame)?;
        // The reference keyframe itself has no correction relative to itself.
        let known = before.reference == reference && before.keyframe != reference;
        let from = if known {
            before.learnt
        } else {
            Learnt::default()
        };
        let share = (entry.stamp - before.stamp) / (self.stamp - before.stamp);
        // Wiener gain: the part of the change that exceeds noise.
        let change = from.difference(&self.learnt);
        let trust = change * change / (change * change + NOISE * NOISE);
        Some(from.towards(&self.learnt, share.clamp(0.0, 1.0) * trust))
    }
}

impl Learnt {
    fn towards(&self, to: &Self, share: f64) -> Self {
        Self {
            rotation: self.rotation.lerp(&to.rotation, share),
            translation: self.translation.lerp(&to.translation, share),
        }
    }

    /// Angular difference of a point at [`TYPICAL_DEPTH`] under both corrections, rad.
    fn difference(&self, other: &Self) -> f64 {
        let turned = (self.rotation - other.rotation).norm();
        let moved = (self.translation - other.translation).norm();
        libm::hypot(moved / TYPICAL_DEPTH, turned)
    }

    fn apply(&self, pose: &Se3) -> Se3 {
        Se3 {
            rotation: so3::exp(&self.rotation) * pose.rotation,
            translation: pose.translation + self.translation,
        }
    }
}

#[cfg(test)]
mod tests;
