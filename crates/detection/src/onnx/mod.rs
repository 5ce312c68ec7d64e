//! Networks in the ONNX format, run by `rten`, which is pure Rust and needs no library of the system.
//!
//! On one machine the same bytes, image and options give the same boxes in every run, whatever else the machine does. Its
//! kernels are chosen by the CPU's features, so other CPUs may differ in the last digits of a score.

mod letterbox;
mod yolox;

use crate::detector::{DetectError, Detector, DetectorInfo, DetectorKind};
use crate::hash::sha256_hex;
use crate::{BoundingBox, Detection, Detections};
use letterbox::Letterbox;
use rten::{Dimension, Model, NodeId, RunOptions, ThreadPool, ValueView};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use stillpoint_imaging::{ColourImage, FrameId, RgbdFrame};

/// The runtime, as summaries name it; a test holds it against Cargo.lock.
const RUNTIME: &str = "rten 0.24.0";

/// What the YOLOX head needs.
const EXPECTED: &str = "a YOLOX model: one input of [1, 3, H, W] with H and W fixed multiples of 32 up to 4096, one output of [1, H W (1/64 + 1/256 + 1/1024), 85] with raw boxes";

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

/// A model cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The bytes are no model, or one with operators that the runtime does not have.
    #[error(
        "{name}: expected an ONNX model that {RUNTIME} can load, found: {reason}; check the file, or export the model anew"
    )]
    Load {
        /// Name of the model.
        name: String,
        /// What the runtime said.
        reason: String,
    },
    /// The model does not have the inputs and outputs of the head.
    #[error(
        "{name}: expected {EXPECTED}; found {found}; use a YOLOX model exported without decoding and for a fixed size"
    )]
    Interface {
        /// Name of the model.
        name: String,
        /// Its inputs and outputs, or what else does not fit.
        found: String,
    },
    /// The model was loaded but does not run.
    #[error(
        "{name}: expected the model to run on a grey image, found: {reason}; export the model anew or use another one"
    )]
    Run {
        /// Name of the model.
        name: String,
        /// What the runtime said.
        reason: String,
    },
    /// An option is out of its range.
    #[error("{option}: expected {expected}, found {found}; choose a value in this range")]
    Option {
        /// Which one.
        option: &'static str,
        /// Its range.
        expected: &'static str,
        /// Its value.
        found: String,
    },
}

/// A network that finds COCO's classes: YOLOX of any size.
pub struct OnnxDetector {
    name: String,
    sha256: String,
    options: OnnxOptions,
    network: Network,
    letterbox: Letterbox,
}

/// The loaded model with what it takes to run it.
struct Network {
    model: Model,
    input: NodeId,
    output: NodeId,
    /// Of the input, px.
    width: usize,
    height: usize,
    pool: Arc<ThreadPool>,
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
            runtime: Some(RUNTIME.to_owned()),
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

/// The network did not answer as it should.
enum Failure {
    Runtime(String),
    Output { expected: String, found: String },
}

impl Failure {
    fn at(self, frame: FrameId) -> DetectError {
        match self {
            Self::Runtime(reason) => DetectError::Runtime { frame, reason },
            Self::Output { expected, found } => DetectError::Output {
                frame,
                expected,
                found,
            },
        }
    }
}

impl Network {
    fn load(bytes: Vec<u8>, name: &str, threads: usize) -> Result<Self, ModelError> {
        let model = Model::load(bytes).map_err(|e| ModelError::Load {
            name: name.to_owned(),
            reason: one_line(&e),
        })?;
        let refuse = |found: String| ModelError::Interface {
            name: name.to_owned(),
            found,
        };
        let sides = interface(&model);
        let (&[input], &[output]) = (model.input_ids(), model.output_ids()) else {
            return Err(refuse(sides));
        };
        let shape = model
            .node_info(input)
            .and_then(|n| n.shape())
            .unwrap_or_default();
        let &[batch, channels, height, width] = &fixed(&shape)[..] else {
            return Err(refuse(sides));
        };
        if (batch, channels) != (1, 3) || !yolox::fits(width, height) {
            return Err(refuse(sides));
        }
        let network = Self {
            model,
            input,
            output,
            width,
            height,
            pool: Arc::new(ThreadPool::with_num_threads(threads)),
        };
        let grey = vec![114.0; 3 * width * height];
        match network.run(&grey) {
            Ok(output) if yolox::is_decoded(&output) => Err(refuse("boxes in pixels".to_owned())),
            Ok(_) => Ok(network),
            Err(Failure::Output { .. }) => Err(refuse(sides)),
            Err(Failure::Runtime(reason)) => Err(ModelError::Run {
                name: name.to_owned(),
                reason,
            }),
        }
    }

    /// Runs the network on planes of 3 x height x width; the output's rows one after another.
    fn run(&self, planes: &[f32]) -> Result<Vec<f32>, Failure> {
        let runtime = |e: &dyn std::fmt::Display| Failure::Runtime(one_line(e));
        let input = ValueView::from_shape([1, 3, self.height, self.width].as_slice(), planes)
            .map_err(|e| runtime(&e))?;
        // Its own threads, since the default pool takes all cores.
        let options = RunOptions::default().with_thread_pool(Some(Arc::clone(&self.pool)));
        let [output] = self
            .model
            .run_n(
                vec![(self.input, input.into())],
                [self.output],
                Some(options),
            )
            .map_err(|e| runtime(&e))?;
        let expected = [1, yolox::rows(self.width, self.height), yolox::COLUMNS];
        let wrong = |found: String| Failure::Output {
            expected: format!("an output of {expected:?}"),
            found,
        };
        let (shape, data) = output
            .into_shape_vec::<f32, 3>()
            .map_err(|e| wrong(one_line(&e)))?;
        if shape == expected {
            Ok(data)
        } else {
            Err(wrong(format!("{shape:?}")))
        }
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

/// The sizes of a shape; 0 for those that are not fixed.
fn fixed(shape: &[Dimension]) -> Vec<usize> {
    shape
        .iter()
        .map(|d| match d {
            Dimension::Fixed(size) => *size,
            Dimension::Symbolic(_) => 0,
        })
        .collect()
}

/// A model's inputs and outputs, for a message.
fn interface(model: &Model) -> String {
    let describe = |ids: &[NodeId]| {
        let mut parts = Vec::new();
        for info in ids.iter().filter_map(|&id| model.node_info(id)) {
            let sizes = |d: &Dimension| match d {
                Dimension::Fixed(size) => size.to_string(),
                Dimension::Symbolic(name) => name.clone(),
            };
            let shape = info.shape().map_or("of unknown shape".to_owned(), |s| {
                format!("[{}]", s.iter().map(sizes).collect::<Vec<_>>().join(", "))
            });
            parts.push(format!(
                "{} {shape}",
                info.name().unwrap_or("(without a name)")
            ));
        }
        if parts.is_empty() {
            "none".to_owned()
        } else {
            parts.join(", ")
        }
    };
    format!(
        "inputs: {}; outputs: {}",
        describe(model.input_ids()),
        describe(model.output_ids())
    )
}

/// A reason as part of a one-line message.
fn one_line(reason: &dyn std::fmt::Display) -> String {
    reason
        .to_string()
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}
