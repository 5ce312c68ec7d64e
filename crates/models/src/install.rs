//! Putting a model into the cache: written aside, then moved into place, so that no half file ever has a model's name.

use crate::cache::Cache;
use crate::checksum::sha256_hex;
use crate::error::CacheError;
use crate::listing::CachedModel;
use crate::name::check_name;
use crate::record::{Record, now};
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

impl Cache {
    /// Puts a model into the cache under this name; an older one of that name is replaced. `onnx` are the bytes of the network; `card` is the
    /// text of its card (TOML), where the network is not recognised by itself; `record` says where it came from, and its `sha256`, `bytes` and
    /// `installed` are filled in.
    ///
    /// All files are first written aside and brought to the disk. Only then the network takes its name, then the card, then
    /// the record; what fails before leaves an older model as it was.
    ///
    /// # Errors
    /// The name cannot be a model's, or the cache cannot be written.
    pub fn install(
        &self,
        name: &str,
        onnx: &[u8],
        card: Option<&str>,
        record: Record,
    ) -> Result<CachedModel, CacheError> {
        check_name(name)?;
        let folder = self.make()?;
        let record = Record {
            sha256: sha256_hex(onnx),
            bytes: onnx.len() as u64,
            installed: Some(now()),
            ..record
        };
        let record_path = self.record_path(name);
        let text = record.to_toml().map_err(|found| CacheError::Record {
            path: record_path.clone(),
            found,
        })?;
        let onnx = Aside::write(&folder, name, onnx)?;
        let card = card
            .map(|card| Aside::write(&folder, name, card.as_bytes()))
            .transpose()?;
        let text = Aside::write(&folder, name, text.as_bytes())?;

        // Two installations of one name at once must not mix their files.
        let _lock = lock(&folder.join("install.lock"))?;
        onnx.rename(&self.onnx_path(name))?;
        match card {
            Some(card) => card.rename(&self.card_path(name))?,
            None => remove(&self.card_path(name))?,
        }
        text.rename(&record_path)?;
        sync_folder(&folder);
        self.find(name)?.ok_or_else(|| CacheError::Read {
            path: self.onnx_path(name),
            source: ErrorKind::NotFound.into(),
        })
    }
}

/// A file under a name that no one else uses, in the folder of its final place. Dropping it removes it.
#[derive(Debug)]
struct Aside {
    path: PathBuf,
}

impl Aside {
    fn write(folder: &Path, name: &str, bytes: &[u8]) -> Result<Self, CacheError> {
        static COUNT: AtomicU64 = AtomicU64::new(0);
        let path = folder.join(format!(
            ".{name}.{}-{}.tmp",
            std::process::id(),
            COUNT.fetch_add(1, Ordering::Relaxed)
        ));
        let failed = |path: &Path, source| CacheError::Write {
            path: path.to_owned(),
            source,
        };
        // A file of this name is of an earlier process with our number, which did not end well.
        remove(&path)?;
        let mut file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .open(&path)
            .map_err(|e| failed(&path, e))?;
        let aside = Self { path };
        file.write_all(bytes)
            .and_then(|()| file.sync_all())
            .map_err(|e| failed(&aside.path, e))?;
        Ok(aside)
    }

    fn rename(self, to: &Path) -> Result<(), CacheError> {
        // Once it has moved, dropping finds nothing to remove.
        std::fs::rename(&self.path, to).map_err(|source| CacheError::Write {
            path: to.to_owned(),
            source,
        })
    }
}

impl Drop for Aside {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Waits until no one else renames files. The system ends the lock with the process; the empty file stays.
fn lock(path: &Path) -> Result<File, CacheError> {
    let locked = || {
        let file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .open(path)?;
        file.lock().map(|()| file)
    };
    locked().map_err(|source| CacheError::Write {
        path: path.to_owned(),
        source,
    })
}

/// Writes a small file as a whole or not at all.
#[cfg(feature = "pull")]
pub(crate) fn replace(folder: &Path, name: &str, to: &Path, text: &str) -> Result<(), CacheError> {
    Aside::write(folder, name, text.as_bytes())?.rename(to)
}

/// Removes a file that may not be there.
pub(crate) fn remove(path: &Path) -> Result<(), CacheError> {
    match std::fs::remove_file(path) {
        Ok(()) => Ok(()),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(()),
        Err(source) => Err(CacheError::Write {
            path: path.to_owned(),
            source,
        }),
    }
}

/// Brings the renamings to the disk. Where a folder cannot be opened for that (Windows) the file system orders them by itself.
fn sync_folder(folder: &Path) {
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}
