//! What is here of an unfinished download: the bytes, and enough to know whose bytes they are.

use super::http::Range;
use crate::catalogue::KnownModel;
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use stillpoint_inference::{Cache, CacheError};

/// Where the bytes of a part came from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Origin {
    url: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    validator: Option<String>,
}

/// The unfinished download of one model.
#[derive(Clone, Debug)]
pub(super) struct Part {
    cache: Cache,
    name: String,
    path: PathBuf,
    origin_path: PathBuf,
}

/// What the names of the two files end with: the bytes, and whose bytes they are.
const BYTES: &str = "part";
const ORIGIN: &str = "part.toml";

impl Part {
    pub(super) fn of(model: &KnownModel, cache: &Cache) -> Self {
        Self {
            cache: cache.clone(),
            name: model.name.to_owned(),
            path: cache.file(model.name, BYTES),
            origin_path: cache.file(model.name, ORIGIN),
        }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes that are here.
    pub(super) fn len(&self) -> u64 {
        self.path.metadata().map_or(0, |m| m.len())
    }

    /// What to ask for, so that it fits to what is here. A part of another address, or one that cannot be distinguished from that of
    /// a changed file (no validator, and no checksum that would find out), is removed.
    pub(super) fn range(&self, url: &str, has_checksum: bool) -> Result<Range, CacheError> {
        let start = self.len();
        let origin = std::fs::read_to_string(&self.origin_path)
            .ok()
            .and_then(|text| toml::from_str::<Origin>(&text).ok())
            .filter(|origin| origin.url == url)
            .filter(|origin| match &origin.validator {
                Some(validator) => validator.chars().all(|c| matches!(c, ' '..='~')),
                None => has_checksum,
            });
        match origin {
            Some(Origin { validator, .. }) if start > 0 => Ok(Range { start, validator }),
            _ => {
                self.discard()?;
                Ok(Range::default())
            }
        }
    }

    /// Starts a part over: empty, and with its origin written before its first byte.
    pub(super) fn begin(&self, url: &str, validator: Option<String>) -> Result<(), CacheError> {
        let unwritable = |source| CacheError::Write {
            path: self.origin_path.clone(),
            source,
        };
        self.discard()?;
        let origin = Origin {
            url: url.to_owned(),
            validator,
        };
        let text = toml::to_string(&origin)
            .map_err(|e| unwritable(std::io::Error::other(e.to_string())))?;
        self.cache.write_file(&self.name, ORIGIN, &text)
    }

    /// The bytes, whole.
    pub(super) fn read(&self, limit: u64) -> Result<Vec<u8>, CacheError> {
        let mut bytes = Vec::new();
        File::open(&self.path)
            .and_then(|file| file.take(limit).read_to_end(&mut bytes))
            .map_err(|source| CacheError::Read {
                path: self.path.clone(),
                source,
            })?;
        Ok(bytes)
    }

    /// Removes the bytes first: an origin without bytes is harmless.
    pub(super) fn discard(&self) -> Result<(), CacheError> {
        self.cache.remove_file(&self.name, BYTES)?;
        self.cache.remove_file(&self.name, ORIGIN)
    }
}

/// Where parts are written: the disk, or in tests one that is full.
pub(super) trait Disk {
    /// Opens a file to append to it, and makes it where it is missing.
    fn append(&self, path: &Path) -> std::io::Result<Box<dyn Write>>;
}

/// The disk.
pub(super) struct RealDisk;

impl Disk for RealDisk {
    fn append(&self, path: &Path) -> std::io::Result<Box<dyn Write>> {
        let file = OpenOptions::new().create(true).append(true).open(path)?;
        Ok(Box::new(file))
    }
}

/// The right to download one model. The system takes it back when the process ends, however it ends, so that there are no
/// stale locks; the empty file stays.
#[derive(Debug)]
pub(super) struct Lock {
    _file: File,
}

impl Lock {
    /// `None` if another download has it.
    pub(super) fn take(path: &Path) -> Result<Option<Self>, CacheError> {
        let unwritable = |source| CacheError::Write {
            path: path.to_owned(),
            source,
        };
        let file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .open(path)
            .map_err(unwritable)?;
        match file.try_lock() {
            Ok(()) => Ok(Some(Self { _file: file })),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(e)) => Err(unwritable(e)),
        }
    }
}
