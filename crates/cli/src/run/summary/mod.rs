//! The figures of a run as they stand in `summary.json`, written by `run` and `demo`, read by `bench`.

pub(crate) mod detector;
pub(crate) mod inertial;
pub(crate) mod odometry;
pub(crate) mod score;
pub(crate) mod still;

use crate::dense::DenseJson;
use crate::machine::Machine;
use crate::map::file::SavedMap;
use crate::run::live_report::LiveJson;
pub(crate) use crate::run::summary::detector::DetectorJson;
pub(crate) use crate::run::summary::inertial::InertialJson;
pub(crate) use crate::run::summary::odometry::OdometryJson;
pub(crate) use crate::run::summary::score::{Accuracy, ScoreJson, StatisticsJson};
pub(crate) use crate::run::summary::still::{StillJson, StillStretch};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use stillpoint::evaluation::timing::Stats;
use stillpoint::map::MapView;
use stillpoint::slam::{FrameCounts, LoopOutcome, LoopReport};

/// All figures of one run, in the order of the file: each part stands where its fields stood when they were one list.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Summary {
    /// What was run on.
    pub(crate) input: Input,
    #[serde(flatten)]
    pub(crate) tracking: TrackingJson,
    #[serde(flatten)]
    pub(crate) stages: StagesJson,
    /// True when the user ended the run early.
    pub(crate) interrupted: bool,
    #[serde(flatten)]
    pub(crate) map: MapJson,
    #[serde(flatten)]
    pub(crate) kept: KeptJson,
    #[serde(flatten)]
    pub(crate) pace: PaceJson,
    /// Instruction set of the kernels.
    pub(crate) simd: String,
    /// Where it ran, and the program's version.
    pub(crate) machine: Machine,
    /// Against the ground truth, where there is any.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) accuracy: Option<Accuracy>,
    /// What other outputs say of themselves, by their names.
    #[serde(flatten)]
    pub(crate) sections: BTreeMap<String, Value>,
}

/// Which frames were tracked.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct TrackingJson {
    /// Frames that went through the system.
    pub(crate) frames: usize,
    /// Frames that could not be read and were skipped.
    pub(crate) skipped: usize,
    /// Frames with a pose in `trajectory.txt`.
    pub(crate) tracked: usize,
    /// Of these, frames that were tracked while it was undecided who moves.
    #[serde(default)]
    pub(crate) undecided: usize,
    /// The camera's rolling shutter.
    #[serde(default)]
    pub(crate) readout: ReadoutJson,
    /// Stretches of frames without a pose.
    pub(crate) lost: Vec<LostStretch>,
    /// Stretches of frames that repeat an image.
    #[serde(default)]
    pub(crate) still: Vec<StillStretch>,
    /// The submaps that frames have poses in; the first is that of `trajectory.txt`.
    #[serde(default)]
    pub(crate) submaps: Vec<SubmapJson>,
}

/// What the stages and sensors beside tracking did.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct StagesJson {
    /// The object detector.
    #[serde(default)]
    pub(crate) detector: DetectorJson,
    /// The static filter's verdicts.
    #[serde(default)]
    pub(crate) features: FeaturesJson,
    /// What became of the candidates for loops.
    #[serde(default)]
    pub(crate) loops: LoopsJson,
    /// The inertial sensor, where there was one.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) inertial: Option<InertialJson>,
    /// The odometry, where there was any.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) odometry: Option<OdometryJson>,
}

/// The final map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct MapJson {
    /// Keyframes.
    pub(crate) keyframes: usize,
    /// Landmarks.
    pub(crate) landmarks: usize,
    /// Versions of the map that the mapper published.
    pub(crate) map_versions: u64,
}

impl MapJson {
    /// Of a map.
    pub(crate) fn of(view: &MapView) -> Self {
        Self {
            keyframes: view.keyframe_count(),
            landmarks: view.landmark_count(),
            map_versions: view.version(),
        }
    }
}

/// What outputs that the report speaks of left.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct KeptJson {
    /// Where the map was saved.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) map: Option<SavedMap>,
    /// The surface of `--dense`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) dense: Option<DenseJson>,
}

/// How long it took, and how much memory.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct PaceJson {
    /// From the first frame to the last, s, reading included.
    pub(crate) seconds: f64,
    /// Milliseconds per frame of each stage, over the frames in which it ran.
    pub(crate) timing_ms: Vec<StageTiming>,
    /// What was measured of a live run.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) live: Option<LiveJson>,
    /// Largest amount of memory held, bytes; absent where the system does not say.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) peak_memory_bytes: Option<u64>,
}

