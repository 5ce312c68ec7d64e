//! Errors of downloads, with ways to continue without them.

use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};

/// Error: a file could not be downloaded. No error leaves a partial file under the name of a complete one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FetchError {
    /// No server was reached, or it did not respond.
    #[error(
        "{url}: expected an answer, found {reason}; check the network and the proxy (HTTPS_PROXY), or {by_hand}"
    )]
    Unreachable {
        /// The address.
        url: String,
        /// The problem.
        reason: String,
        /// Alternative way to obtain the file.
        by_hand: String,
    },
    /// This CPU lacks the features for encrypted connections. Everything else works on it.
    #[error(
        "{url}: expected a CPU that can encrypt the connection, found one without {missing}; {by_hand}"
    )]
    Cpu {
        /// The address.
        url: String,
        /// Missing CPU features.
        missing: String,
        /// Alternative way to obtain the file.
        by_hand: String,
    },
    /// The server responded with another status.
    #[error("{url}: expected the file, found status {status}{}; {} or {by_hand}", status_name(*status), status_advice(*status))]
    Status {
        /// The address, that of the last redirect.
        url: String,
        /// The HTTP status.
        status: u16,
        /// Alternative way to obtain the file.
        by_hand: String,
    },
    /// The server redirects to a refused address.
    #[error(
        "{url}: expected the file after at most {} redirects that keep https, found {found}; check the network for a proxy that redirects, or {by_hand}",
        crate::http::REDIRECTS
    )]
    Redirect {
        /// The requested address.
        url: String,
        /// The redirect found.
        found: String,
        /// Alternative way to obtain the file.
        by_hand: String,
    },
    /// A web page instead of the file.
    #[error(
        "{url}: expected the file, found a web page; open a page in a browser to see whether this network asks for a login, or {by_hand}"
    )]
    WebPage {
        /// The address, that of the last redirect.
        url: String,
        /// Alternative way to obtain the file.
        by_hand: String,
    },
    /// The connection ended or stalled before the file was complete. The partial download is kept.
    #[error("{url}: expected {} bytes, found {reason} after {received}; run the same command again: it goes on from {}", total.map_or("all".to_owned(), |t| t.to_string()), part.display())]
    BrokenOff {
        /// The address.
        url: String,
        /// Bytes present.
        received: u64,
        /// Bytes of the complete file, if known.
        total: Option<u64>,
        /// Reason.
        reason: String,
        /// The partial download.
        part: PathBuf,
    },
    /// The file has the wrong size. It is not kept.
    #[error("{url}: expected {expected}, found {found}; this is not the published file; {by_hand}")]
    Size {
        /// The address.
        url: String,
        /// Expected size.
        expected: String,
        /// Found size.
        found: String,
        /// Alternative way to obtain the file.
        by_hand: String,
    },
    /// There is less free space than the file needs. An earlier partial download is kept.
    #[error("{}: expected {needed} bytes of free space for {url}, found {free}; free some space, or {elsewhere}", folder.display())]
    Room {
        /// The address.
        url: String,
        /// Destination folder.
        folder: PathBuf,
        /// Bytes needed besides those present.
        needed: u64,
        /// Free bytes.
        free: u64,
        /// Alternative destination.
        elsewhere: String,
    },
    /// The disk is full, or writing failed for another reason. The partial download is kept.
    #[error("{}: expected to write it, found after {received} bytes: {source}; {}; what is here is kept, and the same command goes on from it", part.display(), write_advice(source, elsewhere))]
    Write {
        /// The partial download.
        part: PathBuf,
        /// Bytes present.
        received: u64,
        /// Error of the system.
        source: Error,
        /// Alternative destination.
        elsewhere: String,
    },
    /// A file beside the download cannot be used.
    #[error("{}: expected to use this file for the download, found: {source}; {}", path.display(), write_advice(source, elsewhere))]
    File {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: Error,
        /// Alternative destination.
        elsewhere: String,
    },
    /// Another process downloads the same file.
    #[error("{}: expected no other download of {name}, found one that is running; wait until it has ended", lock.display())]
    Busy {
        /// Name of the download.
        name: String,
        /// The lock file.
        lock: PathBuf,
    },
    /// The caller stopped it. The partial download is kept.
    #[error("stopped after {received} bytes; the same command goes on from {}", part.display())]
    Stopped {
        /// Bytes present.
        received: u64,
        /// The partial download.
        part: PathBuf,
    },
}

impl FetchError {
    /// The partial download, if kept; the same call resumes it.
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

/// Remedy for a failed write, as part of a message.
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
