//! Errors of downloads, with ways to continue without them.

use crate::catalogue::KnownModel;
use std::fmt;
use std::path::{Path, PathBuf};
use stillpoint_fetch::FetchError;
use stillpoint_inference::{Cache, CacheError, Form};

/// Error: a model could not be downloaded. No error leaves a partial file under a model's name or touches an existing model.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PullError {
    /// The cache cannot be used.
    #[error(transparent)]
    Cache(#[from] CacheError),
    /// The download failed.
    #[error(transparent)]
    Fetch(#[from] FetchError),
    /// The file differs from the published one, or from that of the first download. It is not kept.
    #[error(
        "{url}: expected SHA-256 {expected} ({on_record}), found {found}; the file was removed; {advice}"
    )]
    Checksum {
        /// The address.
        url: String,
        /// Expected checksum.
        expected: String,
        /// Its source.
        on_record: &'static str,
        /// Found checksum.
        found: String,
        /// Possible cause and remedy.
        advice: String,
    },
    /// The file is complete and cannot be converted to a network. It is not kept.
    #[error(
        "{url}: expected a checkpoint that can be turned into ONNX, found: {reason}; the file (SHA-256 {sha256}) was removed: try again, or get it in another way and run `stillpoint models import FILE`"
    )]
    Convert {
        /// The address.
        url: String,
        /// Checksum of the file.
        sha256: String,
        /// The problem.
        reason: String,
    },
    /// The cache has another model of this name, which is only replaced on request.
    #[error("{}: expected no model of the name {name} but the published one, found another (made from SHA-256 {found}); to keep it, move it and its card away, or import it under another name; --again replaces it", path.display())]
    Another {
        /// The model.
        name: String,
        /// SHA-256 of the original file of the cached model.
        found: String,
        /// The cached model.
        path: PathBuf,
    },
}

/// Instructions to obtain a model without this program: file, checksum and destination.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ByHand {
    url: String,
    file: String,
    bytes: Option<u64>,
    sha256: Option<String>,
    place: Option<PathBuf>,
}

impl ByHand {
    /// For this model and this cache.
    #[must_use]
    pub fn new(model: &KnownModel, cache: &Cache) -> Self {
        Self {
            url: model.url.to_owned(),
            file: model.file.to_owned(),
            bytes: model.bytes,
            sha256: model.sha256.map(str::to_owned),
            place: (model.form == Form::Onnx).then(|| cache.onnx_path(model.name)),
        }
    }
}

impl fmt::Display for ByHand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { url, file, .. } = self;
        write!(f, "get {url} in another way (")?;
        match self.bytes {
            Some(bytes) => write!(f, "{bytes} bytes, ")?,
            None => write!(f, "size not known, ")?,
        }
        match &self.sha256 {
            Some(sha256) => write!(f, "SHA-256 {sha256}")?,
            None => write!(f, "checksum not known")?,
        }
        write!(f, ") and run `stillpoint models import {file}`")?;
        match &self.place {
            Some(place) => write!(f, ", or put it at {}", place.display()),
            None => Ok(()),
        }
    }
}

impl PullError {
    /// The partial download, if kept; the same call resumes it.
    #[must_use]
    pub fn part(&self) -> Option<&Path> {
        match self {
            Self::Fetch(e) => e.part(),
            _ => None,
        }
    }
}