/// A camera's rolling shutter, as estimated in the end or as stated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct ReadoutJson {
    /// Time from the exposure of the first row to that of the last, s.
    pub(crate) seconds: f64,
    /// Its standard deviation, s; 0 where it is stated.
    pub(crate) sigma: f64,
}

/// What was run on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Input {
    /// Folder or scene.
    pub(crate) name: String,
    /// Layout, or `simulated`.
    pub(crate) layout: String,
    /// Where the camera comes from.
    pub(crate) camera: String,
}

/// Frames without a pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct LostStretch {
    /// First frame.
    pub(crate) first: u32,
    /// Last frame.
    pub(crate) last: u32,
    /// Why the first of them has no pose.
    pub(crate) reason: String,
    /// From the first of them to the next frame with a pose, s.
    #[serde(default)]
    pub(crate) seconds: f64,
    /// What ended it: `found again`, `a map began`, `the end`.
    #[serde(default)]
    pub(crate) then: String,
}

/// A submap of the final map, in a frame of reference of its own.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct SubmapJson {
    /// The keyframe that began it.
    pub(crate) id: u32,
    /// Frames with a pose in it.
    pub(crate) frames: usize,
    /// Keyframes.
    pub(crate) keyframes: usize,
    /// The file of their poses.
    pub(crate) trajectory: String,
}

/// Sums over all frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct FeaturesJson {
    /// Extracted keypoints.
    pub(crate) keypoints: u64,
    /// Keypoints rejected because they move.
    pub(crate) dynamic: u64,
    /// Their share of all keypoints, 0 to 1.
    pub(crate) dynamic_share: f64,
    /// Keypoints that seemed to move and were used all the same because too few others were left.
    pub(crate) released: u64,
    /// Landmarks taken out of the map because late detections said that they move.
    pub(crate) rejudged_landmarks: u64,
    /// Keyframes of the first frames of a map that were taken back, as these had ridden on what moves.
    #[serde(default)]
    pub(crate) revoked_keyframes: u64,
}

impl FeaturesJson {
    /// Adds a frame.
    pub(crate) fn add(&mut self, counts: &FrameCounts) {
        self.keypoints += u64::from(counts.keypoints);
        self.dynamic += u64::from(counts.dynamic);
        self.released += u64::from(counts.released);
        self.dynamic_share = self.dynamic as f64 / self.keypoints.max(1) as f64;
    }
}

/// What became of the candidates for loops.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct LoopsJson {
    /// Loops that corrected the map.
    pub(crate) closed: u32,
    /// Submaps that became part of another.
    #[serde(default)]
    pub(crate) joined: u32,
    /// Keyframes that looked like older ones, of which too little said that they show the same place. Most of them do not.
    #[serde(alias = "rejected")]
    pub(crate) set_aside: u32,
}

impl LoopsJson {
    /// Counts a report.
    pub(crate) fn add(&mut self, report: &LoopReport) {
        match report.outcome {
            LoopOutcome::Closed if report.joined.is_some() => self.joined += 1,
            LoopOutcome::Closed => self.closed += 1,
            _ => self.set_aside += 1,
        }
    }
}

/// Milliseconds per frame of one stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct StageTiming {
    /// Name of its span.
    pub(crate) stage: String,
    /// Frames in which it ran.
    pub(crate) n: usize,
    /// Median, ms.
    pub(crate) median: f64,
    /// 95th percentile, ms.
    pub(crate) p95: f64,
    /// 99th percentile, ms.
    pub(crate) p99: f64,
    /// Largest, ms.
    pub(crate) max: f64,
    /// Mean, ms.
    pub(crate) mean: f64,
}

impl StageTiming {
    pub(crate) fn new(stage: &str, s: Stats) -> Self {
        Self {
            stage: stage.to_owned(),
            n: s.n,
            median: s.median,
            p95: s.p95,
            p99: s.p99,
            max: s.max,
            mean: s.mean,
        }
    }

    pub(crate) fn stats(&self) -> Stats {
        Stats {
            n: self.n,
            median: self.median,
            p95: self.p95,
            p99: self.p99,
            max: self.max,
            mean: self.mean,
        }
    }
}
