//! What can be wrong with a recording, said so that the user can correct it.

use crate::budget::one_line;
use std::path::{Path, PathBuf};
use stillpoint_datasets::DatasetError;
use stillpoint_ros_messages::WireError;

/// Result of this crate.
pub type Result<T> = std::result::Result<T, RecordingError>;

/// A recording or data set cannot be used. Every message names the place, what was expected, what was found, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// A data set folder cannot be used.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// Reading failed for a reason of the system.
    #[error("{}: expected to read it, found: {source}; check that the file exists and may be read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file is of none of the formats, or damaged from the beginning.
    #[error("{}: expected {expected}, found {found}; {advice}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What it should be.
        expected: String,
        /// What it is.
        found: String,
        /// What to do.
        advice: String,
    },
    /// No topics make an RGB-D camera, or more than one pair does.
    #[error("{}: expected {expected}, found {found}; {advice}", path.display())]
    Topics {
        /// The file.
        path: PathBuf,
        /// What was needed.
        expected: String,
        /// What is in the recording.
        found: String,
        /// What to do.
        advice: String,
    },
    /// The camera is not known, or not one that can be worked with.
    #[error("{}: expected {expected}, found {found}; {advice}", path.display())]
    Camera {
        /// The file.
        path: PathBuf,
        /// What was needed.
        expected: String,
        /// What is in the recording.
        found: String,
        /// What to do.
        advice: String,
    },
    /// A message does not read.
    #[error("{}: topic {topic}, message of {stamp:.6} s: {source}; record it again, or leave the topic out", path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// When it was recorded, s.
        stamp: f64,
        /// What is wrong.
        source: WireError,
    },
    /// A camera does not give frames.
    #[error("{device}: expected {expected}, found {found}")]
    Device {
        /// The camera.
        device: String,
        /// What was needed.
        expected: String,
        /// What there is.
        found: String,
    },
    /// An image is broken, or of a kind that is not read.
    #[error("{}: topic {topic}, message of {stamp:.6} s: expected {expected}, found {found}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// When it was recorded, s.
        stamp: f64,
        /// What was needed.
        expected: String,
        /// What is there.
        found: String,
    },
}

impl RecordingError {
    /// The same without line breaks and what else steers a terminal: names come from files.
    pub(crate) fn on_one_line(mut self) -> Self {
        let texts: Vec<&mut String> = match &mut self {
            Self::Format {
                expected,
                found,
                advice,
                ..
            }
            | Self::Topics {
                expected,
                found,
                advice,
                ..
            }
            | Self::Camera {
                expected,
                found,
                advice,
                ..
            } => vec![expected, found, advice],
            Self::Image {
                topic,
                expected,
                found,
                ..
            } => vec![topic, expected, found],
            _ => Vec::new(),
        };
        for text in texts {
            *text = one_line(text);
        }
        self
    }

    pub(crate) fn read(path: &Path) -> impl Fn(std::io::Error) -> Self + '_ {
        |source| Self::Read {
            path: path.to_owned(),
            source,
        }
    }

    pub(crate) fn format(
        path: &Path,
        expected: &str,
        found: impl Into<String>,
        advice: &str,
    ) -> Self {
        Self::Format {
            path: path.to_owned(),
            expected: expected.to_owned(),
            found: found.into(),
            advice: advice.to_owned(),
        }
    }

    pub(crate) fn topics(
        path: &Path,
        expected: &str,
        found: impl Into<String>,
        advice: &str,
    ) -> Self {
        Self::Topics {
            path: path.to_owned(),
            expected: expected.to_owned(),
            found: found.into(),
            advice: advice.to_owned(),
        }
    }
}
