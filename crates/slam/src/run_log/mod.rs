//! The log of a run: in which order its stages took their messages.
//!
//! Answers: what has to be known, beside frames and configuration, to run again what threads and clocks decided. A stage's
//! answers are a pure function of the messages it took, in their order. A message exists once the stage that sent it has
//! taken its own and is done; so carrying out the entries one after the other is always possible
//! ([`Replay`](crate::Replay)).
//!
//! As a text: a header, lines about the run, one entry per line, and a last line that tells their number and a check sum of all before it.
//! Numbers are written so that they read back to the same bits.

mod inertial;
mod line;
mod odometry;
mod word;

use crate::fingerprint::Fingerprint;
use crate::mapping::MappingEffort;
use crate::messages::{LoopCloserMsg, MapperMsg};
use line::Line;
use stillpoint_detection::{DetectError, Detections};
use stillpoint_imaging::{FrameId, ImuSample, OdometrySample, RgbdFrame};
use stillpoint_map::{Correction, KeyframeId};

/// First line of every log; the number is the version of the format.
const HEADER: &str = "stillpoint run log 1";

/// One stage took one message.
#[derive(Clone, Debug, PartialEq)]
pub enum LogEntry {
    /// The tracker took a frame.
    TrackFrame {
        /// Its number.
        frame: FrameId,
        /// Its colour stamp, s.
        stamp: f64,
    },
    /// The tracker took a view of the map.
    TrackView {
        /// The mapper's answer that brought it, counted from 0.
        answer: u64,
    },
    /// The tracker took the places that can be recognised.
    TrackPlaces {
        /// The loop closer's answer that brought them, counted from 0.
        answer: u64,
    },
    /// The tracker received a detector's answer.
    TrackDetections {
        /// The frame that was to be tracked next.
        next: FrameId,
        /// What the detector said; kept here, so that no network is needed to run again.
        said: Result<Detections, DetectError>,
    },
    /// The tracker received samples of an inertial sensor; kept here, in the order of time.
    TrackInertial {
        /// The samples.
        samples: Vec<ImuSample>,
    },
    /// The tracker received samples of odometry; kept here, in the order of time.
    TrackOdometry {
        /// The samples.
        samples: Vec<OdometrySample>,
    },
    /// The tracker heard that the stream is over before it had tracked the first frames of a map again.
    TrackEnd,
    /// The tracker was set how many keypoints are wanted per image from now on.
    TrackEffort {
        /// So many.
        features: u32,
    },
    /// The mapper was set how much work goes into a keyframe from now on.
    MapEffort {
        /// So much.
        effort: MappingEffort,
    },
    /// The mapper took a keyframe.
    MapKeyframe {
        /// Its id.
        keyframe: KeyframeId,
    },
    /// The mapper learned what moves in a keyframe.
    MapRejudge {
        /// Its id.
        keyframe: KeyframeId,
    },
    /// The mapper took back the beginning of a map.
    MapRevoke {
        /// The first keyframe that it may hold.
        first: KeyframeId,
        /// The last one.
        last: KeyframeId,
    },
    /// The mapper took a correction.
    MapCorrect {
        /// The version that it corrects.
        base_version: u64,
    },
    /// The loop closer took a keyframe.
    LoopKeyframe {
        /// Its id.
        keyframe: KeyframeId,
        /// Version of the view that came with it.
        map_version: u64,
    },
    /// The loop closer learned what moves in a keyframe.
    LoopRejudged {
        /// Its id.
        keyframe: KeyframeId,
        /// Version of the view that came with it.
        map_version: u64,
    },
    /// The loop closer learned that the beginning of a map was taken back.
    LoopRevoked {
        /// Version of the view that came with it.
        map_version: u64,
    },
    /// The loop closer learned that its correction is in the map.
    LoopCorrected {
        /// The version that holds it.
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
    /// That the tracker took a frame.
    #[must_use]
    pub fn of_frame(frame: &RgbdFrame) -> Self {
        Self::TrackFrame {
            frame: frame.id,
            stamp: frame.stamp,
        }
    }

    /// That the mapper took a correction.
    #[must_use]
    pub fn of_correction(correction: &Correction) -> Self {
        Self::MapCorrect {
            base_version: correction.base_version,
        }
    }

    /// That the loop closer took a message; nothing for a map that was there before the first frame.
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

/// Bytes are no log that can be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogError {
    /// Line, from 1.
    pub line: usize,
    /// What it should hold.
    pub expected: String,
    /// What it holds.
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
    /// Tells configuration, camera and first map ([`Stages::fingerprint`](crate::Stages::fingerprint)).
    pub fingerprint: u64,
    /// What the program that ran the stages wants to find here again, such as their configuration. Means nothing to the replay.
    pub about: String,
    /// What was taken, in the order of taking.
    pub entries: Vec<LogEntry>,
    /// Tells the trajectory that came out ([`Trajectory::digest`](crate::Trajectory::digest)).
    pub trajectory: u64,
}

impl RunLog {
    /// The log as a text.
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
    /// [`LogError`] with the first line that does not read, or the last when something is missing or was changed.
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

    /// Reads a log whatever its check sum.
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

/// The last line, for the number of entries and all that is before it.
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
