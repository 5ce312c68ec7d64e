//! What one pass of a stream through the system gave.

use crate::run::live_report::LiveRun;
use crate::run::submaps::Submap;
use crate::run::summary::{StagesJson, TrackingJson};
use std::sync::Arc;
use stillpoint::datasets::StampedPose;
use stillpoint::dense::FinalPose;
use stillpoint::imaging::FrameId;
use stillpoint::map::{Map, MapView};
use stillpoint::slam::{PoseCovariance, RunLog, Timing};

/// What a pass gave.
pub(crate) struct Session {
    /// Which frames were tracked.
    pub(crate) tracking: TrackingJson,
    /// What the other stages did.
    pub(crate) stages: StagesJson,
    /// The poses, by submap.
    pub(crate) poses: Poses,
    /// What became of every frame, as `frames.csv` has it.
    pub(crate) frames_csv: String,
    /// When the parts of a frame are exposed, as estimated in the end.
    pub(crate) timing: Timing,
    /// The final map, to be looked at.
    pub(crate) view: Arc<MapView>,
    /// The map itself, to be kept; none where mapping ended in the midst of its work.
    pub(crate) map: Option<Map>,
    /// The user ended it early.
    pub(crate) interrupted: bool,
    /// From the first frame to the last, s.
    pub(crate) seconds: f64,
    /// In which order the stages took their messages; none of a replay, which has it from the run.
    pub(crate) log: Option<RunLog>,
    /// Of a replay that came to the end of its log: whether the trajectory is that of the run.
    pub(crate) agrees: Option<bool>,
    /// What was measured of a live run.
    pub(crate) live: Option<LiveRun>,
}

/// The poses of a pass. Those of the submap with most frames are the trajectory.
#[derive(Default)]
pub(crate) struct Poses {
    /// Final poses of the tracked frames.
    pub(crate) final_poses: Vec<StampedPose>,
    /// Their frames.
    pub(crate) of_frames: Vec<FrameId>,
    /// How uncertain they are; empty where nothing tells.
    pub(crate) covariances: Vec<PoseCovariance>,
    /// Poses as known at each of these frames; without those that were in another submap then, whose poses were in another frame of
    /// reference.
    pub(crate) online: Vec<StampedPose>,
    /// Final poses of the keyframes.
    pub(crate) keyframes: Vec<StampedPose>,
    /// Poses in other submaps, each in a frame of reference of its own.
    pub(crate) other_submaps: Vec<Submap>,
}

impl Poses {
    /// The final poses with their frames.
    pub(crate) fn of_each_frame(&self) -> Vec<FinalPose> {
        let of = |(frame, pose): (&FrameId, &StampedPose)| FinalPose {
            frame: *frame,
            stamp: pose.stamp,
            world_from_camera: pose.world_from_camera,
        };
        self.of_frames
            .iter()
            .zip(&self.final_poses)
            .map(of)
            .collect()
    }
}
