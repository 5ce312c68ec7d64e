//! What is measured of a live run, and how its threads ended.

use crate::audience::Missed;
use stillpoint_imaging::FrameId;

/// A stage with a thread of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Poses.
    Tracking,
    /// The network, or what stands for it.
    Detection,
    /// The map.
    Mapping,
    /// Loops.
    Looping,
}

impl Stage {
    /// All stages, by the way of the data.
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

/// What was measured at one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameTiming {
    /// The frame.
    pub frame: FrameId,
    /// From its arrival to its pose, s.
    pub latency: f64,
    /// Of that, the time until tracking took it, s.
    pub waited: f64,
    /// By how much its stamp is later than that of the newest detections tracking knew, s; none before the first ones.
    pub detections_age: Option<f64>,
    /// Time since the view of the map that was used had been published, s; none before the first one.
    pub view_age: Option<f64>,
    /// Keypoints that were wanted.
    pub features: u32,
    /// Keyframes that this view did not hold yet.
    pub keyframes_behind: u32,
    /// Messages that mapping had not taken yet when the pose was there.
    pub mapping_queue: u32,
    /// Messages that looping had not taken yet then.
    pub looping_queue: u32,
}

/// What was measured at one answer of the detector.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AnswerTiming {
    /// The frame that it is about.
    pub frame: FrameId,
    /// From the frame's arrival until tracking took the answer, s.
    pub latency: f64,
}

/// What was measured of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LiveStatistics {
    /// Frames that arrived and were not refused.
    pub arrived: u64,
    /// Frames that came twice or out of order, or do not fit the camera.
    pub refused: u64,
    /// Frames that a newer one replaced before tracking could take them, by their numbers.
    pub dropped: Vec<FrameId>,
    /// Every frame that was tracked, in order.
    pub frames: Vec<FrameTiming>,
    /// Every answer of the detector that tracking took, in that order.
    pub detections: Vec<AnswerTiming>,
    /// What did not reach a subscriber because it was too slow; by name, in the order in which they subscribed.
    pub subscribers: Vec<(String, Missed)>,
}

/// How a thread ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum WorkerEnd {
    /// It did all that was to do.
    Finished,
    /// It panicked; the others went on without it.
    Panicked(String),
    /// It did not answer any more and was left to itself.
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
    /// Detection; none without a detector. Without it objects are expected where they were seen to go.
    pub detection: Option<WorkerEnd>,
    /// Mapping. Without it the map stays as it was.
    pub mapping: WorkerEnd,
    /// Looping. Without it no loop is closed any more.
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
