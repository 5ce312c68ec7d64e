//! The trajectory: what each frame's pose was when it was tracked, and what it is after all corrections.

use crate::anchored_pose::AnchoredPose;
use crate::fingerprint::Fingerprint;
use crate::shutter::TYPICAL_DEPTH;
use crate::smoothing::smooth;
use stillpoint_geometry::{Se3, Vec3, so3};
use stillpoint_imaging::FrameId;
use stillpoint_map::{KeyframeId, MapView};

/// One frame of the trajectory. Its pose is relative to a keyframe, whose own pose may still improve. It is rewritten only when the first
/// frames of a map are tracked again ([`Retracer`](crate::Retracer)).
#[derive(Clone, Copy, Debug)]
pub struct TrajectoryEntry {
    /// The frame.
    pub frame: FrameId,
    /// Its colour stamp, s.
    pub stamp: f64,
    /// Its pose, by keyframes.
    pub pose: AnchoredPose,
    /// Landmark matches that agreed with the pose.
    pub inliers: u32,
    /// Whether its direction was carried by the gyroscope, and its place by little or nothing ([`Outcome::Carried`](crate::Outcome::Carried)).
    pub carried: bool,
}

/// All frames in which a pose was measured, in order.
#[derive(Clone, Debug, Default)]
pub struct Trajectory {
    entries: Vec<TrajectoryEntry>,
    revision: u64,
}

/// Frames that were tracked later.
impl Extend<TrajectoryEntry> for Trajectory {
    fn extend<I: IntoIterator<Item = TrajectoryEntry>>(&mut self, entries: I) {
        self.entries.extend(entries);
    }
}

impl Trajectory {
    /// Appends an entry.
    pub(crate) fn push(&mut self, entry: TrajectoryEntry) {
        self.entries.push(entry);
    }

    /// Replaces the entries from one frame to another by `new`, which are in order.
    pub(crate) fn replace(&mut self, first: FrameId, last: FrameId, new: Vec<TrajectoryEntry>) {
        let from = self.entries.partition_point(|e| e.frame < first);
        let to = self.entries.partition_point(|e| e.frame <= last);
        self.entries.splice(from..to.max(from), new);
        self.revision += 1;
    }

    /// Forgets all entries but the newest.
    pub(crate) fn keep_newest(&mut self, most: usize) {
        let old = self.entries.len().saturating_sub(most);
        if old > 0 {
            self.entries.drain(..old);
            self.revision += 1;
        }
    }

    /// How often entries that were there were replaced or forgotten.
    #[must_use]
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The entries, in the order of frames.
    #[must_use]
    pub fn entries(&self) -> &[TrajectoryEntry] {
        &self.entries
    }

    /// The final pose of every entry: that of the keyframe that the frame became, else through its reference keyframe in `view`. A
    /// culled keyframe resolves through its tombstone; an entry none of whose keyframes is in `view` yet keeps its online pose.
    ///
    /// What the map has learnt of a keyframe since it was measured (refinement, loops) holds for the frames that led to it as well:
    /// it is spread over them, linearly in time, where they were measured from the same keyframe, as far as it is more than what the
    /// keyframe itself may have been off by chance.
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

    /// The final poses, each of which is what the camera most probably did by those of [`Trajectory::resolve`] before and after it: these err by themselves, and
    /// no hand and no robot moves a camera as they jitter. Frames in a row of one submap count, without a gap of a quarter of a second; poses that were carried
    /// stay. Takes time in proportion to the entries: a tenth of a second for 10 minutes at 30 Hz.
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

    /// A number that depends on every bit of every entry and of its final pose: two runs with the same one are the same, bit
    /// for bit.
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

/// A frame that became a keyframe which the map holds.
struct Node {
    frame: FrameId,
    stamp: f64,
    keyframe: KeyframeId,
    /// The keyframe that its pose was measured from.
    reference: KeyframeId,
    /// What the map has learnt of it since.
    learnt: Learnt,
}

/// What measuring a keyframe again may change by chance, rad: a third of a pixel of a usual camera, or 1.4 mm at [`TYPICAL_DEPTH`]. That is the
/// keyframe's own error and tells nothing of the frames before it. A third of a pixel is what flow was found to err by (decision 21).
const NOISE: f64 = 0.0007;

/// Frames farther apart than this say nothing about each other's jitter, s: chosen, as long as errors of poses last (`covariance::LASTS_S`).
const LONGEST_GAP: f64 = 0.25;
/// Stamps closer to each other than this cannot belong to two frames, s: chosen, as no camera takes 10 000 frames per second.
const SHORTEST_GAP: f64 = 1e-4;

/// How a pose differs from the one that was measured.
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

    /// What a frame before this one learns from it, if it was measured from the same keyframe: its share by time since the
    /// keyframe before.
    fn spread_to(&self, entry: &TrajectoryEntry, before: Option<&Self>) -> Option<Learnt> {
        let reference = entry.pose.reference;
        let before = before.filter(|_| reference == self.reference && entry.frame < self.frame)?;
        // A keyframe is where it is: who was measured from it has nothing to learn there.
        let known = before.reference == reference && before.keyframe != reference;
        let from = if known {
            before.learnt
        } else {
            Learnt::default()
        };
        let share = (entry.stamp - before.stamp) / (self.stamp - before.stamp);
        // How much of the change is more than chance (a Wiener filter's gain).
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

    /// How far the view of a thing at [`TYPICAL_DEPTH`] is apart by both, rad.
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
