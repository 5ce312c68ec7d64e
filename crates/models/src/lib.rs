//! Where detectors come from: models that are downloaded into the user's cache, and checkpoints that are turned into ONNX.
//!
//! Answers: which models are known, and how one that is not here gets here. Does not run networks, and the cache is not its own
//! (crate `inference`).

// The server of the integration tests also serves those within the crate.
#[cfg(test)]
extern crate self as stillpoint_models;

mod catalogue;
pub mod import;
#[cfg(feature = "pull")]
mod pull;

pub use catalogue::{KnownModel, known, known_by_sha256, known_models, licence};
#[cfg(feature = "pull")]
pub use pull::{ByHand, Checksum, FetchError, Progress, PullError, PullOptions, Pulled, pull};
