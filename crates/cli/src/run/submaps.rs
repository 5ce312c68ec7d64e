//! The final poses of a run by submap, and their files.

use crate::output::submap_file;
use crate::run::summary::SubmapJson;
use std::collections::BTreeMap;
use stillpoint::datasets::StampedPose;
use stillpoint::geometry::Se3;
use stillpoint::imaging::FrameId;
use stillpoint::map::{MapView, SubmapId};
use stillpoint::slam::{FrameState, Trajectory, TrajectoryEntry};

/// Poses of one submap, in its own frame of reference.
pub(crate) struct Submap {
    pub(crate) id: SubmapId,
    pub(crate) keyframes: usize,
    pub(crate) final_poses: Vec<StampedPose>,
    pub(crate) frames: Vec<FrameId>,
    /// Poses as known at each frame, of the frames that were in this submap at the time.
    pub(crate) online_poses: Vec<StampedPose>,
}

impl Submap {
    /// The entries of its frames with their final poses.
    pub(super) fn entries(&self, trajectory: &Trajectory) -> Vec<(TrajectoryEntry, Se3)> {
        let all = trajectory.entries();
        let poses = self.frames.iter().zip(&self.final_poses);
        poses
            .filter_map(|(frame, pose)| {
                let at = all.binary_search_by_key(frame, |e| e.frame).ok()?;
                Some((all[at], pose.world_from_camera))
            })
            .collect()
    }
}

pub(super) fn is_posed(entry: &TrajectoryEntry) -> bool {
    entry.carried || entry.inliers >= FrameState::MIN_INLIERS
}

/// The submaps for `summary.json`, each with the file of its poses.
pub(crate) fn describe(submaps: &[Submap]) -> Vec<SubmapJson> {
    submaps
        .iter()
        .enumerate()
        .map(|(i, submap)| SubmapJson {
            id: submap.id.0,
            frames: submap.final_poses.len(),
            keyframes: submap.keyframes,
            trajectory: submap_file(i, submap.id),
        })
        .collect()
}

/// Frames with their final poses, by submap of the final map, largest first (of equals the oldest); the first one gives the trajectory.
pub(crate) fn by_submap(
    trajectory: &Trajectory,
    view: &MapView,
) -> Vec<(SubmapId, Vec<(TrajectoryEntry, StampedPose)>)> {
    let mut found: BTreeMap<SubmapId, Vec<(TrajectoryEntry, StampedPose)>> = BTreeMap::new();
    for (entry, world_from_camera) in trajectory.smoothed(view) {
        // A keyframe that the map does not contain yet counts as its own submap.
        let submap = view.submap_of(entry.pose.reference);
        let submap = submap.unwrap_or(SubmapId(entry.pose.reference.0));
        if is_posed(&entry) {
            let stamp = entry.stamp;
            let pose = StampedPose {
                stamp,
                world_from_camera,
            };
            found.entry(submap).or_default().push((entry, pose));
        }
    }
    let mut submaps: Vec<_> = found.into_iter().collect();
    submaps.sort_by_key(|(_, poses)| std::cmp::Reverse(poses.len()));
    submaps
}
