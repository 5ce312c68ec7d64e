//! What lies in the cache: models, damaged ones and files of others included.

use super::error::CacheError;
use super::name::check_name;
use super::record::Record;
use super::{Cache, LARGEST, in_the_way};
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use stillpoint_files::{Digest, sha256_hex};

/// Whether a model is what its record says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    /// Its bytes are those on record.
    Good,
    /// It was put here by hand: there is no record, so nothing to compare it with. It is used like the others.
    Own,
    /// It is not used; the text says why and what to do.
    Damaged(String),
}

/// A model in the cache.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct CachedModel {
    /// Its name.
    pub name: String,
    /// The network.
    pub onnx: PathBuf,
    /// The card beside it, if there is one.
    pub card: Option<PathBuf>,
    /// Size of the network, bytes; 0 if it cannot be read.
    pub bytes: u64,
    /// SHA-256 of the network; empty if it cannot be read.
    pub sha256: String,
    /// Where it came from, if that is known.
    pub record: Option<Record>,
    /// Whether it is what its record says.
    pub state: State,
}

/// Something else in the cache.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Stray {
    /// The file or folder.
    pub path: PathBuf,
    /// What it seems to be.
    pub what: &'static str,
    /// Its size, bytes; 0 for folders.
    pub bytes: u64,
}

impl CachedModel {
    /// The bytes of the network, compared with the record as they are read.
    ///
    /// # Errors
    /// The file or its record cannot be read, or it is not what was installed.
    pub fn read(&self) -> Result<Vec<u8>, CacheError> {
        let mut file = open(&self.onnx)?;
        let mut bytes = Vec::new();
        let unreadable = |source| CacheError::Read {
            path: self.onnx.clone(),
            source,
        };
        file.read_to_end(&mut bytes).map_err(unreadable)?;
        let record = self.onnx.with_extension("record.toml");
        let (sha256, size) = (sha256_hex(&bytes), bytes.len() as u64);
        match read_record(&record)? {
            Some(on_record) => compare(&self.onnx, &record, &on_record, &sha256, size)?,
            None => check_size(&self.onnx, size)?,
        }
        Ok(bytes)
    }

    /// The text of the card beside it; `None` if it has none.
    ///
    /// # Errors
    /// The card is there and cannot be read.
    pub fn card_text(&self) -> Result<Option<String>, CacheError> {
        self.card.as_ref().map_or(Ok(None), |path| {
            let mut text = String::new();
            open(path)?
                .take(LONGEST_CARD)
                .read_to_string(&mut text)
                .map_err(|source| CacheError::Read {
                    path: path.clone(),
                    source,
                })?;
            Ok(Some(text))
        })
    }
}

impl Cache {
    /// All models, by name. Each is read and its checksum compared. A cache that does not exist holds none.
    ///
    /// # Errors
    /// The folder cannot be read, or is no folder. What is wrong with one model is its [`State`].
    pub fn list(&self) -> Result<Vec<CachedModel>, CacheError> {
        let mut models = Vec::new();
        for file in self.files()? {
            if let Some(name) = model_name(&file) {
                models.extend(self.find(&name)?);
            }
        }
        Ok(models)
    }

    /// What else lies in the folder, by name: unfinished downloads, records without a model, files of others.
    ///
    /// # Errors
    /// As for [`Cache::list`].
    pub fn strays(&self) -> Result<Vec<Stray>, CacheError> {
        let files = self.files()?;
        let names: Vec<String> = files.iter().filter_map(|file| model_name(file)).collect();
        let belongs = |file: &str| {
            let of = |suffix: &str| file.strip_suffix(suffix);
            let name = of(".record.toml").or(of(".toml")).or(of(".onnx"));
            name.is_some_and(|name| names.iter().any(|n| n == name))
        };
        Ok(files
            .iter()
            .filter_map(|file| {
                let what = match file {
                    _ if belongs(file) || file.ends_with(".lock") => return None,
                    _ if file.ends_with(".sha256") => return None,
                    _ if file.ends_with(".part.toml") => return None,
                    _ if file.ends_with(".part") => {
                        "an unfinished download, which `models pull` resumes"
                    }
                    _ if file.ends_with(".tmp") => {
                        "left behind by an installation that broke off; it may be removed"
                    }
                    _ if file.ends_with(".record.toml") || file.ends_with(".toml") => {
                        "a card or record without a model; it may be removed"
                    }
                    _ => "not a model; models are files with names like yolox-nano.onnx",
                };
                let path = self.folder().join(file);
                let bytes = path
                    .metadata()
                    .map_or(0, |m| if m.is_file() { m.len() } else { 0 });
                Some(Stray { path, what, bytes })
            })
            .collect())
    }

    /// The model of this name; `None` if it is not here.
    ///
    /// # Errors
    /// The cache is no folder. What is wrong with the model is its [`State`].
    pub fn find(&self, name: &str) -> Result<Option<CachedModel>, CacheError> {
        self.check_folder()?;
        let onnx = self.onnx_path(name);
        // A link to nowhere is a model, and damaged: the user put it there.
        let absent = |e: std::io::Error| e.kind() == ErrorKind::NotFound;
        if check_name(name).is_err() || onnx.symlink_metadata().is_err_and(absent) {
            return Ok(None);
        }
        let record_path = self.record_path(name);
        let mut model = CachedModel {
            name: name.to_owned(),
            card: Some(self.card_path(name)).filter(|card| card.symlink_metadata().is_ok()),
            bytes: 0,
            sha256: String::new(),
            record: None,
            state: State::Own,
            onnx,
        };
        if let Err(e) = inspect(&mut model, &record_path) {
            model.state = State::Damaged(e.to_string());
        }
        Ok(Some(model))
    }

