//! The steps of a download, from the lookup in the cache to the installation.

use super::error::{ByHand, PullError};
use super::{Checksum, Convert, Progress, PullOptions, Pulled};
use crate::catalogue::{KnownModel, UPSTREAM};
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::ops::ControlFlow;
use std::path::PathBuf;
use stillpoint_fetch::{
    Disk, FetchError, Fetched, Lock, Part, Waits, Wanted, Watch, fetch, page_hint, recorded,
    shown_address,
};
use stillpoint_inference::{Cache, CacheError, CachedModel, Form, LARGEST, State, check_name};

/// Suffix of the file with the checksum of a first download.
const CHECKSUM: &str = "sha256";
/// Required free space for a model, in sizes of the published file: that file, and its conversion.
const ROOM: u64 = 2;
const ELSEWHERE: &str = "set STILLPOINT_CACHE to a folder on another disk";

pub(super) struct Job<'a> {
    pub(super) model: &'a KnownModel,
    pub(super) cache: &'a Cache,
    pub(super) options: &'a PullOptions,
    pub(super) disk: &'a dyn Disk,
    pub(super) convert: Convert<'a>,
}

impl Job<'_> {
    pub(super) fn run(&self, progress: Watch<'_>) -> Result<Pulled, PullError> {
        check_name(self.model.name)?;
        let expected = self.expected()?;
        if !self.options.again
            && let Some(pulled) = self.already_here(expected.as_deref())?
        {
            return Ok(pulled);
        }
        self.cache.make()?;
        let lock = self.cache.file(self.model.name, "lock");
        let _lock = Lock::take(&lock, self.model.name, ELSEWHERE)?;
        let part = Part::new(&self.cache.folder(), self.model.name, ELSEWHERE);
        let fetched = self.download(&part, progress)?;
        self.tell(&part, progress, Progress::Checking)?;
        let published = read(&part)?;
        let sha256 = fetched.sha256;
        self.verify(&part, &published, &sha256, expected.as_deref())?;
        let model = self.install(&part, &published, &sha256, progress)?;
        if self.model.sha256.is_none() {
            self.record(&sha256)?;
        }
        part.discard()?;
        Ok(Pulled {
            model,
            url: self.url(),
            checksum: Checksum::of(self.model.sha256, expected.is_some()),
            sha256,
            transferred: fetched.transferred,
            resumed: fetched.resumed,
        })
    }

    /// The address for messages and the record, without a mirror's password.
    fn url(&self) -> String {
        shown_address(&self.address())
    }

    fn address(&self) -> String {
        match (&self.options.base, self.model.url.strip_prefix(UPSTREAM)) {
            (Some(base), Some(path)) => format!("{}{path}", base.trim_end_matches('/')),
            _ => self.model.url.to_owned(),
        }
    }

    fn by_hand(&self) -> ByHand {
        ByHand::new(self.model, self.cache)
    }

    /// The checksum that the published file must have: the known one, else that of the first download.
    fn expected(&self) -> Result<Option<String>, CacheError> {
        if let Some(sha256) = self.model.sha256 {
            return Ok(Some(sha256.to_owned()));
        }
        let path = self.checksum_path();
        match std::fs::read_to_string(&path) {
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
            Err(source) => Err(CacheError::Read { path, source }),
            Ok(text) => match recorded(&text) {
                Some(sha256) => Ok(Some(sha256)),
                None => Err(CacheError::Checksum { path }),
            },
        }
    }

    /// Beside the model, in the format of `sha256sum`.
    fn checksum_path(&self) -> PathBuf {
        self.cache.file(self.model.name, CHECKSUM)
    }

    fn record(&self, sha256: &str) -> Result<(), CacheError> {
        let text = format!("{sha256}  {}\n", self.model.file);
        self.cache.write_file(self.model.name, CHECKSUM, &text)
    }

    /// The model, if present, undamaged, and made from the published file. Another one of its name is the user's, and not replaced; a
    /// damaged one is ignored.
    fn already_here(&self, expected: Option<&str>) -> Result<Option<Pulled>, PullError> {
        let here = self.cache.find(self.model.name)?;
        let Some(model) = here.filter(|m| !matches!(m.state, State::Damaged(_))) else {
            return Ok(None);
        };
        let record = model.record.as_ref();
        let source = record.and_then(|r| r.source_sha256.as_ref());
        let source = source.unwrap_or(&model.sha256);
        match expected {
            Some(expected) if source == expected => Ok(Some(Pulled {
                model,
                url: self.url(),
                sha256: expected.to_owned(),
                checksum: Checksum::of(self.model.sha256, true),
                transferred: 0,
                resumed: 0,
            })),
            // Its checksum was removed, so this download counts as the first.
            None if self.was_pulled(&model) => Ok(None),
            _ => Err(PullError::Another {
                name: model.name.clone(),
                found: source.clone(),
                path: model.onnx,
            }),
        }
    }

    /// Whether it came from an earlier download, from any server.
    fn was_pulled(&self, model: &CachedModel) -> bool {
        let source = model.record.as_ref().and_then(|r| r.source.as_deref());
        let path = self.model.url.strip_prefix(UPSTREAM);
        source.is_some_and(|source| {
            source.contains("://") && source.ends_with(path.unwrap_or(self.model.url))
        })
    }

    fn tell(&self, part: &Part, progress: Watch<'_>, state: Progress) -> Result<(), PullError> {
        match progress(state) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(PullError::Fetch(FetchError::Stopped {
                received: part.bytes(),
                part: part.path().to_owned(),
            })),
        }
    }

    /// Completes the partial file.
    fn download(&self, part: &Part, progress: Watch<'_>) -> Result<Fetched, FetchError> {
        let (address, by_hand) = (self.address(), self.by_hand().to_string());
        let wanted = Wanted {
            address: &address,
            bytes: self.model.bytes,
            largest: LARGEST,
            vouched: self.model.sha256.is_some(),
            room: ROOM,
            by_hand: &by_hand,
            waits: Waits {
                connect: self.options.connect_timeout,
                stall: self.options.stall_timeout,
            },
        };
        fetch(&wanted, part, self.disk, progress)
    }

    /// Compares the file with its expected checksum.
    fn verify(
        &self,
        part: &Part,
        published: &[u8],
        found: &str,
        expected: Option<&str>,
    ) -> Result<(), PullError> {
        let Some(expected) = expected.filter(|expected| *expected != found) else {
            return Ok(());
        };
        part.discard()?;
        let hint = page_hint(published);
        let (on_record, advice) = match self.model.sha256 {
            Some(_) => {
                let advice = format!("{hint}try again, or {}", self.by_hand());
                ("as published", advice)
            }
            None => {
                let path = self.checksum_path();
                let advice = format!(
                    "{hint}if its publisher replaced the file, which is worth asking, remove {} and try again",
                    path.display()
                );
                ("as of the first download", advice)
            }
        };
        Err(PullError::Checksum {
            url: self.url(),
            expected: expected.to_owned(),
            on_record,
            found: found.to_owned(),
            advice,
        })
    }

    /// Installs the file as a model of the cache.
    fn install(
        &self,
        part: &Part,
        published: &[u8],
        sha256: &str,
        progress: Watch<'_>,
    ) -> Result<CachedModel, PullError> {
        let name = self.model.name;
        let record = self.model.record(&self.url(), published);
        if self.model.form == Form::Onnx {
            return Ok(self.cache.install(name, published, None, record)?);
        }
        self.tell(part, progress, Progress::Converting)?;
        match (self.convert)(published, name) {
            Ok((onnx, card)) => Ok(self.cache.install(name, &onnx, Some(&card), record)?),
            Err(reason) => {
                part.discard()?;
                Err(PullError::Convert {
                    url: self.url(),
                    sha256: sha256.to_owned(),
                    reason: format!("{}{reason}", page_hint(published)),
                })
            }
        }
    }
}

fn read(part: &Part) -> Result<Vec<u8>, CacheError> {
    let mut bytes = Vec::new();
    File::open(part.path())
        .and_then(|file| file.take(LARGEST).read_to_end(&mut bytes))
        .map_err(|source| CacheError::Read {
            path: part.path().to_owned(),
            source,
        })?;
    Ok(bytes)
}
