//! Downloads published models into the cache.
//!
//! An interrupted download is kept and resumed; the complete file is compared with its checksum before it becomes a model. A checkpoint is
//! converted to ONNX and not kept: the record holds its checksum.

mod error;
mod job;
#[cfg(test)]
mod tests;

pub use error::{ByHand, PullError};
pub use stillpoint_fetch::{Checksum, FetchError, Progress};

use crate::catalogue::KnownModel;
use crate::import::import_checkpoint;
use job::Job;
use std::ops::ControlFlow;
use std::time::Duration;
use stillpoint_fetch::{RealDisk, Waits, one_line};
use stillpoint_inference::{Cache, CachedModel};

/// Options of a download.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PullOptions {
    /// Replaces `https://github.com` in the addresses: a mirror with the same paths.
    pub base: Option<String>,
    /// Maximum wait for a connection. Default: 20 s.
    pub connect_timeout: Duration,
    /// Maximum wait for a response, or for more data. The total time is not limited. Default: 30 s.
    pub stall_timeout: Duration,
    /// Download even if it, or another model of its name, is present.
    pub again: bool,
}

impl Default for PullOptions {
    fn default() -> Self {
        let Waits { connect, stall } = Waits::default();
        Self {
            base: None,
            connect_timeout: connect,
            stall_timeout: stall,
            again: false,
        }
    }
}

/// Result of a download.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Pulled {
    /// The model in the cache.
    pub model: CachedModel,
    /// Its address.
    pub url: String,
    /// SHA-256 of the published file: of the checkpoint, if that was converted to ONNX.
    pub sha256: String,
    /// Origin of this checksum.
    pub checksum: Checksum,
    /// Bytes that were transferred; 0 if the model or the complete file was present.
    pub transferred: u64,
    /// Bytes present from an interrupted download.
    pub resumed: u64,
}

/// Downloads a model into the cache, unless it is present. Another model of its name is only replaced if that is damaged, or if `options`
/// request it. `progress` is called at least after each 64 kB, and may stop the download; while the server is silent, at most for the time
/// limits of `options`, it is not called.
///
/// # Errors
/// See [`PullError`]. After any of them an existing model of this name is unchanged.
pub fn pull(
    model: &KnownModel,
    cache: &Cache,
    options: &PullOptions,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Pulled, PullError> {
    Job {
        model,
        cache,
        options,
        disk: &RealDisk,
        convert: &convert,
    }
    .run(progress)
}

/// Converts a checkpoint to a network and its card; errors are one line.
type Convert<'a> = &'a dyn Fn(&[u8], &str) -> Result<(Vec<u8>, String), String>;

fn convert(checkpoint: &[u8], name: &str) -> Result<(Vec<u8>, String), String> {
    match import_checkpoint(checkpoint, name) {
        Ok(imported) => Ok((imported.onnx, imported.card.to_toml())),
        Err(e) => Err(one_line(&e.to_string())),
    }
}
