//! Errors of unpacking an archive to a folder.

use crate::error::{FetchError, write_advice};
use std::io::Error;
use std::path::PathBuf;

/// Error: an archive could not be installed as a folder. No error leaves a partial folder under its name.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ArchiveError {
    /// The download failed.
    #[error(transparent)]
    Fetch(#[from] FetchError),
    /// It differs from the published archive, or from that of the first download. It is not kept.
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
    /// The complete archive has forbidden or missing contents. It is not kept.
    #[error(
        "{url}: expected an archive of files and folders, found {reason}; the file (SHA-256 {sha256}) was removed: try again, or unpack one that you trust yourself"
    )]
    Unusable {
        /// The address.
        url: String,
        /// Checksum of the file.
        sha256: String,
        /// The problem.
        reason: String,
    },
    /// The complete archive cannot be unpacked for lack of space. The archive is kept.
    #[error("{}: expected to write it, found: {source}; {}; {} is kept, and the same command goes on from it", path.display(), write_advice(source, super::ELSEWHERE), part.display())]
    Write {
        /// The file that could not be written.
        path: PathBuf,
        /// The archive.
        part: PathBuf,
        /// Error of the system.
        source: Error,
    },
    /// Another file or folder has the folder's name.
    #[error("{}: expected no folder, or one with {holds}, found something else; move it away, or name another folder to pull to", path.display())]
    InTheWay {
        /// The folder.
        path: PathBuf,
        /// The file that identifies the right folder.
        holds: String,
    },
    /// The checksum of the first download cannot be read.
    #[error("{}: expected to read it, found: {source}; check its permissions", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: Error,
    },
    /// The checksum of the first download cannot be parsed.
    #[error("{}: expected the SHA-256 of the first download, found something else; remove this file, and the next download is recorded as the first", path.display())]
    Record {
        /// The file.
        path: PathBuf,
    },
}

impl ArchiveError {
    /// Whether the caller stopped it.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        matches!(self, Self::Fetch(FetchError::Stopped { .. }))
    }
}
