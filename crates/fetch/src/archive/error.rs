//! What can be wrong with an archive that was to become a folder.

use crate::error::{FetchError, write_advice};
use std::io::Error;
use std::path::PathBuf;

/// An archive did not become a folder. No error leaves a half folder under its name.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ArchiveError {
    /// It could not be downloaded.
    #[error(transparent)]
    Fetch(#[from] FetchError),
    /// It is another than the one published, or than the one that came the first time. It is not kept.
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
    /// It came whole and holds what it should not, or lacks what it should hold. It is not kept.
    #[error(
        "{url}: expected an archive of files and folders, found {reason}; the file (SHA-256 {sha256}) was removed: try again, or unpack one that you trust yourself"
    )]
    Unusable {
        /// The address.
        url: String,
        /// Checksum of the file.
        sha256: String,
        /// What is wrong with it.
        reason: String,
    },
    /// It came whole, and there is no room for what is in it. What came is kept.
    #[error("{}: expected to write it, found: {source}; {}; {} is kept, and the same command goes on from it", path.display(), write_advice(source, super::ELSEWHERE), part.display())]
    Write {
        /// The file that could not be written.
        path: PathBuf,
        /// What came.
        part: PathBuf,
        /// The system's reason.
        source: Error,
    },
    /// Something else has the folder's name.
    #[error("{}: expected no folder, or one with {holds}, found something else; move it away, or name another folder to pull to", path.display())]
    InTheWay {
        /// The folder.
        path: PathBuf,
        /// The file that tells that it is the right one.
        holds: String,
    },
    /// The checksum of the first download cannot be read.
    #[error("{}: expected to read it, found: {source}; check its permissions", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: Error,
    },
    /// The checksum of the first download is none.
    #[error("{}: expected the SHA-256 of the first download, found something else; remove this file, and the next download is recorded as the first", path.display())]
    Record {
        /// The file.
        path: PathBuf,
    },
}

impl ArchiveError {
    /// Whether the caller asked to stop.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        matches!(self, Self::Fetch(FetchError::Stopped { .. }))
    }
}
