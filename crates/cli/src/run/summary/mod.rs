//! The figures of a run as in `summary.json`, written by `run` and `demo`, read by `bench`.

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

/// All figures of one run. The flattened parts keep the order of the fields in the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Summary {
    pub(crate) input: Input,
    #[serde(flatten)]
    pub(crate) tracking: TrackingJson,
    #[serde(flatten)]
    pub(crate) stages: StagesJson,
    pub(crate) interrupted: bool,
    #[serde(flatten)]
    pub(crate) map: MapJson,
    #[serde(flatten)]
    pub(crate) kept: KeptJson,
    #[serde(flatten)]
    pub(crate) pace: PaceJson,
    pub(crate) simd: String,
    pub(crate) machine: Machine,
    /// Against the ground truth, if any.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) accuracy: Option<Accuracy>,
    /// Sections of other outputs, by name.
    #[serde(flatten)]
    pub(crate) sections: BTreeMap<String, Value>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct TrackingJson {
    pub(crate) frames: usize,
    pub(crate) skipped: usize,
    /// Number of frames with a pose in `trajectory.txt`.
    pub(crate) tracked: usize,
    /// Tracked frames in which it was undecided which regions move.
    #[serde(default)]
    pub(crate) undecided: usize,
    #[serde(default)]
    pub(crate) readout: ReadoutJson,
    pub(crate) lost: Vec<LostStretch>,
    #[serde(default)]
    pub(crate) still: Vec<StillStretch>,
    /// The submaps with frame poses; the first is that of `trajectory.txt`.
    #[serde(default)]
    pub(crate) submaps: Vec<SubmapJson>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct StagesJson {
    #[serde(default)]
    pub(crate) detector: DetectorJson,
    #[serde(default)]
    pub(crate) features: FeaturesJson,
    #[serde(default)]
    pub(crate) loops: LoopsJson,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) inertial: Option<InertialJson>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) odometry: Option<OdometryJson>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct MapJson {
    pub(crate) keyframes: usize,
    pub(crate) landmarks: usize,
    /// Number of versions published by the mapper.
    pub(crate) map_versions: u64,
}

impl MapJson {
    pub(crate) fn of(view: &MapView) -> Self {
        Self {
            keyframes: view.keyframe_count(),
            landmarks: view.landmark_count(),
            map_versions: view.version(),
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct KeptJson {
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) map: Option<SavedMap>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) dense: Option<DenseJson>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct PaceJson {
    /// From the first frame to the last, s, reading included.
    pub(crate) seconds: f64,
    /// Milliseconds per frame of each stage, over the frames in which it ran.
    pub(crate) timing_ms: Vec<StageTiming>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) live: Option<LiveJson>,
    /// Peak memory, bytes; absent where the system does not report it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) peak_memory_bytes: Option<u64>,
}

/// Readout of the rolling shutter, as estimated or as stated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct ReadoutJson {
    /// Time from the exposure of the first row to that of the last, s.
    pub(crate) seconds: f64,
    /// Its standard deviation, s; 0 if stated.
    pub(crate) sigma: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Input {
    /// Folder or scene.
    pub(crate) name: String,
    /// Layout, or `simulated`.
    pub(crate) layout: String,
    pub(crate) camera: String,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct LostStretch {
    pub(crate) first: u32,
    pub(crate) last: u32,
    pub(crate) reason: String,
    /// From the first of them to the next frame with a pose, s.
    #[serde(default)]
    pub(crate) seconds: f64,
    /// How it ended: `found again`, `a map began`, `the end`.
    #[serde(default)]
    pub(crate) then: String,
}

/// A submap of the final map, with its own frame of reference.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct SubmapJson {
    pub(crate) id: u32,
    pub(crate) frames: usize,
    pub(crate) keyframes: usize,
    pub(crate) trajectory: String,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct FeaturesJson {
    pub(crate) keypoints: u64,
    /// Keypoints rejected as moving.
    pub(crate) dynamic: u64,
    pub(crate) dynamic_share: f64,
    /// Keypoints judged as moving but used because too few others were left.
    pub(crate) released: u64,
    /// Landmarks removed from the map because late detections showed that they move.
    pub(crate) rejudged_landmarks: u64,
    /// Keyframes from the first frames of a map that were revoked because their poses followed moving objects.
    #[serde(default)]
    pub(crate) revoked_keyframes: u64,
}

impl FeaturesJson {
    pub(crate) fn add(&mut self, counts: &FrameCounts) {
        self.keypoints += u64::from(counts.keypoints);
        self.dynamic += u64::from(counts.dynamic);
        self.released += u64::from(counts.released);
        self.dynamic_share = self.dynamic as f64 / self.keypoints.max(1) as f64;
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct LoopsJson {
    /// Loops that corrected the map.
    pub(crate) closed: u32,
    /// Submaps that were joined to another.
    #[serde(default)]
    pub(crate) joined: u32,
    /// Candidates rejected for lack of evidence that both keyframes show the same place. Most of them do not.
    #[serde(alias = "rejected")]
    pub(crate) set_aside: u32,
}

impl LoopsJson {
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
    pub(crate) n: usize,
    pub(crate) median: f64,
    pub(crate) p95: f64,
    pub(crate) p99: f64,
    pub(crate) max: f64,
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
