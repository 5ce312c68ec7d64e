//! Object detectors behind one trait, and the objects they see, tracked through time.
//!
//! Answers: which things of which class are where in an image, and where each of them is now although the detector
//! missed it or answers late. Does not decide what is rejected (crate `slam`, static filter) and reads no files.

mod classes;
mod detections;
mod detector;
mod hash;
mod objects;
#[cfg(feature = "onnx")]
mod onnx;
mod scripted;
mod weights;
pub mod wire;

pub use detections::{BoundingBox, ClassId, Detection, Detections};
pub use detector::{DetectError, Detector, DetectorInfo, DetectorKind, NoDetector};
pub use objects::{
    Motion, Object, ObjectId, ObjectInCamera, ObjectState, ObjectTracker, ObjectsConfig,
};
#[cfg(feature = "onnx")]
pub use onnx::{
    CardError, CardInput, CardOutput, Classes, ColourOrder, Column, Dimension, Head, InputSize,
    Interface, ModelCard, ModelError, OnnxDetector, OnnxOptions, Port, Resize, Runtime,
};
#[cfg(feature = "onnxruntime")]
pub use onnx::{OnnxRuntime, RuntimeError};
pub use scripted::{
    SCRIPT_HEADER, ScriptError, ScriptRow, ScriptUse, ScriptedDetector, format_script, parse_script,
};
pub use weights::{MotionWeights, WeightError};
