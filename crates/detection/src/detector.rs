//! The trait of all detectors, and a detector without detections.

use crate::Detections;
use serde::Serialize;
use stillpoint_imaging::{FrameId, RgbdFrame};

/// A detector of objects of known classes. Owns its network and state.
pub trait Detector: Send {
    /// Detects objects in a frame. Boxes are in raw image pixels, best score first.
    ///
    /// # Errors
    /// [`DetectError`] when the frame lacks an input or the network fails. The next frame can be tried normally.
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError>;

    /// Description for summaries and logs.
    fn info(&self) -> DetectorInfo;

    /// Remark for the user at the end of the stream, e.g. that a script belongs to another recording.
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

/// Kind of detector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum DetectorKind {
    /// [`NoDetector`].
    None,
    /// Boxes from a file: [`crate::ScriptedDetector`].
    Scripted,
    /// A network in the ONNX format.
    Onnx,
}

/// Description of a detector.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DetectorInfo {
    /// Kind.
    pub kind: DetectorKind,
    /// Name of the model or script as given by the user; empty for none.
    pub name: String,
    /// SHA-256 of the model's or script's bytes, as 64 lower-case hexadecimal digits.
    pub sha256: Option<String>,
    /// Inference runtime with version.
    pub runtime: Option<String>,
    /// Decoder of the network's outputs.
    pub head: Option<String>,
    /// Width and height of the network's input for the last image, px.
    pub input: Option<(usize, usize)>,
    /// Threads of the network.
    pub threads: Option<usize>,
}

impl DetectorInfo {
    /// A description with kind and name alone.
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

/// Failed detection in a frame.
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
    /// The size of the colour image differs from the grey image's, or is zero.
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
        /// The runtime's message.
        reason: String,
    },
    /// The network's output has another shape than at loading.
    #[error(
        "frame {frame}: expected {expected}, found {found}; run the network at the model's own input size"
    )]
    Output {
        /// The frame.
        frame: FrameId,
        /// Expected output.
        expected: String,
        /// Actual output.
        found: String,
    },
}

/// Detects nothing.
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