    /// The model to use when the user names none: the first of these names that is here, else the first by name. A damaged one is
    /// not passed over: using another than the last time without a word would be worse than the error that reading it gives.
    ///
    /// # Errors
    /// As for [`Cache::list`].
    pub fn preferred<'a>(
        &self,
        order: impl IntoIterator<Item = &'a str>,
    ) -> Result<Option<CachedModel>, CacheError> {
        for name in order {
            if let Some(model) = self.find(name)? {
                return Ok(Some(model));
            }
        }
        let names = self.files()?.into_iter().find_map(|file| model_name(&file));
        names.map_or(Ok(None), |name| self.find(&name))
    }

    /// Names of what lies in the folder, sorted; none if it does not exist.
    fn files(&self) -> Result<Vec<String>, CacheError> {
        self.check_folder()?;
        let folder = self.folder();
        let unreadable = |source| CacheError::Read {
            path: folder.clone(),
            source,
        };
        let entries = match std::fs::read_dir(&folder) {
            Ok(entries) => entries,
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            Err(e) => return Err(unreadable(e)),
        };
        let mut files = entries
            .map(|entry| entry.map(|e| e.file_name().to_string_lossy().into_owned()))
            .collect::<Result<Vec<_>, _>>()
            .map_err(unreadable)?;
        files.sort();
        Ok(files)
    }

    fn check_folder(&self) -> Result<(), CacheError> {
        match in_the_way(&self.folder()) {
            Some(path) => Err(CacheError::NoFolder {
                path: path.to_owned(),
                found: "a file",
            }),
            None => Ok(()),
        }
    }
}

/// The model that a file of this name is.
fn model_name(file: &str) -> Option<String> {
    let name = file.strip_suffix(".onnx")?;
    check_name(name).is_ok().then(|| name.to_owned())
}

/// Fills in what the files say.
fn inspect(model: &mut CachedModel, record_path: &Path) -> Result<(), CacheError> {
    let mut digest = Digest::default();
    let read = digest.add_all(&mut open(&model.onnx)?);
    model.bytes = read.map_err(|source| CacheError::Read {
        path: model.onnx.clone(),
        source,
    })?;
    model.sha256 = digest.hex();
    model.record = read_record(record_path)?;
    match &model.record {
        Some(record) => {
            compare(&model.onnx, record_path, record, &model.sha256, model.bytes)?;
            model.state = State::Good;
        }
        None => {
            check_size(&model.onnx, model.bytes)?;
        }
    }
    Ok(())
}

/// Bytes of a card that are read: a list of a thousand classes has some ten thousand.
const LONGEST_CARD: u64 = 1 << 22;

/// Opens a regular file, of which no more than [`LARGEST`] and one byte can be read.
fn open(path: &Path) -> Result<impl Read + use<>, CacheError> {
    let unreadable = |source| CacheError::Read {
        path: path.to_owned(),
        source,
    };
    let metadata = path.metadata().map_err(unreadable)?;
    if !metadata.is_file() {
        return Err(unreadable(std::io::Error::other("not a file")));
    }
    check_size(path, metadata.len())?;
    let file = std::fs::File::open(path).map_err(unreadable)?;
    Ok(file.take(LARGEST + 1))
}

pub(crate) fn check_size(path: &Path, found: u64) -> Result<(), CacheError> {
    if found > LARGEST {
        return Err(CacheError::TooLarge {
            path: path.to_owned(),
            limit: LARGEST,
            found,
        });
    }
    Ok(())
}

fn compare(
    onnx: &Path,
    record_path: &Path,
    record: &Record,
    sha256: &str,
    bytes: u64,
) -> Result<(), CacheError> {
    if record.sha256 == sha256 {
        return Ok(());
    }
    Err(CacheError::Changed {
        path: onnx.to_owned(),
        record: record_path.to_owned(),
        expected: record.sha256.clone(),
        expected_bytes: record.bytes,
        found: sha256.to_owned(),
        found_bytes: bytes,
    })
}

/// The record at this path; `None` if there is none.
fn read_record(path: &Path) -> Result<Option<Record>, CacheError> {
    /// A record has some hundred bytes.
    const LONGEST: u64 = 1 << 16;
    let damaged = |found| CacheError::Record {
        path: path.to_owned(),
        found,
    };
    let mut text = String::new();
    let file = match std::fs::metadata(path) {
        // A pipe would be waited for.
        Ok(found) if !found.is_file() => Err(std::io::Error::other("not a file")),
        Ok(_) => std::fs::File::open(path),
        Err(e) => Err(e),
    };
    match file {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        Err(source) => {
            return Err(CacheError::Read {
                path: path.to_owned(),
                source,
            });
        }
        Ok(file) => file
            .take(LONGEST)
            .read_to_string(&mut text)
            .map_err(|e| damaged(e.to_string()))?,
    };
    Record::parse(&text).map(Some).map_err(damaged)
}
