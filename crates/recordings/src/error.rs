//! Errors of recordings.

use crate::budget::one_line;
use std::path::{Path, PathBuf};
use stillpoint_datasets::DatasetError;
use stillpoint_ros_messages::WireError;

/// Result of this crate.
pub type Result<T> = std::result::Result<T, RecordingError>;

/// A recording or data set cannot be used. Every message states the location, the expectation, the finding, and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// A data set folder cannot be used.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The system could not read a file.
    #[error("{}: expected to read it, found: {source}; check that the file exists and may be read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file has no known format, or is damaged from its beginning.
    #[error("{}: expected {expected}, found {found}; {advice}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Expectation.
        expected: String,
        /// Finding.
        found: String,
        /// Remedy.
        advice: String,
    },
    /// No topics form an RGB-D camera, or several pairs do.
    #[error("{}: expected {expected}, found {found}; {advice}", path.display())]
    Topics {
        /// The file.
        path: PathBuf,
        /// Expectation.
        expected: String,
        /// Finding.
        found: String,
        /// Remedy.
        advice: String,
    },
    /// The camera is unknown or unusable.
    #[error("{}: expected {expected}, found {found}; {advice}", path.display())]
    Camera {
        /// The file.
        path: PathBuf,
        /// Expectation.
        expected: String,
        /// Finding.
        found: String,
        /// Remedy.
        advice: String,
    },
    /// A message cannot be parsed.
    #[error("{}: topic {topic}, message of {stamp:.6} s: {source}; record it again, or leave the topic out", path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Time of recording, s.
        stamp: f64,
        /// The parse error.
        source: WireError,
    },
    /// A camera delivers no frames.
    #[error("{device}: expected {expected}, found {found}")]
    Device {
        /// The camera.
        device: String,
        /// Expectation.
        expected: String,
        /// Finding.
        found: String,
    },
    /// An image is damaged, or has an unsupported format.
    #[error("{}: topic {topic}, message of {stamp:.6} s: expected {expected}, found {found}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Time of recording, s.
        stamp: f64,
        /// Expectation.
        expected: String,
        /// Finding.
        found: String,
    },
}

impl RecordingError {
    /// A copy with escaped line breaks and control characters, since names come from files.
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
