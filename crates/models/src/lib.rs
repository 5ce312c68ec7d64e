//! Sources of detectors: downloads models into the user's cache, and converts checkpoints to ONNX.
//!
//! Answers: which models are known, and how to obtain missing ones. Does not run networks, and does not own the cache (crate `inference`).

// The server of the integration tests also serves the unit tests.
#[cfg(test)]
extern crate self as stillpoint_models;

mod catalogue;
pub mod import;
#[cfg(feature = "pull")]
mod pull;

pub use catalogue::{KnownModel, known, known_by_sha256, known_models, licence};
#[cfg(feature = "pull")]
pub use pull::{ByHand, Checksum, FetchError, Progress, PullError, PullOptions, Pulled, pull};
