//! The steps of a download, from a partial file to the complete one.

use crate::address;
use crate::disk::Disk;
use crate::error::FetchError;
use crate::http::{self, Answer, Range, request};
use crate::part::{Origin, Part};
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::ops::ControlFlow;
use std::time::Duration;
use stillpoint_files::Digest;

/// Time limits for servers. The total time is not limited: a slow connection may take an hour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Waits {
    /// Maximum wait for a connection. Default: 20 s.
    pub connect: Duration,
    /// Maximum wait for a response, or for more data. Default: 30 s.
    pub stall: Duration,
}

impl Default for Waits {
    fn default() -> Self {
        Self {
            connect: Duration::from_secs(20),
            stall: Duration::from_secs(30),
        }
    }
}

/// A published file, and options of its download.
#[derive(Clone, Copy, Debug)]
pub struct Wanted<'a> {
    /// Address.
    pub address: &'a str,
    /// Bytes of the published file, if known.
    pub bytes: Option<u64>,
    /// Maximum bytes of a file of unknown size.
    pub largest: u64,
    /// Whether the caller knows the checksum: it would detect a change of the file between two parts if the server does not.
    pub vouched: bool,
    /// Required free space before the first byte, in multiples of the file's size, including the file itself.
    pub room: u64,
    /// Alternative way to obtain the file, as part of messages.
    pub by_hand: &'a str,
    /// Time limits for servers.
    pub waits: Waits,
}

/// Progress of a download. Not every kind of file reaches all states.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Progress {
    /// The server is contacted.
    Connecting {
        /// The address.
        url: String,
    },
    /// Data is received. First reported before the first byte.
    Receiving {
        /// Bytes present.
        received: u64,
        /// Bytes of the complete file, if known.
        total: Option<u64>,
        /// Bytes present from an interrupted download.
        resumed: u64,
    },
    /// The archive is unpacked.
    Unpacking {
        /// Processed bytes of the archive.
        done: u64,
        /// Bytes of the archive.
        total: u64,
    },
    /// The complete file is compared with its checksum.
    Checking,
    /// The caller converts the file.
    Converting,
}

/// Called with the progress at least after each 64 kB; it may stop the download. It is not called while the server is silent.
pub type Watch<'a> = &'a mut dyn FnMut(Progress) -> ControlFlow<()>;

/// A complete file, under the name of its partial download.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fetched {
    /// SHA-256, 64 lower-case hexadecimal digits.
    pub sha256: String,
    /// Bytes that were transferred.
    pub transferred: u64,
    /// Bytes present from an interrupted download.
    pub resumed: u64,
}

/// Completes a partial download.
///
/// # Errors
/// See [`FetchError`].
pub fn fetch(
    wanted: &Wanted<'_>,
    part: &Part,
    disk: &dyn Disk,
    watch: Watch<'_>,
) -> Result<Fetched, FetchError> {
    let download = Download { wanted, part, disk };
    let (mut range, total) = part.range(wanted.address, wanted.vouched)?;
    let total = wanted.bytes.or(total);
    if total.is_some_and(|bytes| range.start > bytes) {
        part.discard()?;
        range = Range::default();
    }
    if range.start > 0 && total == Some(range.start) {
        // It was complete before a later step failed, e.g. unpacking to a full disk.
        return download.is_whole(range.start);
    }
    loop {
        let url = download.url();
        download.tell(watch, Progress::Connecting { url })?;
        let answer = request(wanted, &range)?;
        let fits = answer.status == 206
            && answer.start == Some(range.start)
            && (answer.total.is_none_or(|total| total > range.start));
        match answer.status {
            200 => {
                download.check_answer(&answer, 0)?;
                part.begin(&Origin {
                    url: wanted.address.to_owned(),
                    validator: answer.validator.clone(),
                    total: answer.total,
                })?;
                return download.receive(answer, 0, watch);
            }
            206 if fits && range.start > 0 => {
                download.check_answer(&answer, range.start)?;
                return download.receive(answer, range.start, watch);
            }
            // No bytes follow, and the file is unchanged: it was complete.
            416 if range.start > 0 && answer.total == Some(range.start) => {
                return download.is_whole(range.start);
            }
            // The partial file does not match: start over without a range, which can happen only once.
            _ if range.start > 0 => {
                part.discard()?;
                range = Range::default();
            }
            status => {
                return Err(FetchError::Status {
                    url: answer.url,
                    status,
                    by_hand: wanted.by_hand.to_owned(),
                });
            }
        }
    }
}

