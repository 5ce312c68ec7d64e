//! Final camera poses of frames.

use stillpoint_geometry::Se3;
use stillpoint_imaging::FrameId;

/// Maximum time between poses for interpolation, s.
const LONGEST_GAP: f64 = 0.2;

/// The final pose of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FinalPose {
    /// The frame.
    pub frame: FrameId,
    /// Its colour stamp, s.
    pub stamp: f64,
    /// Its pose.
    pub world_from_camera: Se3,
}

/// The pose of a frame at the time of its depth, interpolated between the surrounding frames.
pub(crate) fn at_depth(poses: &[FinalPose], frame: FrameId, stamp: f64) -> Option<Se3> {
    let at = poses.binary_search_by_key(&frame, |p| p.frame).ok()?;
    let own = &poses[at];
    let other = if stamp < own.stamp {
        at.checked_sub(1).map(|i| &poses[i])
    } else {
        poses.get(at + 1)
    };
    let Some(other) = other else {
        return Some(own.world_from_camera);
    };
    let gap = other.stamp - own.stamp;
    let share = (stamp - own.stamp) / gap;
    if !(0.0..=1.0).contains(&share) || gap.abs() > LONGEST_GAP {
        return Some(own.world_from_camera);
    }
    Some(
        own.world_from_camera
            .interpolate(&other.world_from_camera, share),
    )
}
