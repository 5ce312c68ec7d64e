//! The trait behind which all detectors stand, and the one that sees nothing.

use crate::Detections;
use serde::Serialize;
use stillpoint_imaging::{FrameId, RgbdFrame};

/// Something that finds things of known classes in images. It owns its network and whatever state that needs.
pub trait Detector: Send {
    /// Looks at one frame. The boxes are in raw image pixels, best score first.
    ///
    /// # Errors
    /// [`DetectError`] when the frame lacks what the detector looks at or the network fails. The next frame may be
    /// tried as if nothing had happened.
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError>;

    /// What this detector is, for summaries and logs.
    fn info(&self) -> DetectorInfo;

    /// What the user should know once the frames are through, e.g. that a script belongs to another recording.
    fn remark(&self) -> Option<String> {
        None
    }
}

impl<D: Detector + ?Sized> Detector for Box<D> {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        (**self).detect(frame)
    }

    fn info(&self) -> DetectorInfo {
        (**self).info()
    }

    fn remark(&self) -> Option<String> {
        (**self).remark()
    }
}

/// Sort of a detector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum DetectorKind {
    /// None at all: [`NoDetector`].
    None,
    /// Boxes from a file: [`crate::ScriptedDetector`].
    Scripted,
    /// A network in the ONNX format.
    Onnx,
}

/// What a detector is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DetectorInfo {
    /// Sort.
    pub kind: DetectorKind,
    /// Name of the model or script as the user gave it; empty for none.
    pub name: String,
    /// SHA-256 of the model's or script's bytes, as 64 lower-case hexadecimal digits.
    pub sha256: Option<String>,
    /// What runs the network, with its version.
    pub runtime: Option<String>,
    /// How the network's outputs are read.
    pub head: Option<String>,
    /// Width and height of the network's input for the last image, px.
    pub input: Option<(usize, usize)>,
    /// Threads of the network.
    pub threads: Option<usize>,
}

impl DetectorInfo {
    /// Of this sort and name; the rest is not known or not there.
    #[must_use]
    pub fn new(kind: DetectorKind, name: &str) -> Self {
        Self {
            kind,
            name: name.to_owned(),
            sha256: None,
            runtime: None,
            head: None,
            input: None,
            threads: None,
        }
    }
}

/// A detector could not look at a frame.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DetectError {
    /// The frame has no colour image.
    #[error(
        "frame {frame}: expected a colour image for the detector, found none; let the source keep the colour, or run without a detector"
    )]
    NoColour {
        /// The frame.
        frame: FrameId,
    },
    /// The colour image is not of the grey image's size, or has no pixels.
    #[error(
        "frame {frame}: expected a colour image of the grey image's {}x{} px, found {}x{} px; check the source of the frames",
        expected.0, expected.1, found.0, found.1
    )]
    ImageSize {
        /// The frame.
        frame: FrameId,
        /// Width and height of the grey image, px.
        expected: (usize, usize),
        /// Width and height of the colour image, px.
        found: (usize, usize),
    },
    /// The network's runtime failed.
    #[error(
        "frame {frame}: expected the network to run, found: {reason}; check the model with another image, or use another model"
    )]
    Runtime {
        /// The frame.
        frame: FrameId,
        /// What the runtime said.
        reason: String,
    },
    /// The network answered something else than it did when it was loaded.
    #[error(
        "frame {frame}: expected {expected}, found {found}; run the network at the model's own input size"
    )]
    Output {
        /// The frame.
        frame: FrameId,
        /// What the head reads.
        expected: String,
        /// What came out.
        found: String,
    },
}

/// Sees nothing in any frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoDetector;

impl Detector for NoDetector {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        Ok(Detections {
            frame: frame.id,
            stamp: frame.stamp,
            items: Vec::new(),
        })
    }

    fn info(&self) -> DetectorInfo {
        DetectorInfo::new(DetectorKind::None, "")
    }
}
