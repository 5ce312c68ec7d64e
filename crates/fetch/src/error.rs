//! What can be wrong with a download, said so that the user can go on without it.

use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};

/// A file could not be downloaded. No error leaves a half file under the name of a whole one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FetchError {
    /// No server was reached, or it did not answer.
    #[error(
        "{url}: expected an answer, found {reason}; check the network and the proxy (HTTPS_PROXY), or {by_hand}"
    )]
    Unreachable {
        /// The address.
        url: String,
        /// What happened instead.
        reason: String,
        /// How to get the file in another way.
        by_hand: String,
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
        /// How to get the file in another way.
        by_hand: String,
    },
    /// The server answered something else than the file.
    #[error("{url}: expected the file, found status {status}{}; {} or {by_hand}", status_name(*status), status_advice(*status))]
    Status {
        /// The address, that of the last redirect.
        url: String,
        /// The HTTP status.
        status: u16,
        /// How to get the file in another way.
        by_hand: String,
    },
    /// The server sends to somewhere where we do not go.
    #[error(
        "{url}: expected the file after at most {} redirects that keep https, found {found}; check the network for a proxy that redirects, or {by_hand}",
        crate::http::REDIRECTS
    )]
    Redirect {
        /// The address that was asked for.
        url: String,
        /// What was found.
        found: String,
        /// How to get the file in another way.
        by_hand: String,
    },
    /// A web page instead of the file.
    #[error(
        "{url}: expected the file, found a web page; open a page in a browser to see whether this network asks for a login, or {by_hand}"
    )]
    WebPage {
        /// The address, that of the last redirect.
        url: String,
        /// How to get the file in another way.
        by_hand: String,
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
        /// How to get the file in another way.
        by_hand: String,
    },
    /// There is less free space than the file will take. What came before is kept.
    #[error("{}: expected {needed} bytes of free space for {url}, found {free}; free some space, or {elsewhere}", folder.display())]
    Room {
        /// The address.
        url: String,
        /// Where it was to go.
        folder: PathBuf,
        /// Bytes that it will take beside those that are here.
        needed: u64,
        /// Free bytes.
        free: u64,
        /// Where else it can go.
        elsewhere: String,
    },
    /// The disk is full, or what came cannot be written for another reason. What came is kept.
    #[error("{}: expected to write it, found after {received} bytes: {source}; {}; what is here is kept, and the same command goes on from it", part.display(), write_advice(source, elsewhere))]
    Write {
        /// What is here.
        part: PathBuf,
        /// Bytes that are here.
        received: u64,
        /// The system's reason.
        source: Error,
        /// Where else it can go.
        elsewhere: String,
    },
    /// A file beside the download cannot be used.
    #[error("{}: expected to use this file for the download, found: {source}; {}", path.display(), write_advice(source, elsewhere))]
    File {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: Error,
        /// Where else it can go.
        elsewhere: String,
    },
    /// Someone else downloads the same.
    #[error("{}: expected no other download of {name}, found one that is running; wait until it has ended", lock.display())]
    Busy {
        /// What is downloaded.
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

impl FetchError {
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

/// What helps when writing failed for a reason of the system, as part of a message.
pub(crate) fn write_advice(source: &Error, elsewhere: &str) -> String {
    let first = match source.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => "free some space and try again",
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
            "check the folder's permissions"
        }
        _ => "check the folder's permissions and the free space",
    };
    format!("{first}, or {elsewhere}")
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
