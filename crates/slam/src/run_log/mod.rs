//! The run log: the order in which stages took their messages.
//!
//! Together with frames and configuration it makes a threaded run reproducible: a stage's output is a pure function of
//! its messages in order, and a message exists once its sender has processed its own, so entries can always be executed
//! one after the other ([`Replay`](crate::Replay)).
//!
//! As text: a header, lines about the run, one entry per line, and a last line with their number and a checksum.
//! Numbers are written so that they parse to the same bits.

mod inertial;
mod line;
mod odometry;
mod reader;
mod word;

use crate::fingerprint::Fingerprint;
use crate::mapping::MappingEffort;
use crate::messages::{LoopCloserMsg, MapperMsg};
use reader::Line;
use stillpoint_detection::{DetectError, Detections};
use stillpoint_imaging::{FrameId, ImuSample, OdometrySample, RgbdFrame};
use stillpoint_map::{Correction, KeyframeId};

/// First line of every log, with the format version.
const HEADER: &str = "stillpoint run log 1";

/// One stage took one message.
#[derive(Clone, Debug, PartialEq)]
pub enum LogEntry {
    /// The tracker took a frame.
    TrackFrame {
        /// Frame number.
        frame: FrameId,
        /// Its colour stamp, s.
        stamp: f64,
    },
    /// The tracker took a view of the map.
    TrackView {
        /// Index of the mapper's reply that contained it, from 0.
        answer: u64,
    },
    /// The tracker took a place index.
    TrackPlaces {
        /// Index of the loop closer's reply that contained it, from 0.
        answer: u64,
    },
    /// The tracker received a detector's result.
    TrackDetections {
        /// The frame to be tracked next.
        next: FrameId,
        /// The detector's result, stored so that a replay needs no network.
        said: Result<Detections, DetectError>,
    },
    /// The tracker received inertial samples, in order of time.
    TrackInertial {
        /// The samples.
        samples: Vec<ImuSample>,
    },
    /// The tracker received odometry samples, in order of time.
    TrackOdometry {
        /// The samples.
        samples: Vec<OdometrySample>,
    },
    /// The stream ended while the first frames of a map were being tracked again.
    TrackEnd,
    /// The number of keypoints per image was changed.
    TrackEffort {
        /// Keypoints per image.
        features: u32,
    },
    /// The work per keyframe of the mapper was changed.
    MapEffort {
        /// Work per keyframe.
        effort: MappingEffort,
    },
    /// The mapper took a keyframe.
    MapKeyframe {
        /// Keyframe id.
        keyframe: KeyframeId,
    },
    /// The mapper took late verdicts on a keyframe.
    MapRejudge {
        /// Keyframe id.
        keyframe: KeyframeId,
    },
    /// The mapper revoked the beginning of a map.
    MapRevoke {
        /// First revoked id.
        first: KeyframeId,
        /// Last revoked id.
        last: KeyframeId,
    },
    /// The mapper took a correction.
    MapCorrect {
        /// Version of the map from which it was computed.
        base_version: u64,
    },
    /// The loop closer took a keyframe.
    LoopKeyframe {
        /// Keyframe id.
        keyframe: KeyframeId,
        /// Version of the attached view.
        map_version: u64,
    },
    /// The loop closer took late verdicts on a keyframe.
    LoopRejudged {
        /// Keyframe id.
        keyframe: KeyframeId,
        /// Version of the attached view.
        map_version: u64,
    },
    /// The loop closer took a revocation.
    LoopRevoked {
        /// Version of the attached view.
        map_version: u64,
    },
    /// The loop closer was informed that its correction was applied.
    LoopCorrected {
        /// First version that contains it.
        map_version: u64,
    },
}

impl From<&MapperMsg> for LogEntry {
    fn from(message: &MapperMsg) -> Self {
        match message {
            MapperMsg::Keyframe(k) => Self::MapKeyframe { keyframe: k.id },
            MapperMsg::Rejudge { keyframe, .. } => Self::MapRejudge {
                keyframe: *keyframe,
            },
            MapperMsg::Revoke { first, last } => Self::MapRevoke {
                first: *first,
                last: *last,
            },
            MapperMsg::Correct(c) => Self::of_correction(c),
        }
    }
}

impl LogEntry {
    /// Entry for a frame of the tracker.
    #[must_use]
    pub fn of_frame(frame: &RgbdFrame) -> Self {
        Self::TrackFrame {
            frame: frame.id,
            stamp: frame.stamp,
        }
    }

    /// Entry for a correction of the mapper.
    #[must_use]
    pub fn of_correction(correction: &Correction) -> Self {
        Self::MapCorrect {
            base_version: correction.base_version,
        }
    }

