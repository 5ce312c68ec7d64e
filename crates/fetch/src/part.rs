//! A partial download: the bytes, and the identity of their file.

use crate::error::FetchError;
use crate::http::Range;
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Origin {
    pub(crate) url: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) validator: Option<String>,
    /// Bytes of the complete file, according to the server: the partial download may be complete.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) total: Option<u64>,
}

/// The partial download of one file: `STEM.part` and `STEM.part.toml` in a folder.
#[derive(Clone, Debug)]
pub struct Part {
    path: PathBuf,
    origin_path: PathBuf,
    elsewhere: String,
}

impl Part {
    /// `elsewhere`: alternative destination, as part of messages.
    #[must_use]
    pub fn new(folder: &Path, stem: &str, elsewhere: &str) -> Self {
        Self {
            path: folder.join(format!("{stem}.part")),
            origin_path: folder.join(format!("{stem}.part.toml")),
            elsewhere: elsewhere.to_owned(),
        }
    }

    /// The file with the bytes.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of bytes present.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.path.metadata().map_or(0, |m| m.len())
    }

    pub(crate) fn elsewhere(&self) -> &str {
        &self.elsewhere
    }

    /// The range to request after the present bytes, and the size of the complete file, if known. A partial download from another address,
    /// or one for which a change of the file would go unnoticed (no validator, and no checksum), is removed.
    pub(crate) fn range(
        &self,
        url: &str,
        vouched: bool,
    ) -> Result<(Range, Option<u64>), FetchError> {
        let start = self.bytes();
        let origin = std::fs::read_to_string(&self.origin_path)
            .ok()
            .and_then(|text| toml::from_str::<Origin>(&text).ok())
            .filter(|origin| origin.url == url)
            .filter(|origin| match &origin.validator {
                Some(validator) => validator.chars().all(|c| matches!(c, ' '..='~')),
                None => vouched || origin.total == Some(start),
            });
        match origin {
            Some(origin) if start > 0 => {
                let validator = origin.validator;
                Ok((Range { start, validator }, origin.total))
            }
            _ => {
                self.discard()?;
                Ok((Range::default(), None))
            }
        }
    }

    /// Restarts a partial download: empty, with its origin written before its first byte. A truncated origin is ignored.
    pub(crate) fn begin(&self, origin: &Origin) -> Result<(), FetchError> {
        self.discard()?;
        let text = toml::to_string(origin).map_err(|e| Error::other(e.to_string()));
        text.and_then(|text| std::fs::write(&self.origin_path, text))
            .map_err(|source| self.unusable(&self.origin_path, source))
    }

    /// Removes the bytes first: an origin without bytes is harmless.
    ///
    /// # Errors
    /// A file cannot be removed.
    pub fn discard(&self) -> Result<(), FetchError> {
        for path in [&self.path, &self.origin_path] {
            match std::fs::remove_file(path) {
                Err(e) if e.kind() != ErrorKind::NotFound => return Err(self.unusable(path, e)),
                _ => {}
            }
        }
        Ok(())
    }

    pub(crate) fn unusable(&self, path: &Path, source: Error) -> FetchError {
        FetchError::File {
            path: path.to_owned(),
            source,
            elsewhere: self.elsewhere.clone(),
        }
    }
}

/// The exclusive right to download one file. The system releases it when the process ends, however it ends, so there are no stale locks;
/// the empty file stays.
#[derive(Debug)]
pub struct Lock {
    _file: File,
}

impl Lock {
    /// `name` (of the download) and `elsewhere` (alternative destination) are for messages.
    ///
    /// # Errors
    /// [`FetchError::Busy`] if another download holds it; a file that cannot be created.
    pub fn take(path: &Path, name: &str, elsewhere: &str) -> Result<Self, FetchError> {
        let unusable = |source| FetchError::File {
            path: path.to_owned(),
            source,
            elsewhere: elsewhere.to_owned(),
        };
        let file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .open(path)
            .map_err(unusable)?;
        match file.try_lock() {
            Ok(()) => Ok(Self { _file: file }),
            Err(TryLockError::WouldBlock) => Err(FetchError::Busy {
                name: name.to_owned(),
                lock: path.to_owned(),
            }),
            Err(TryLockError::Error(e)) => Err(unusable(e)),
        }
    }
}
