//! The steps of a download, from the question whether the model is here to the model in the cache.

use super::address;
use super::error::{ByHand, PullError};
use super::http::{self, Answer, Range, page_hint, request};
use super::part::{Disk, Lock, Part};
use super::{Checksum, Convert, Progress, PullOptions, Pulled};
use crate::catalogue::{KnownModel, UPSTREAM};
use std::io::{ErrorKind, Read, Write};
use std::ops::ControlFlow;
use std::path::PathBuf;
use stillpoint_inference::{
    Cache, CacheError, CachedModel, Form, LARGEST, State, check_name, is_sha256, sha256_hex,
};

/// What the name of the file ends with that holds the checksum of a first download.
const CHECKSUM: &str = "sha256";

/// One download.
pub(super) struct Job<'a> {
    pub(super) model: &'a KnownModel,
    pub(super) cache: &'a Cache,
    pub(super) options: &'a PullOptions,
    pub(super) disk: &'a dyn Disk,
    pub(super) convert: Convert<'a>,
}

/// Called with the progress; it may break off.
type Watch<'a> = &'a mut dyn FnMut(Progress) -> ControlFlow<()>;

/// How much came, and how much was here.
struct Transfer {
    transferred: u64,
    resumed: u64,
}

impl Job<'_> {
    /// See [`pull`](super::pull).
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
        let Some(_lock) = Lock::take(&lock)? else {
            let name = self.model.name.to_owned();
            return Err(PullError::Busy { name, lock });
        };
        let part = Part::of(self.model, self.cache);
        let transfer = self.download(&part, progress)?;
        self.tell(&part, progress, Progress::Checking)?;
        let published = part.read(LARGEST)?;
        let sha256 = self.verify(&part, &published, expected.as_deref())?;
        let model = self.install(&part, &published, &sha256, progress)?;
        if self.model.sha256.is_none() {
            self.record(&sha256)?;
        }
        part.discard()?;
        Ok(Pulled {
            model,
            url: self.url(),
            checksum: self.checksum(expected.is_some()),
            sha256,
            transferred: transfer.transferred,
            resumed: transfer.resumed,
        })
    }

    /// The address for messages and the record, without the password that a mirror's may hold.
    fn url(&self) -> String {
        address::shown(&self.address())
    }

    /// The address that is asked for.
    fn address(&self) -> String {
        match (&self.options.base, self.model.url.strip_prefix(UPSTREAM)) {
            (Some(base), Some(path)) => format!("{}{path}", base.trim_end_matches('/')),
            _ => self.model.url.to_owned(),
        }
    }

    fn by_hand(&self) -> Box<ByHand> {
        Box::new(ByHand::new(self.model, self.cache))
    }

    fn checksum(&self, expected: bool) -> Checksum {
        match (self.model.sha256, expected) {
            (Some(_), _) => Checksum::Verified,
            (None, true) => Checksum::MatchesRecord,
            (None, false) => Checksum::Recorded,
        }
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
            Ok(text) => match text.split_whitespace().next().filter(|sum| is_sha256(sum)) {
                Some(sha256) => Ok(Some(sha256.to_owned())),
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

    /// The model, if it is here, undamaged, and made from the published file. Another of its name is the user's, and not replaced; a damaged one
    /// is of no use to anyone.
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
                checksum: self.checksum(true),
                transferred: 0,
                resumed: 0,
            })),
            // Its checksum was removed, so that this download counts as the first.
            None if self.was_pulled(&model) => Ok(None),
            _ => Err(PullError::Another {
                name: model.name.clone(),
                found: source.clone(),
                path: model.onnx,
            }),
        }
    }

    /// Whether an earlier download brought it, from whatever server.
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
            ControlFlow::Break(()) => Err(PullError::Stopped {
                received: part.len(),
                part: part.path().to_owned(),
            }),
        }
    }

    /// Brings the part to its full length.
    fn download(&self, part: &Part, progress: Watch<'_>) -> Result<Transfer, PullError> {
        let address = self.address();
        let mut range = part.range(&address, self.model.sha256.is_some())?;
        if self.model.bytes.is_some_and(|bytes| range.start > bytes) {
            part.discard()?;
            range = Range::default();
        }
        if self.model.bytes == Some(range.start) {
            // All of it came, and then something else failed, as writing the model to a full disk.
            let resumed = range.start;
            return Ok(Transfer {
                transferred: 0,
                resumed,
            });
        }
        loop {
            let connecting = Progress::Connecting { url: self.url() };
            self.tell(part, progress, connecting)?;
            let answer = request(&address, &range, self.options, &self.by_hand())?;
            let fits = answer.status == 206
                && answer.start == Some(range.start)
                && (answer.total.is_none_or(|total| total > range.start));
            match answer.status {
                200 => {
                    self.check_answer(&answer)?;
                    part.begin(&address, answer.validator.clone())?;
                    return self.receive(part, answer, 0, progress);
                }
                206 if fits && range.start > 0 => {
                    self.check_answer(&answer)?;
                    return self.receive(part, answer, range.start, progress);
                }
                // Nothing comes after what is here, and the file is still the same: it was whole.
                416 if range.start > 0 && answer.total == Some(range.start) => {
                    let resumed = range.start;
                    return Ok(Transfer {
                        transferred: 0,
                        resumed,
                    });
                }
                // What is here does not fit to what is there: start over, without a range, so that this happens once.
                _ if range.start > 0 => {
                    part.discard()?;
                    range = Range::default();
                }
                status => {
                    return Err(PullError::Status {
                        url: answer.url,
                        status,
                        by_hand: self.by_hand(),
                    });
                }
            }
        }
    }

    /// What can be known before the first byte.
    fn check_answer(&self, answer: &Answer) -> Result<(), PullError> {
        if answer.is_page {
            return Err(PullError::WebPage {
                url: answer.url.clone(),
                by_hand: self.by_hand(),
            });
        }
        match (answer.total, self.model.bytes) {
            (Some(total), Some(bytes)) if total != bytes => Err(self.wrong_size(total.to_string())),
            (Some(total), None) if total > LARGEST => Err(self.wrong_size(total.to_string())),
            _ => Ok(()),
        }
    }

    fn wrong_size(&self, found: String) -> PullError {
        PullError::Size {
            url: self.url(),
            expected: match self.model.bytes {
                Some(bytes) => format!("{bytes} bytes"),
                None => format!("at most {LARGEST} bytes"),
            },
            found,
            by_hand: self.by_hand(),
        }
    }

    /// Appends what comes to the part.
    fn receive(
        &self,
        part: &Part,
        mut answer: Answer,
        resumed: u64,
        progress: Watch<'_>,
    ) -> Result<Transfer, PullError> {
        let total = self.model.bytes.or(answer.total);
        let limit = total.unwrap_or(LARGEST);
        let unwritable = |received, source| PullError::Write {
            part: part.path().to_owned(),
            received,
            source,
        };
        let mut file = self
            .disk
            .append(part.path())
            .map_err(|e| unwritable(resumed, e))?;
        let mut received = resumed;
        let mut buffer = vec![0; 1 << 16];
        loop {
            self.tell(
                part,
                progress,
                Progress::Receiving {
                    received,
                    total,
                    resumed,
                },
            )?;
            let n = match answer.body.read(&mut buffer) {
                Ok(0) => break,
                Ok(n) => n,
                Err(e) if e.kind() == ErrorKind::Interrupted => continue,
                Err(e) => return Err(self.broken_off(part, total, broken_by(e))),
            };
            if n as u64 > limit - received {
                drop(file);
                part.discard()?;
                return Err(self.wrong_size(format!("more than {limit}")));
            }
            file.write_all(&buffer[..n])
                .map_err(|e| unwritable(part.len(), e))?;
            received += n as u64;
        }
        if total.is_some_and(|total| received < total) {
            return Err(self.broken_off(part, total, "the end".to_owned()));
        }
        Ok(Transfer {
            transferred: received - resumed,
            resumed,
        })
    }

    fn broken_off(&self, part: &Part, total: Option<u64>, reason: String) -> PullError {
        PullError::BrokenOff {
            url: self.url(),
            received: part.len(),
            total,
            reason,
            part: part.path().to_owned(),
        }
    }

    /// The checksum of the file, if it is the right one.
    fn verify(
        &self,
        part: &Part,
        published: &[u8],
        expected: Option<&str>,
    ) -> Result<String, PullError> {
        let found = sha256_hex(published);
        let Some(expected) = expected.filter(|expected| **expected != *found) else {
            return Ok(found);
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
            found,
            advice,
        })
    }

    /// Makes the file a model of the cache.
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

fn broken_by(error: std::io::Error) -> String {
    match ureq::Error::from(error) {
        ureq::Error::Timeout(_) => "no more in time".to_owned(),
        other => http::reason_of(&other),
    }
}
