//! The detector of a run, for `summary.json` and run logs.

use serde::{Deserialize, Serialize};
use stillpoint::detection::{Detector, DetectorInfo, DetectorKind, NoDetector};

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct DetectorJson {
    /// `none`, `scripted` or `onnx`.
    pub(crate) kind: String,
    /// File of the model or script; empty for none.
    pub(crate) name: String,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) sha256: Option<String>,
    /// Runtime of the model, with its version.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) runtime: Option<String>,
    /// Decoder of the model's outputs.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) head: Option<String>,
    /// Width and height of the model's input, px.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) input_px: Option<(usize, usize)>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) threads: Option<usize>,
    /// The library that ran it, unless built in.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) library: Option<String>,
    pub(crate) frames: usize,
    pub(crate) detections: usize,
    /// Detections that were ignored because there were too many in one frame.
    #[serde(skip_serializing_if = "is_none", default)]
    pub(crate) left_out: usize,
    pub(crate) failed_frames: usize,
    /// Answers that came too late to be used.
    #[serde(default)]
    pub(crate) too_late: u64,
    /// Answers that were unusable because their frame has no pose.
    #[serde(default)]
    pub(crate) without_pose: u64,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) remark: Option<String>,
}

/// Zero counts are not written.
#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde hands over references"
)]
fn is_none(count: &usize) -> bool {
    *count == 0
}

impl DetectorJson {
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

    /// `of` with the counts of `self`.
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

    /// Whether it failed on every frame, which makes the run a failure.
    pub(crate) fn never_answered(&self) -> bool {
        self.failed_frames > 0 && self.frames == 0
    }
}
