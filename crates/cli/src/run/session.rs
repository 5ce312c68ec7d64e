//! Results of one pass of a stream through the system.

use crate::run::live_report::LiveRun;
use crate::run::submaps::Submap;
use crate::run::summary::{StagesJson, TrackingJson};
use std::sync::Arc;
use stillpoint::datasets::StampedPose;
use stillpoint::dense::FinalPose;
use stillpoint::imaging::FrameId;
use stillpoint::map::{Map, MapView};
use stillpoint::slam::{PoseCovariance, RunLog, Timing};

pub(crate) struct Session {
    pub(crate) tracking: TrackingJson,
    pub(crate) stages: StagesJson,
    pub(crate) poses: Poses,
    pub(crate) frames_csv: String,
    /// Final estimate of the exposure timing.
    pub(crate) timing: Timing,
    pub(crate) view: Arc<MapView>,
    /// The map itself, for saving; `None` where mapping was interrupted in an update.
    pub(crate) map: Option<Map>,
    pub(crate) interrupted: bool,
    /// From the first frame to the last, s.
    pub(crate) seconds: f64,
    /// The order in which the stages took their messages; `None` in a replay, which has the run's log.
    pub(crate) log: Option<RunLog>,
    /// Whether the trajectory of a complete replay equals that of the run.
    pub(crate) agrees: Option<bool>,
    pub(crate) live: Option<LiveRun>,
}

/// Poses of a pass. The trajectory is that of the submap with most frames.
#[derive(Default)]
pub(crate) struct Poses {
    pub(crate) final_poses: Vec<StampedPose>,
    pub(crate) of_frames: Vec<FrameId>,
    /// Their covariances; empty if unknown.
    pub(crate) covariances: Vec<PoseCovariance>,
    /// Poses as known at each of these frames; without those that were in another submap at the time, with another frame of reference.
    pub(crate) online: Vec<StampedPose>,
    pub(crate) keyframes: Vec<StampedPose>,
    /// Poses in other submaps, each in its own frame of reference.
    pub(crate) other_submaps: Vec<Submap>,
}

impl Poses {
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
