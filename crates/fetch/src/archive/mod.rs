//! Installs a published archive as a folder: downloads it, compares its checksum, unpacks it to a temporary folder, and renames that
//! atomically.
//!
//! The download is kept until the folder is in its place, so neither a lost connection nor a full disk loses it.

mod error;
mod limits;
mod unpack;

pub use error::ArchiveError;

use crate::address;
use crate::checksum::{Checksum, recorded};
use crate::disk::{Disk, settle};
use crate::download::{Fetched, Progress, Waits, Wanted, Watch, fetch};
use crate::error::FetchError;
use crate::http::page_hint;
use crate::part::{Lock, Part};
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use unpack::{Fault, Unpack};

/// Archive format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// tar in gzip (`.tgz`).
    TarGz,
    /// zip, entries stored or deflated.
    Zip,
}

/// A published archive, and the resulting folder.
#[derive(Clone, Copy, Debug)]
pub struct Archive<'a> {
    /// Address.
    pub address: &'a str,
    /// Name of the published file.
    pub file: &'a str,
    /// Name of the resulting folder.
    pub folder: &'a str,
    /// A file in that folder, which identifies the right one.
    pub holds: &'a str,
    /// Archive format.
    pub packing: Packing,
    /// SHA-256 of the published file, 64 lower-case hexadecimal digits, if known.
    pub sha256: Option<&'a str>,
    /// Time limits for servers.
    pub waits: Waits,
}

/// An installed folder.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Pulled {
    /// The folder.
    pub folder: PathBuf,
    /// SHA-256 of the published file, and its origin; `None` if the folder was present without a checksum.
    pub sha256: Option<(String, Checksum)>,
    /// The file beside the folder with that checksum, in the format of `sha256sum`.
    pub record: PathBuf,
    /// Bytes that were transferred; 0 if the folder or the complete archive was present.
    pub transferred: u64,
    /// Bytes of the archive present from an interrupted download.
    pub resumed: u64,
}

/// Required free space for an archive, in multiples of its size: itself, and its images, which do not compress.
const ROOM: u64 = 2;
/// Alternative folder, as part of messages.
const ELSEWHERE: &str = "name a folder on another disk";

/// Installs an archive's folder in `dir`, unless it is present. `dir` is created if missing.
///
/// # Errors
/// See [`ArchiveError`]. After any of them there is either no folder of the name or the unchanged previous one.
pub fn pull(
    archive: &Archive<'_>,
    dir: &Path,
    disk: &dyn Disk,
    watch: Watch<'_>,
) -> Result<Pulled, ArchiveError> {
    let pull = Pull { archive, dir, disk };
    if let Some(here) = pull.already_here()? {
        return Ok(here);
    }
    std::fs::create_dir_all(dir).map_err(|e| pull.unwritable(dir, e))?;
    let lock = dir.join(format!(".{}.lock", archive.file));
    let _lock = Lock::take(&lock, archive.file, ELSEWHERE)?;
    // The previous owner of the lock may have installed it.
    match pull.already_here()? {
        Some(here) => Ok(here),
        None => pull.run(watch),
    }
}

struct Pull<'a> {
    archive: &'a Archive<'a>,
    dir: &'a Path,
    disk: &'a dyn Disk,
}

