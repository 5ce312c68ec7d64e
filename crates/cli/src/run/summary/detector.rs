//! The detector of a run as it stands in `summary.json` and in run logs.

use serde::{Deserialize, Serialize};
use stillpoint::detection::{Detector, DetectorInfo, DetectorKind, NoDetector};

/// What the detector was, so that a result says what it came from, and what it did.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct DetectorJson {
    /// `none`, `scripted` or `onnx`.
    pub(crate) kind: String,
    /// File of the model or script; empty for none.
    pub(crate) name: String,
    /// SHA-256 of that file.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) sha256: Option<String>,
    /// What ran the model, with its version.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) runtime: Option<String>,
    /// How the model's outputs were read.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) head: Option<String>,
    /// Width and height of the model's input, px.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) input_px: Option<(usize, usize)>,
    /// Threads of the model.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) threads: Option<usize>,
    /// The library that ran it, where that is not built in.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) library: Option<String>,
    /// Frames it answered for.
    pub(crate) frames: usize,
    /// Detections in them.
    pub(crate) detections: usize,
    /// Those of them that nobody looked at, since there were so many in one frame.
    #[serde(skip_serializing_if = "is_none", default)]
    pub(crate) left_out: usize,
    /// Frames it failed on.
    pub(crate) failed_frames: usize,
    /// Answers that came too late to be used.
    #[serde(default)]
    pub(crate) too_late: u64,
    /// Answers that could not be used because their frame has no pose.
    #[serde(default)]
    pub(crate) without_pose: u64,
    /// What the user should know of it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) remark: Option<String>,
}

/// Whether a count is worth no line.
#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde hands over references"
)]
fn is_none(count: &usize) -> bool {
    *count == 0
}

impl DetectorJson {
    /// Of this detector, or of none.
    pub(crate) fn of(detector: Option<&dyn Detector>) -> Self {
        Self::new(&detector.map_or_else(|| NoDetector.info(), Detector::info))
    }

    pub(crate) fn new(info: &DetectorInfo) -> Self {
        let kind = match info.kind {
            DetectorKind::None => "none",
            DetectorKind::Scripted => "scripted",
            DetectorKind::Onnx => "onnx",
        };
        Self {
            kind: kind.to_owned(),
            name: info.name.clone(),
            sha256: info.sha256.clone(),
            runtime: info.runtime.clone(),
            head: info.head.clone(),
            input_px: info.input,
            threads: info.threads,
            ..Self::default()
        }
    }

    /// What `of` was, with these counts.
    pub(crate) fn counts_of(&self, of: Self) -> Self {
        Self {
            frames: self.frames,
            detections: self.detections,
            left_out: self.left_out,
            failed_frames: self.failed_frames,
            too_late: self.too_late,
            without_pose: self.without_pose,
            ..of
        }
    }

    /// What ran and how, of a network.
    pub(crate) fn network(&self) -> Option<String> {
        let runtime = self.runtime.as_ref()?;
        let mut parts = Vec::new();
        parts.extend(self.head.as_ref().map(|head| format!("head {head}")));
        parts.extend(self.input_px.map(|(w, h)| format!("input {w}x{h} px")));
        parts.push(match &self.library {
            Some(library) => format!("{runtime} ({library})"),
            None => runtime.clone(),
        });
        parts.extend(self.threads.map(|n| match n {
            1 => "1 thread".to_owned(),
            n => format!("{n} threads"),
        }));
        parts.extend(self.sha256.as_ref().map(|sum| format!("SHA-256 {sum}")));
        Some(parts.join(", "))
    }

    /// Whether it failed on every frame: a result without the detector that was asked for is no success.
    pub(crate) fn never_answered(&self) -> bool {
        self.failed_frames > 0 && self.frames == 0
    }
}
