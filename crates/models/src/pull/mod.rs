//! Getting a model from where its maker publishes it into the cache.
//!
//! A download that breaks off is kept and resumed; what arrives is compared with its checksum as a whole, and only then it becomes a model. A
//! checkpoint is turned into ONNX and not kept: the record holds its checksum.

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

/// How to download.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PullOptions {
    /// What replaces `https://github.com` in the addresses: a mirror that has the same paths.
    pub base: Option<String>,
    /// Longest wait for a connection. Default: 20 s.
    pub connect_timeout: Duration,
    /// Longest wait for an answer, or for more of the file. There is no limit for the whole. Default: 30 s.
    pub stall_timeout: Duration,
    /// Download it although it is here, or another model of its name.
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

/// A model that is here now.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Pulled {
    /// The model in the cache.
    pub model: CachedModel,
    /// Where it was downloaded.
    pub url: String,
    /// SHA-256 of the published file: of a checkpoint, where that was turned into ONNX.
    pub sha256: String,
    /// What is known about this checksum.
    pub checksum: Checksum,
    /// Bytes that came over the network; 0 if the model, or the whole file, was here.
    pub transferred: u64,
    /// Bytes that were here from a download that broke off.
    pub resumed: u64,
}

/// Downloads a model into the cache, unless it is here. Another model of its name is replaced only if that is damaged, or if `options` say so. `progress` is called at least after each 64 kB, and may break off;
/// while the server is silent it is not called, for at most the time limits of `options`.
///
/// # Errors
/// See [`PullError`]. After each of them a model of this name that was here before is as it was.
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

/// Turns a checkpoint into a network and its card; what is wrong with it, on one line.
type Convert<'a> = &'a dyn Fn(&[u8], &str) -> Result<(Vec<u8>, String), String>;

fn convert(checkpoint: &[u8], name: &str) -> Result<(Vec<u8>, String), String> {
    match import_checkpoint(checkpoint, name) {
        Ok(imported) => Ok((imported.onnx, imported.card.to_toml())),
        Err(e) => Err(one_line(&e.to_string())),
    }
}
