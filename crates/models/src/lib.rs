//! Where detectors come from: models that are downloaded into the user's cache, and checkpoints that are turned into ONNX.
//!
//! Answers: which models are known, which of them are here, and how one that is not gets here. Does not run networks (crate
//! `detection`).

// The server of the integration tests also serves those within the crate.
#[cfg(test)]
extern crate self as stillpoint_models;

mod cache;
mod catalogue;
mod checksum;
mod error;
pub mod import;
mod install;
mod listing;
mod name;
pub mod onnxruntime;
#[cfg(feature = "pull")]
mod pull;
mod record;

pub use cache::{Cache, LARGEST};
pub use catalogue::{Form, KnownModel, known, known_by_sha256, known_models};
pub use checksum::sha256_hex;
pub use error::CacheError;
pub use listing::{CachedModel, State, Stray};
pub use name::check_name;
#[cfg(feature = "pull")]
pub use pull::{ByHand, Checksum, Progress, PullError, PullOptions, Pulled, pull};
pub use record::{Record, now};
