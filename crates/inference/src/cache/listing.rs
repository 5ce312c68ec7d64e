//! Lists the cache: models, damaged ones and other files included.

use super::error::CacheError;
use super::name::check_name;
use super::record::Record;
use super::{Cache, LARGEST, in_the_way};
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use stillpoint_files::{Digest, sha256_hex};

/// Whether a model matches its record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    /// The bytes match the record.
    Good,
    /// Placed there by hand: without a record, there is nothing to compare with. Used like the others.
    Own,
    /// Not used; the text gives the reason and the remedy.
    Damaged(String),
}

/// A model in the cache.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct CachedModel {
    /// Name.
    pub name: String,
    /// The network.
    pub onnx: PathBuf,
    /// Its card, if any.
    pub card: Option<PathBuf>,
    /// Size of the network, bytes; 0 if it cannot be read.
    pub bytes: u64,
    /// SHA-256 of the network; empty if it cannot be read.
    pub sha256: String,
    /// Its origin, if known.
    pub record: Option<Record>,
    /// Whether it matches its record.
    pub state: State,
}

/// Another file or folder in the cache.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Stray {
    /// Its path.
    pub path: PathBuf,
    /// Its apparent kind.
    pub what: &'static str,
    /// Size, bytes; 0 for folders.
    pub bytes: u64,
}

impl CachedModel {
    /// The bytes of the network, compared with the record on reading.
    ///
    /// # Errors
    /// The file or its record cannot be read, or they differ.
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

    /// Text of its card; `None` if it has none.
    ///
    /// # Errors
    /// The card exists and cannot be read.
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
    /// All models, by name. Each is read and its checksum compared. Empty if the cache does not exist.
    ///
    /// # Errors
    /// The folder cannot be read, or is not a folder. Problems of one model are in its [`State`].
    pub fn list(&self) -> Result<Vec<CachedModel>, CacheError> {
        let mut models = Vec::new();
        for file in self.files()? {
            if let Some(name) = model_name(&file) {
                models.extend(self.find(&name)?);
            }
        }
        Ok(models)
    }

    /// Other contents of the folder, by name: partial downloads, records without a model, foreign files.
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

    /// The model of this name; `None` if it is absent.
    ///
    /// # Errors
    /// The cache is not a folder. Problems of the model are in its [`State`].
    pub fn find(&self, name: &str) -> Result<Option<CachedModel>, CacheError> {
        self.check_folder()?;
        let onnx = self.onnx_path(name);
        // A dangling link is a damaged model: the user placed it there.
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

    /// The model to use if the user names none: the first of these names that is present, else the first by name. Damaged models are not
    /// skipped: silently using another than last time would be worse than the error on reading it.
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

    /// Names in the folder, sorted; empty if it does not exist.
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

fn model_name(file: &str) -> Option<String> {
    let name = file.strip_suffix(".onnx")?;
    check_name(name).is_ok().then(|| name.to_owned())
}

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

/// Maximum number of bytes read from a card: a list of a thousand classes has some ten thousand.
const LONGEST_CARD: u64 = 1 << 22;

/// Opens a regular file, limited to [`LARGEST`] plus one bytes.
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

fn read_record(path: &Path) -> Result<Option<Record>, CacheError> {
    /// A record has some hundred bytes.
    const LONGEST: u64 = 1 << 16;
    let damaged = |found| CacheError::Record {
        path: path.to_owned(),
        found,
    };
    let mut text = String::new();
    let file = match std::fs::metadata(path) {
        // Reading a pipe would block.
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
