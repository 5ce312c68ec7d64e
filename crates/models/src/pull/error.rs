//! What can be wrong with a download, said so that the user can go on without it.

use crate::catalogue::KnownModel;
use std::fmt;
use std::path::{Path, PathBuf};
use stillpoint_inference::{Cache, CacheError, Form};

/// A model could not be downloaded. No error leaves a half file under a model's name or touches a model that was there before.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PullError {
    /// The cache cannot be used.
    #[error(transparent)]
    Cache(#[from] CacheError),
    /// No server was reached, or it did not answer.
    #[error(
        "{url}: expected an answer, found {reason}; check the network and the proxy (HTTPS_PROXY), or {by_hand}"
    )]
    Unreachable {
        /// The address.
        url: String,
        /// What happened instead.
        reason: String,
        /// How to get the model in another way.
        by_hand: Box<ByHand>,
    },
    /// This CPU cannot encrypt connections. Everything else works on it.
    #[error(
        "{url}: expected a CPU that can encrypt the connection, found one without {missing}; {by_hand}"
    )]
    Cpu {
        /// The address.
        url: String,
        /// What the CPU lacks.
        missing: String,
        /// How to get the model in another way.
        by_hand: Box<ByHand>,
    },
    /// The server answered something else than the file.
    #[error("{url}: expected the file, found status {status}{}; {} or {by_hand}", status_name(*status), status_advice(*status))]
    Status {
        /// The address, that of the last redirect.
        url: String,
        /// The HTTP status.
        status: u16,
        /// How to get the model in another way.
        by_hand: Box<ByHand>,
    },
    /// The server sends to somewhere where we do not go.
    #[error(
        "{url}: expected the file after at most {} redirects that keep https, found {found}; check the network for a proxy that redirects, or {by_hand}",
        super::REDIRECTS
    )]
    Redirect {
        /// The address that was asked for.
        url: String,
        /// What was found.
        found: String,
        /// How to get the model in another way.
        by_hand: Box<ByHand>,
    },
    /// A web page instead of the file.
    #[error(
        "{url}: expected the file, found a web page; open a page in a browser to see whether this network asks for a login, or {by_hand}"
    )]
    WebPage {
        /// The address, that of the last redirect.
        url: String,
        /// How to get the model in another way.
        by_hand: Box<ByHand>,
    },
    /// The connection ended or stood still before the file was whole. What came is kept.
    #[error("{url}: expected {} bytes, found {reason} after {received}; run the same command again: it goes on from {}", total.map_or("all".to_owned(), |t| t.to_string()), part.display())]
    BrokenOff {
        /// The address.
        url: String,
        /// Bytes that are here.
        received: u64,
        /// Bytes of the whole file, if known.
        total: Option<u64>,
        /// What happened.
        reason: String,
        /// What is here.
        part: PathBuf,
    },
    /// The file is larger or smaller than it should be. It is not kept.
    #[error("{url}: expected {expected}, found {found}; this is not the published file; {by_hand}")]
    Size {
        /// The address.
        url: String,
        /// The size expected.
        expected: String,
        /// The size found.
        found: String,
        /// How to get the model in another way.
        by_hand: Box<ByHand>,
    },
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
    /// The disk is full, or what came cannot be written for another reason. What came is kept.
    #[error("{}: expected to write it, found after {received} bytes: {source}; {}; what is here is kept, and the same command goes on from it", part.display(), CacheError::write_advice(source))]
    Write {
        /// What is here.
        part: PathBuf,
        /// Bytes that are here.
        received: u64,
        /// The system's reason.
        source: std::io::Error,
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
    /// Someone else downloads this model.
    #[error("{}: expected no other download of {name}, found one that is running; wait until it has ended", lock.display())]
    Busy {
        /// The model.
        name: String,
        /// The file that says so.
        lock: PathBuf,
    },
    /// The caller asked to stop. What came is kept.
    #[error("stopped after {received} bytes; the same command goes on from {}", part.display())]
    Stopped {
        /// Bytes that are here.
        received: u64,
        /// What is here.
        part: PathBuf,
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
            Self::BrokenOff { part, .. }
            | Self::Write { part, .. }
            | Self::Stopped { part, .. } => Some(part),
            _ => None,
        }
    }
}

fn status_name(status: u16) -> &'static str {
    match status {
        403 => " (forbidden)",
        404 | 410 => " (not found)",
        407 => " (the proxy asks for a login)",
        429 => " (too many requests)",
        500..=599 => " (the server failed)",
        _ => "",
    }
}

fn status_advice(status: u16) -> &'static str {
    match status {
        404 | 410 => "look for a newer version of Stillpoint, which may know where the file went,",
        407 => "put name and password into HTTPS_PROXY,",
        429 | 500..=599 => "try again later,",
        _ => "check the network and the proxy (HTTPS_PROXY),",
    }
}
