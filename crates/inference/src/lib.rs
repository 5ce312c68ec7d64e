//! Detectors in the ONNX format: reads, checks and runs models, and keeps them in the user's cache.
//!
//! Answers: the meaning of a network's outputs, whether a file is a usable detector, its runtime, and the models on this machine. A model
//! card gives the meaning of a network's outputs; known models have theirs built in. Does not know the origin of models (crate `models`),
//! and no core crate imports it: it opens files and loads libraries on their behalf.
//!
//! On one machine the same bytes, image and options give the same boxes in every run, whatever the load. A runtime selects its kernels by
//! the CPU's features, so other CPUs may differ in the last digits of a score.

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