impl Pull<'_> {
    fn folder(&self) -> PathBuf {
        self.dir.join(self.archive.folder)
    }

    fn record(&self) -> PathBuf {
        self.dir.join(format!("{}.sha256", self.archive.file))
    }

    fn url(&self) -> String {
        address::shown(self.archive.address)
    }

    fn already_here(&self) -> Result<Option<Pulled>, ArchiveError> {
        let folder = self.folder();
        if !folder.join(self.archive.holds).is_file() {
            return match folder.symlink_metadata() {
                Ok(_) => Err(ArchiveError::InTheWay {
                    path: folder,
                    holds: self.archive.holds.to_owned(),
                }),
                Err(_) => Ok(None),
            };
        }
        let known = self.expected()?;
        let checksum = Checksum::of(self.archive.sha256, known.is_some());
        Ok(Some(Pulled {
            folder,
            sha256: known.map(|sha256| (sha256, checksum)),
            record: self.record(),
            transferred: 0,
            resumed: 0,
        }))
    }

    /// The checksum that the archive must have: the known one, else that of the first download.
    fn expected(&self) -> Result<Option<String>, ArchiveError> {
        if let Some(sha256) = self.archive.sha256 {
            return Ok(Some(sha256.to_owned()));
        }
        let path = self.record();
        match std::fs::read_to_string(&path) {
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
            Err(source) => Err(ArchiveError::Read { path, source }),
            Ok(text) => match recorded(&text) {
                Some(sha256) => Ok(Some(sha256)),
                None => Err(ArchiveError::Record { path }),
            },
        }
    }

    fn run(&self, watch: Watch<'_>) -> Result<Pulled, ArchiveError> {
        let expected = self.expected()?;
        let part = Part::new(self.dir, self.archive.file, ELSEWHERE);
        let fetched = self.fetch(&part, expected.is_some(), watch)?;
        self.verify(&part, &fetched, expected.as_deref())?;
        let aside = self.dir.join(format!(".unpacking-{}", self.archive.folder));
        let unpacked = self.unpack(&part, &aside, &fetched, watch);
        let placed = unpacked.and_then(|root| self.place(&root, &fetched));
        // The remains are useless: the archive is still there. Failure to remove them is no error.
        let _ = std::fs::remove_dir_all(&aside);
        placed?;
        part.discard()?;
        let checksum = Checksum::of(self.archive.sha256, expected.is_some());
        Ok(Pulled {
            folder: self.folder(),
            sha256: Some((fetched.sha256, checksum)),
            record: self.record(),
            transferred: fetched.transferred,
            resumed: fetched.resumed,
        })
    }

    fn fetch(&self, part: &Part, vouched: bool, watch: Watch<'_>) -> Result<Fetched, FetchError> {
        let by_hand = format!(
            "get {} in another way and unpack it in {}",
            self.url(),
            self.dir.display()
        );
        let wanted = Wanted {
            address: self.archive.address,
            bytes: None,
            largest: limits::LARGEST,
            vouched,
            room: ROOM,
            by_hand: &by_hand,
            waits: self.archive.waits,
        };
        fetch(&wanted, part, self.disk, watch)
    }

    fn verify(
        &self,
        part: &Part,
        fetched: &Fetched,
        expected: Option<&str>,
    ) -> Result<(), ArchiveError> {
        let Some(expected) = expected.filter(|e| *e != fetched.sha256) else {
            return Ok(());
        };
        let hint = hint(part.path());
        part.discard()?;
        let (on_record, advice) = match self.archive.sha256 {
            Some(_) => ("as published", "try again".to_owned()),
            None => (
                "as of the first download",
                format!(
                    "if its publisher replaced the file, which is worth asking, remove {} and try again",
                    self.record().display()
                ),
            ),
        };
        Err(ArchiveError::Checksum {
            url: self.url(),
            expected: expected.to_owned(),
            on_record,
            found: fetched.sha256.clone(),
            advice: format!("{hint}{advice}"),
        })
    }

    /// Unpacks into a temporary folder; returns the archive's folder in it.
    fn unpack(
        &self,
        part: &Part,
        aside: &Path,
        fetched: &Fetched,
        watch: Watch<'_>,
    ) -> Result<PathBuf, ArchiveError> {
        // Left by a killed process.
        match std::fs::remove_dir_all(aside) {
            Err(e) if e.kind() != ErrorKind::NotFound => return Err(self.unwritable(aside, e)),
            _ => {}
        }
        std::fs::create_dir(aside).map_err(|e| self.unwritable(aside, e))?;
        let packed = part.bytes();
        let mut tell = |done| {
            watch(Progress::Unpacking {
                done,
                total: packed,
            })
        };
        let unpacked = File::open(part.path())
            .map_err(|source| Fault::Disk(part.path().to_owned(), source))
            .and_then(|file| {
                let mut unpack = Unpack::new(aside, packed, self.disk, &mut tell);
                match self.archive.packing {
                    Packing::TarGz => unpack.tar_gz(file),
                    Packing::Zip => unpack.zip(file),
                }
            })
            .and_then(|()| self.root(aside));
        match unpacked {
            Ok(root) => Ok(root),
            Err(Fault::Disk(path, source)) => Err(ArchiveError::Write {
                path,
                part: part.path().to_owned(),
                source,
            }),
            Err(Fault::Stopped) => Err(ArchiveError::Fetch(FetchError::Stopped {
                received: packed,
                part: part.path().to_owned(),
            })),
            Err(Fault::Archive(reason)) => {
                let hint = hint(part.path());
                part.discard()?;
                Err(ArchiveError::Unusable {
                    url: self.url(),
                    sha256: fetched.sha256.clone(),
                    reason: format!("{hint}{reason}"),
                })
            }
        }
    }

    /// The folder with the required file: the temporary folder, or one in it.
    fn root(&self, aside: &Path) -> Result<PathBuf, Fault> {
        let holds = |folder: &PathBuf| folder.join(self.archive.holds).is_file();
        let below = std::fs::read_dir(aside).map_err(|e| Fault::Disk(aside.to_owned(), e))?;
        let mut folders: Vec<PathBuf> = below.flatten().map(|entry| entry.path()).collect();
        folders.sort();
        folders.insert(0, aside.to_owned());
        folders.into_iter().find(holds).ok_or_else(|| {
            Fault::Archive(format!(
                "no file {} at its top or in a folder there",
                self.archive.holds
            ))
        })
    }

    /// Renames the folder, after it is synced to disk and its checksum is written beside it.
    fn place(&self, root: &Path, fetched: &Fetched) -> Result<(), ArchiveError> {
        settle(root).map_err(|e| self.unwritable(root, e))?;
        let (record, folder) = (self.record(), self.folder());
        let text = format!("{}  {}\n", fetched.sha256, self.archive.file);
        std::fs::write(&record, text).map_err(|e| self.unwritable(&record, e))?;
        std::fs::rename(root, &folder).map_err(|e| self.unwritable(&folder, e))
    }

    fn unwritable(&self, path: &Path, source: std::io::Error) -> ArchiveError {
        ArchiveError::Fetch(FetchError::File {
            path: path.to_owned(),
            source,
            elsewhere: ELSEWHERE.to_owned(),
        })
    }
}

/// A hint for messages if a file looks like a web page.
fn hint(path: &Path) -> &'static str {
    let mut start = Vec::new();
    let read = File::open(path).and_then(|file| file.take(64).read_to_end(&mut start));
    read.map_or("", |_| page_hint(&start))
}