    /// Entry for a message of the loop closer; `None` for a map that existed before the first frame.
    #[must_use]
    pub fn of_loop_closer(message: &LoopCloserMsg) -> Option<Self> {
        match message {
            LoopCloserMsg::Keyframe { id, view } => Some(Self::LoopKeyframe {
                keyframe: *id,
                map_version: view.version(),
            }),
            LoopCloserMsg::Rejudged { id, view } => Some(Self::LoopRejudged {
                keyframe: *id,
                map_version: view.version(),
            }),
            LoopCloserMsg::Revoked { view, .. } => Some(Self::LoopRevoked {
                map_version: view.version(),
            }),
            LoopCloserMsg::Corrected { map_version } => Some(Self::LoopCorrected {
                map_version: *map_version,
            }),
            LoopCloserMsg::Known { .. } => None,
        }
    }
}

/// A log that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogError {
    /// Line, from 1.
    pub line: usize,
    /// Expected content.
    pub expected: String,
    /// Found content.
    pub found: String,
}

impl std::fmt::Display for LogError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "line {}: expected {}, found {}",
            self.line, self.expected, self.found
        )
    }
}

impl std::error::Error for LogError {}

/// The log of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct RunLog {
    /// Hash of configuration, camera and initial map ([`Stages::fingerprint`](crate::Stages::fingerprint)).
    pub fingerprint: u64,
    /// Free text of the program that made the log, such as its configuration. Ignored by the replay.
    pub about: String,
    /// Entries in order of execution.
    pub entries: Vec<LogEntry>,
    /// Hash of the resulting trajectory ([`Trajectory::digest`](crate::Trajectory::digest)).
    pub trajectory: u64,
}

impl RunLog {
    /// Writes the log as text.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut text = format!("{HEADER}\nstages {:016x}\n", self.fingerprint);
        line::write_about(&mut text, &self.about);
        for entry in &self.entries {
            line::write(&mut text, entry);
        }
        text.push_str(&format!("trajectory {:016x}\n", self.trajectory));
        let end = end_line(self.entries.len(), &text);
        text + &end + "\n"
    }

    /// Reads a log.
    ///
    /// # Errors
    /// [`LogError`] with the first invalid line, or the last one if the log is incomplete or was changed.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, LogError> {
        let text = std::str::from_utf8(bytes).map_err(|e| {
            let before = &bytes[..e.valid_up_to()];
            LogError {
                line: 1 + before.iter().filter(|b| **b == b'\n').count(),
                expected: "text in UTF-8".to_owned(),
                found: "other bytes".to_owned(),
            }
        })?;
        let log = Self::parse(text)?;
        let (body, end) = split_end(text);
        let expected = end_line(log.entries.len(), body);
        if end != expected {
            return Err(LogError {
                line: text.lines().count(),
                expected: format!("{expected:?}, by the lines before"),
                found: format!("{end:?}: the log was changed or damaged"),
            });
        }
        Ok(log)
    }

    /// Reads a log without verifying its checksum.
    fn parse(text: &str) -> Result<Self, LogError> {
        let mut lines = Line::all(text);
        let first = Line::next(&mut lines)?;
        if first.text != HEADER {
            return Err(first.error(&format!("{HEADER:?}")));
        }
        let fingerprint = Line::next(&mut lines)?.only_hex("stages")?;
        let (mut about, mut entries) = (Vec::new(), Vec::new());
        let trajectory = loop {
            let line = Line::next(&mut lines)?;
            if let Some(said) = line.about()?.filter(|_| entries.is_empty()) {
                about.push(said);
                continue;
            }
            if line.text.starts_with("trajectory ") {
                break line.only_hex("trajectory")?;
            }
            entries.push(line::read(&line, &mut lines)?);
        };
        let end = Line::next(&mut lines)?;
        let mut words = end.words("end")?;
        let count: usize = words.number("the number of entries")?;
        words.hex("a check sum")?;
        words.finish()?;
        if count != entries.len() {
            return Err(end.error(&format!("{} entries", entries.len())));
        }
        match lines.next() {
            None => Ok(Self {
                fingerprint,
                about: about.join("\n"),
                entries,
                trajectory,
            }),
            Some(line) => Err(line.error("nothing after the end")),
        }
    }
}

/// The last line, from the number of entries and the text before it.
fn end_line(entries: usize, before: &str) -> String {
    let mut f = Fingerprint::default();
    f.text(before);
    format!("end {entries} {:016x}", f.value())
}

/// All lines but the last, and the last without its line feed.
fn split_end(text: &str) -> (&str, &str) {
    let whole = text.strip_suffix('\n').unwrap_or(text);
    let at = whole.rfind('\n').map_or(0, |i| i + 1);
    (&text[..at], &whole[at..])
}

#[cfg(test)]
mod tests;
