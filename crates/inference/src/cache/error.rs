//! Errors of the model cache, and their messages.

use std::path::PathBuf;

/// Error: the cache or a model in it cannot be used. Every message names the path, the expectation, the finding and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CacheError {
    /// The environment does not name the user's folders.
    #[error(
        "expected a folder for models, found none of {looked} in the environment; set STILLPOINT_CACHE to a folder"
    )]
    NoHome {
        /// The variables that were read.
        looked: &'static str,
    },
    /// The cache, or a folder above it, is not a folder.
    #[error("{}: expected a folder for models, found {found}; move it away, or set STILLPOINT_CACHE to another folder", path.display())]
    NoFolder {
        /// Path in the way.
        path: PathBuf,
        /// Its kind.
        found: &'static str,
    },
    /// An invalid model name.
    #[error(
        "expected a model's name of at most 64 letters, digits, \"-\", \"_\" or \".\" that begins with a letter or digit, found {problem} in {name:?}; choose another name"
    )]
    Name {
        /// The name, shortened.
        name: String,
        /// The problem.
        problem: String,
    },
    /// The bytes differ from the installed ones.
    #[error("{}: expected the model that was installed (SHA-256 {expected}, {expected_bytes} bytes), found another (SHA-256 {found}, {found_bytes} bytes); get it again with `stillpoint models pull` or `import`, or remove {} if the change was yours", path.display(), record.display())]
    Changed {
        /// The model.
        path: PathBuf,
        /// Its record.
        record: PathBuf,
        /// Recorded checksum.
        expected: String,
        /// Recorded size.
        expected_bytes: u64,
        /// Checksum of the file.
        found: String,
        /// Size of the file.
        found_bytes: u64,
    },
    /// A record cannot be parsed.
    #[error("{}: expected where the model came from, found {found}; remove this file, then the model counts as one of your own", path.display())]
    Record {
        /// The record.
        path: PathBuf,
        /// The problem.
        found: String,
    },
    /// The checksum of a first download cannot be parsed.
    #[error("{}: expected the SHA-256 of the first download, found something else; remove this file, then the next download counts as the first", path.display())]
    Checksum {
        /// The file.
        path: PathBuf,
    },
    /// A model is larger than the limit.
    #[error("{}: expected a model of at most {limit} bytes, found {found}; remove the file", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The limit, bytes.
        limit: u64,
        /// Its size, bytes.
        found: u64,
    },
    /// Reading failed.
    #[error("{}: expected to read it, found: {source}; check that it exists and may be read", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// Writing failed.
    #[error("{}: expected to write it, found: {source}; {}", path.display(), write_advice(source))]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
}

fn write_advice(source: &std::io::Error) -> &'static str {
    use std::io::ErrorKind;
    match source.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            "free some space and try again, or set STILLPOINT_CACHE to a folder on another disk"
        }
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
            "check the folder's permissions, or set STILLPOINT_CACHE to a folder of yours"
        }
        _ => {
            "check the folder's permissions and the free space, or set STILLPOINT_CACHE to another folder"
        }
    }
}