struct Download<'a> {
    wanted: &'a Wanted<'a>,
    part: &'a Part,
    disk: &'a dyn Disk,
}

impl Download<'_> {
    /// The address for messages, without a mirror's password.
    fn url(&self) -> String {
        address::shown(self.wanted.address)
    }

    fn tell(&self, watch: Watch<'_>, state: Progress) -> Result<(), FetchError> {
        match watch(state) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(FetchError::Stopped {
                received: self.part.bytes(),
                part: self.part.path().to_owned(),
            }),
        }
    }

    fn is_whole(&self, resumed: u64) -> Result<Fetched, FetchError> {
        Ok(Fetched {
            sha256: self.hash(resumed)?.hex(),
            transferred: 0,
            resumed,
        })
    }

    /// Checksum state of the present bytes.
    fn hash(&self, here: u64) -> Result<Digest, FetchError> {
        let mut digest = Digest::default();
        if here > 0 {
            let path = self.part.path();
            let read = File::open(path).and_then(|mut file| digest.add_all(&mut file));
            read.map_err(|e| self.part.unusable(path, e))?;
        }
        Ok(digest)
    }

    /// Checks before the first byte. `here`: bytes already present.
    fn check_answer(&self, answer: &Answer, here: u64) -> Result<(), FetchError> {
        if answer.is_page {
            return Err(FetchError::WebPage {
                url: answer.url.clone(),
                by_hand: self.wanted.by_hand.to_owned(),
            });
        }
        match (answer.total, self.wanted.bytes) {
            (Some(total), Some(bytes)) if total != bytes => {
                return Err(self.wrong_size(total.to_string()));
            }
            (Some(total), None) if total > self.wanted.largest => {
                return Err(self.wrong_size(total.to_string()));
            }
            _ => {}
        }
        self.check_room(answer.total.or(self.wanted.bytes), here)
    }

    fn check_room(&self, total: Option<u64>, here: u64) -> Result<(), FetchError> {
        let folder = self.part.path().parent().unwrap_or(self.part.path());
        let needed = total.unwrap_or(0).saturating_mul(self.wanted.room);
        let needed = needed.saturating_sub(here);
        match self.disk.free(folder) {
            Some(free) if free < needed => Err(FetchError::Room {
                url: self.url(),
                folder: folder.to_owned(),
                needed,
                free,
                elsewhere: self.part.elsewhere().to_owned(),
            }),
            _ => Ok(()),
        }
    }

    fn wrong_size(&self, found: String) -> FetchError {
        FetchError::Size {
            url: self.url(),
            expected: match self.wanted.bytes {
                Some(bytes) => format!("{bytes} bytes"),
                None => format!("at most {} bytes", self.wanted.largest),
            },
            found,
            by_hand: self.wanted.by_hand.to_owned(),
        }
    }

    /// Appends received data to the partial file.
    fn receive(
        &self,
        mut answer: Answer,
        resumed: u64,
        watch: Watch<'_>,
    ) -> Result<Fetched, FetchError> {
        let part = self.part;
        let total = self.wanted.bytes.or(answer.total);
        let limit = total.unwrap_or(self.wanted.largest);
        let mut hash = self.hash(resumed)?;
        let mut file = self
            .disk
            .append(part.path())
            .map_err(|e| self.unwritable(resumed, e))?;
        let mut received = resumed;
        let mut buffer = vec![0; 1 << 16];
        loop {
            self.tell(
                watch,
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
                Err(e) => return Err(self.broken_off(total, http::broken_by(e))),
            };
            if n as u64 > limit - received {
                drop(file);
                part.discard()?;
                return Err(self.wrong_size(format!("more than {limit}")));
            }
            file.write_all(&buffer[..n])
                .map_err(|e| self.unwritable(part.bytes(), e))?;
            hash.add(&buffer[..n]);
            received += n as u64;
        }
        if total.is_some_and(|total| received < total) {
            return Err(self.broken_off(total, "the end".to_owned()));
        }
        Ok(Fetched {
            sha256: hash.hex(),
            transferred: received - resumed,
            resumed,
        })
    }

    fn unwritable(&self, received: u64, source: std::io::Error) -> FetchError {
        FetchError::Write {
            part: self.part.path().to_owned(),
            received,
            source,
            elsewhere: self.part.elsewhere().to_owned(),
        }
    }

    fn broken_off(&self, total: Option<u64>, reason: String) -> FetchError {
        FetchError::BrokenOff {
            url: self.url(),
            received: self.part.bytes(),
            total,
            reason,
            part: self.part.path().to_owned(),
        }
    }
}
