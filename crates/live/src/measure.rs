//! Measurements of a live run, and how its threads ended.

use crate::audience::Missed;
use stillpoint_imaging::FrameId;

/// A stage with its own thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Camera tracking.
    Tracking,
    /// Object detection.
    Detection,
    /// Map building.
    Mapping,
    /// Loop closing.
    Looping,
}

impl Stage {
    /// All stages, in the order of the data flow.
    pub const ALL: [Self; 4] = [
        Self::Tracking,
        Self::Detection,
        Self::Mapping,
        Self::Looping,
    ];
}

impl std::fmt::Display for Stage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Tracking => "tracking",
            Self::Detection => "detection",
            Self::Mapping => "mapping",
            Self::Looping => "looping",
        })
    }
}

/// Measurements at one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameTiming {
    /// The frame.
    pub frame: FrameId,
    /// From its arrival to its pose, s.
    pub latency: f64,
    /// Part of the latency until tracking took it, s.
    pub waited: f64,
    /// Age of the newest detections known to tracking, relative to the frame's stamp, s; `None` before the first.
    pub detections_age: Option<f64>,
    /// Age of the map view in use, s; `None` before the first.
    pub view_age: Option<f64>,
    /// Requested number of keypoints.
    pub features: u32,
    /// Number of keyframes that this view did not contain yet.
    pub keyframes_behind: u32,
    /// Number of messages queued for mapping when the pose was ready.
    pub mapping_queue: u32,
    /// Number of messages queued for looping at that time.
    pub looping_queue: u32,
}

/// Measurements at one detector answer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AnswerTiming {
    /// Its frame.
    pub frame: FrameId,
    /// From the frame's arrival until tracking took the answer, s.
    pub latency: f64,
}

/// Measurements of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LiveStatistics {
    /// Number of frames that arrived and were not refused.
    pub arrived: u64,
    /// Number of frames that came twice or out of order, or do not match the camera.
    pub refused: u64,
    /// Frames replaced by a newer one before tracking took them.
    pub dropped: Vec<FrameId>,
    /// Every tracked frame, in order.
    pub frames: Vec<FrameTiming>,
    /// Every detector answer that tracking took, in that order.
    pub detections: Vec<AnswerTiming>,
    /// Events missed by slow subscribers, by name, in the order of subscription.
    pub subscribers: Vec<(String, Missed)>,
}

/// How a thread ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum WorkerEnd {
    /// It completed its work.
    Finished,
    /// It panicked; the others continued without it.
    Panicked(String),
    /// It stopped answering and was abandoned.
    GivenUp,
}

impl std::fmt::Display for WorkerEnd {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Finished => f.write_str("finished"),
            Self::Panicked(reason) => write!(f, "panicked: {reason}"),
            Self::GivenUp => f.write_str("did not answer any more and was given up"),
        }
    }
}

/// How the threads of a run ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ended {
    /// Tracking. Without it there are no further poses.
    pub tracking: WorkerEnd,
    /// Detection; `None` without a detector. Without it objects are only predicted.
    pub detection: Option<WorkerEnd>,
    /// Mapping. Without it the map stays unchanged.
    pub mapping: WorkerEnd,
    /// Looping. Without it no further loops are closed.
    pub looping: WorkerEnd,
}

impl Ended {
    /// The stages that did not finish.
    pub fn failures(&self) -> impl Iterator<Item = (Stage, &WorkerEnd)> {
        let all = [
            (Stage::Tracking, Some(&self.tracking)),
            (Stage::Detection, self.detection.as_ref()),
            (Stage::Mapping, Some(&self.mapping)),
            (Stage::Looping, Some(&self.looping)),
        ];
        all.into_iter()
            .filter_map(|(stage, end)| end.map(|end| (stage, end)))
            .filter(|(_, end)| **end != WorkerEnd::Finished)
    }
}
