//! Networks in the ONNX format, run by `rten`, which is pure Rust and needs no library of the system.
//!
//! On one machine the same bytes, image and options give the same boxes in every run, whatever else the machine does. Its
//! kernels are chosen by the CPU's features, so other CPUs may differ in the last digits of a score.

mod container;
mod error;
mod interface;
mod letterbox;
mod network;
mod runtime;
mod yolox;

use crate::detector::{DetectError, Detector, DetectorInfo, DetectorKind};
use crate::hash::sha256_hex;
use crate::{BoundingBox, Detection, Detections};
pub use error::ModelError;
pub use interface::{Dimension, Interface, Port};
use letterbox::Letterbox;
use network::Network;
pub use runtime::Runtime;
#[cfg(feature = "onnxruntime")]
pub use runtime::{OnnxRuntime, RuntimeError};
use serde::{Deserialize, Serialize};
use stillpoint_imaging::{ColourImage, FrameId, RgbdFrame};

/// How a network is run and its output is read.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OnnxOptions {
    /// Least score (objectness times class) of a detection. Range: over 0 to 1. 0.25: lower ones are mostly wrong, and what
    /// it misses is bridged by tracks.
    pub score_threshold: f32,
    /// Intersection over union above which the weaker of two boxes of a class is dropped. Range: 0 to 1. 0.45: YOLOX's own.
    pub iou_threshold: f32,
    /// Threads of the network. Range: 1 to 64. 1: the other cores belong to tracking and mapping.
    pub threads: usize,
}

impl Default for OnnxOptions {
    fn default() -> Self {
        Self {
            score_threshold: 0.25,
            iou_threshold: 0.45,
            threads: 1,
        }
    }
}

/// A network that finds COCO's classes: YOLOX of any size.
pub struct OnnxDetector {
    name: String,
    sha256: String,
    options: OnnxOptions,
    network: Network,
    letterbox: Letterbox,
}

impl OnnxDetector {
    /// From the bytes of a model file. `name` is what errors and summaries call it. The model is run once on a grey image,
    /// so that one that does not fit is refused here and not at the first frame.
    ///
    /// # Errors
    /// [`ModelError`] for options out of range, and for models that do not load, do not run or are not YOLOX.
    pub fn from_bytes(
        bytes: Vec<u8>,
        name: &str,
        options: &OnnxOptions,
    ) -> Result<Self, ModelError> {
        check_options(options)?;
        let sha256 = sha256_hex(&bytes);
        let network = Network::load(bytes, name, options.threads)?;
        let letterbox = Letterbox::new(network.width, network.height);
        Ok(Self {
            name: name.to_owned(),
            sha256,
            options: *options,
            network,
            letterbox,
        })
    }

    /// The boxes in one colour image, in raw pixels and within the image, best score first. `frame` is named in errors.
    ///
    /// # Errors
    /// [`DetectError::ImageSize`] for an image without pixels, and failures of the network.
    pub fn detect_image(
        &mut self,
        image: &ColourImage,
        frame: FrameId,
    ) -> Result<Vec<Detection>, DetectError> {
        let (width, height) = (image.width(), image.height());
        if width == 0 || height == 0 {
            return Err(DetectError::ImageSize {
                frame,
                expected: (width.max(1), height.max(1)),
                found: (width, height),
            });
        }
        let input = self.letterbox.fill(image);
        let output = self.network.run(input).map_err(|e| e.at(frame))?;
        let (input_width, input_height) = (self.network.width, self.network.height);
        let boxes = yolox::decode(
            &output,
            input_width,
            input_height,
            self.options.score_threshold,
        );
        let mut boxes = yolox::suppress(boxes, &self.options);
        let (scale_x, scale_y) = self.letterbox.scale();
        // The network measures from the corner of the first pixel, which is half a pixel before its centre.
        for found in &mut boxes {
            let BoundingBox { x0, y0, x1, y1 } = found.bounds;
            found.bounds = BoundingBox {
                x0: x0 * scale_x - 0.5,
                y0: y0 * scale_y - 0.5,
                x1: x1 * scale_x - 0.5,
                y1: y1 * scale_y - 0.5,
            }
            .clipped(width, height);
        }
        // A box may lie in the padding altogether.
        boxes.retain(|d| d.bounds.area() > 0.0);
        Ok(boxes)
    }
}

impl Detector for OnnxDetector {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        let Some(colour) = frame.colour.clone() else {
            return Err(DetectError::NoColour { frame: frame.id });
        };
        let expected = (frame.gray.width(), frame.gray.height());
        let found = (colour.width(), colour.height());
        if expected != found {
            return Err(DetectError::ImageSize {
                frame: frame.id,
                expected,
                found,
            });
        }
        Ok(Detections {
            frame: frame.id,
            stamp: frame.stamp,
            items: self.detect_image(&colour, frame.id)?,
        })
    }

    fn info(&self) -> DetectorInfo {
        DetectorInfo {
            kind: DetectorKind::Onnx,
            name: self.name.clone(),
            sha256: Some(self.sha256.clone()),
            runtime: Some(self.network.runtime().to_owned()),
        }
    }
}

impl std::fmt::Debug for OnnxDetector {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OnnxDetector")
            .field("name", &self.name)
            .field("sha256", &self.sha256)
            .field("options", &self.options)
            .finish_non_exhaustive()
    }
}

fn check_options(options: &OnnxOptions) -> Result<(), ModelError> {
    let refuse = |option, expected, found| {
        Err(ModelError::Option {
            option,
            expected,
            found,
        })
    };
    let OnnxOptions {
        score_threshold,
        iou_threshold,
        threads,
    } = *options;
    if !(score_threshold > 0.0 && score_threshold <= 1.0) {
        return refuse(
            "score_threshold",
            "a share over 0 and up to 1",
            score_threshold.to_string(),
        );
    }
    if !(0.0..=1.0).contains(&iou_threshold) {
        return refuse(
            "iou_threshold",
            "a share from 0 to 1",
            iou_threshold.to_string(),
        );
    }
    if !(1..=64).contains(&threads) {
        return refuse("threads", "1 to 64 threads", threads.to_string());
    }
    Ok(())
}
