//! The trajectory: what each frame's pose was when it was tracked, and what it is after all corrections.

use crate::anchored_pose::AnchoredPose;
use crate::fingerprint::Fingerprint;
use stillpoint_geometry::Se3;
use stillpoint_imaging::FrameId;
use stillpoint_map::MapView;

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

    /// How often entries that were there were replaced.
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
    pub fn resolve<'a>(
        &'a self,
        view: &'a MapView,
    ) -> impl Iterator<Item = (TrajectoryEntry, Se3)> + 'a {
        let entries = self.entries.iter();
        entries.map(move |e| (*e, e.pose.best_world_from_camera(view)))
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
