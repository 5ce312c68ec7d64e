//! Detectors in the ONNX format: models read and checked, run, and kept in the user's cache.
//!
//! Answers: what a network's numbers mean, whether a file is a detector that can be used, what runs it, and which models are on
//! this machine. A model card says what a network's numbers mean; the known models have theirs built in. Does not know where
//! models come from (crate `models`), and no crate of the core imports it: it opens files and loads libraries, so that they do not.
//!
//! On one machine the same bytes, image and options give the same boxes in every run, whatever else the machine does. A
//! runtime's kernels are chosen by the CPU's features, so other CPUs may differ in the last digits of a score.

mod cache;
mod card;
mod container;
mod detector;
mod error;
mod graph;
mod heads;
mod interface;
mod known;
mod letterbox;
mod limits;
mod loading;
mod network;
mod runtime;
mod size;
pub mod wire;

pub use cache::{
    Cache, CacheError, CachedModel, Form, LARGEST, Record, State, Stray, check_name, now,
};
pub use card::{
    CardError, CardInput, CardOutput, Classes, ColourOrder, Column, Head, ModelCard, Resize,
};
pub use detector::{OnnxDetector, OnnxOptions};
pub use error::ModelError;
pub use interface::{Dimension, Interface, Port};
#[cfg(feature = "onnxruntime")]
pub use runtime::{OnnxRuntime, RuntimeError};
pub use runtime::{Runtime, is_expected};
pub use size::InputSize;
pub use stillpoint_files::sha256_hex;
