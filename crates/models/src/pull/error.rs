//! What can be wrong with a download, said so that the user can go on without it.

use crate::catalogue::KnownModel;
use std::fmt;
use std::path::{Path, PathBuf};
use stillpoint_fetch::FetchError;
use stillpoint_inference::{Cache, CacheError, Form};

/// A model could not be downloaded. No error leaves a half file under a model's name or touches a model that was there before.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PullError {
    /// The cache cannot be used.
    #[error(transparent)]
    Cache(#[from] CacheError),
    /// It did not arrive.
    #[error(transparent)]
    Fetch(#[from] FetchError),
    /// The file is another than the one published, or than the one that came the first time. It is not kept.
    #[error(
        "{url}: expected SHA-256 {expected} ({on_record}), found {found}; the file was removed; {advice}"
    )]
    Checksum {
        /// The address.
        url: String,
        /// The checksum expected.
        expected: String,
        /// Who says so.
        on_record: &'static str,
        /// The checksum found.
        found: String,
        /// What it may be, and what to do.
        advice: String,
    },
    /// The file came whole and cannot be turned into a network. It is not kept.
    #[error(
        "{url}: expected a checkpoint that can be turned into ONNX, found: {reason}; the file (SHA-256 {sha256}) was removed: try again, or get it in another way and run `stillpoint models import FILE`"
    )]
    Convert {
        /// The address.
        url: String,
        /// Checksum of the file.
        sha256: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The cache has another model of this name, which is not replaced without being asked for.
    #[error("{}: expected no model of the name {name} but the published one, found another (made from SHA-256 {found}); to keep it, move it and its card away, or import it under another name; --again replaces it", path.display())]
    Another {
        /// The model.
        name: String,
        /// SHA-256 of the file that the one in the cache was made from.
        found: String,
        /// The one in the cache.
        path: PathBuf,
    },
}

/// How to get a model without this program: what, how to check it, and where to put it.
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
    /// The file with what came so far, where it is kept and the same call goes on from it.
    #[must_use]
    pub fn part(&self) -> Option<&Path> {
        match self {
            Self::Fetch(e) => e.part(),
            _ => None,
        }
    }
}
