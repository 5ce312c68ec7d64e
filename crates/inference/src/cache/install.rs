//! Installs models into the cache: files are written under temporary names and renamed, so that a model's name never denotes a partial
//! file.

use super::Cache;
use super::error::CacheError;
use super::listing::{CachedModel, check_size};
use super::name::check_name;
use super::record::{Record, now};
use std::fs::{File, OpenOptions};
use std::io::ErrorKind;
use std::path::Path;
use stillpoint_files::{Aside, sha256_hex, sync_folder};

/// Held while files are renamed. Model names never begin with a dot, so this is not the lock of a download.
const LOCK: &str = ".install.lock";

impl Cache {
    /// Installs a model under this name, replacing an older one. `onnx` is the network; `card` is the text of its card (TOML), needed for
    /// networks that are not recognised; `record` is its origin, and its `sha256`, `bytes` and `installed` are filled in.
    ///
    /// All files are first written under temporary names and synced to disk; a failure until then leaves an older model unchanged. Then the
    /// record is renamed, then the card, then the network. An interruption in between leaves a record without a network or with the older
    /// network, which counts as damaged: a network is never without its card or with the card of another.
    ///
    /// # Errors
    /// The name is invalid, the network is larger than [`LARGEST`](super::LARGEST), or the cache cannot be written.
    pub fn install(
        &self,
        name: &str,
        onnx: &[u8],
        card: Option<&str>,
        record: Record,
    ) -> Result<CachedModel, CacheError> {
        self.install_in_steps(name, onnx, card, record, &mut || Ok(()))
    }

    /// Writes a small file beside a model ([`Cache::file`]) atomically. The folder must exist.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write_file(&self, name: &str, suffix: &str, text: &str) -> Result<(), CacheError> {
        let path = self.file(name, suffix);
        rename(aside(&path, text.as_bytes())?, &path)
    }

    /// Removes a file beside a model ([`Cache::file`]) if it exists.
    ///
    /// # Errors
    /// It exists and cannot be removed.
    pub fn remove_file(&self, name: &str, suffix: &str) -> Result<(), CacheError> {
        remove(&self.file(name, suffix))
    }

    /// Like [`Cache::install`], calling a fallible hook before each change of a file with a model's name.
    fn install_in_steps(
        &self,
        name: &str,
        onnx: &[u8],
        card: Option<&str>,
        record: Record,
        before_step: &mut dyn FnMut() -> Result<(), CacheError>,
    ) -> Result<CachedModel, CacheError> {
        check_name(name)?;
        check_size(&self.onnx_path(name), onnx.len() as u64)?;
        let folder = self.make()?;
        let record = Record {
            sha256: sha256_hex(onnx),
            bytes: onnx.len() as u64,
            installed: Some(now()),
            ..record
        };
        let (onnx_path, card_path) = (self.onnx_path(name), self.card_path(name));
        let record_path = self.record_path(name);
        let text = record.to_toml().map_err(|found| CacheError::Record {
            path: record_path.clone(),
            found,
        })?;
        let onnx = aside(&onnx_path, onnx)?;
        let card = card.map(|card| aside(&card_path, card.as_bytes()));
        let card = card.transpose()?;
        let text = aside(&record_path, text.as_bytes())?;

        // Concurrent installations of one name must not mix their files.
        let _lock = lock(&folder.join(LOCK))?;
        for path in [&record_path, &card_path, &onnx_path] {
            refuse_folder(path)?;
        }
        before_step()?;
        rename(text, &record_path)?;
        // Makes the order hold on disk, too.
        sync_folder(&folder);
        before_step()?;
        match card {
            Some(card) => rename(card, &card_path)?,
            None => remove(&card_path)?,
        }
        sync_folder(&folder);
        before_step()?;
        rename(onnx, &onnx_path)?;
        sync_folder(&folder);
        self.find(name)?.ok_or_else(|| CacheError::Read {
            path: onnx_path,
            source: ErrorKind::NotFound.into(),
        })
    }
}

/// Writes the temporary file for this path and syncs it to disk.
fn aside(path: &Path, bytes: &[u8]) -> Result<Aside, CacheError> {
    Aside::with(path, bytes).map_err(|e| unwritable(path, e))
}

fn rename(aside: Aside, to: &Path) -> Result<(), CacheError> {
    aside.take_place(to).map_err(|e| unwritable(to, e))
}

fn unwritable(path: &Path, source: std::io::Error) -> CacheError {
    CacheError::Write {
        path: path.to_owned(),
        source,
    }
}

/// A folder cannot be replaced by a file; this must be known before the first renaming.
fn refuse_folder(path: &Path) -> Result<(), CacheError> {
    if path.symlink_metadata().is_ok_and(|m| m.is_dir()) {
        return Err(unwritable(path, ErrorKind::IsADirectory.into()));
    }
    Ok(())
}

/// Waits for the lock on renaming. The system releases it with the process; the empty file stays.
fn lock(path: &Path) -> Result<File, CacheError> {
    let locked = || {
        let file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .open(path)?;
        file.lock().map(|()| file)
    };
    locked().map_err(|e| unwritable(path, e))
}

fn remove(path: &Path) -> Result<(), CacheError> {
    match std::fs::remove_file(path) {
        Ok(()) => Ok(()),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(()),
        Err(e) => Err(unwritable(path, e)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::State;
    use super::*;

    fn break_off(cache: &Cache, step: usize, onnx: &[u8], card: Option<&str>) {
        let mut left = step;
        let mut before_step = || match left.checked_sub(1) {
            Some(fewer) => {
                left = fewer;
                Ok(())
            }
            None => Err(CacheError::Write {
                path: "disk".into(),
                source: ErrorKind::StorageFull.into(),
            }),
        };
        cache
            .install_in_steps("net", onnx, card, Record::default(), &mut before_step)
            .unwrap_err();
    }

    #[test]
    fn interrupted_install_never_separates_model_and_card() {
        for card in [None, Some("new card")] {
            for step in 0..3 {
                let folder = tempfile::tempdir().unwrap();
                let cache = Cache::at(folder.path());
                break_off(&cache, step, b"new", card);
                assert_eq!(cache.find("net").unwrap(), None, "step {step}");

                let older = Some("older card");
                cache
                    .install("net", b"older", older, Record::default())
                    .unwrap();
                break_off(&cache, step, b"new", card);
                let model = cache.find("net").unwrap().unwrap();
                if step == 0 {
                    assert_eq!(model.read().unwrap(), b"older");
                    assert_eq!(model.card_text().unwrap().as_deref(), older);
                } else {
                    let damaged = matches!(model.state, State::Damaged(_));
                    assert!(damaged && model.read().is_err(), "step {step}");
                }

                // The same call without an interruption.
                let repaired = cache
                    .install("net", b"new", card, Record::default())
                    .unwrap();
                assert_eq!(repaired.read().unwrap(), b"new");
                assert_eq!(repaired.card_text().unwrap().as_deref(), card);
                assert!(cache.strays().unwrap().is_empty());
            }
        }
    }

    /// Models placed there by hand have no record, and are equally protected.
    #[test]
    fn interrupted_install_over_an_unrecorded_model_is_damage() {
        for step in 1..3 {
            let folder = tempfile::tempdir().unwrap();
            let cache = Cache::at(folder.path());
            std::fs::create_dir_all(cache.folder()).unwrap();
            std::fs::write(cache.onnx_path("net"), b"own").unwrap();
            std::fs::write(cache.card_path("net"), b"own card").unwrap();
            break_off(&cache, step, b"new", Some("new card"));
            let model = cache.find("net").unwrap().unwrap();
            assert!(matches!(model.state, State::Damaged(_)), "step {step}");
        }
    }
}
