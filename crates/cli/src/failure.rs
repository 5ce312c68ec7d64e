//! Outcome of a command and its exit code.

use std::fmt::Display;
use std::path::Path;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Status {
    Ok,
    /// It ran, but lost track or failed its criteria.
    Failed,
    /// The arguments or the input cannot be used.
    Unusable,
}

impl Status {
    pub(crate) fn code(self) -> u8 {
        match self {
            Self::Ok => 0,
            Self::Failed => 1,
            Self::Unusable => 2,
        }
    }
}

/// Why a command failed: a message with expectation, finding, location and remedy.
#[derive(Debug)]
pub(crate) struct Failure {
    message: String,
    status: Status,
}

impl Failure {
    /// Wrong usage or input.
    pub(crate) fn input(message: impl Display) -> Self {
        Self {
            message: message.to_string(),
            status: Status::Unusable,
        }
    }

    /// The command ran but failed its criteria.
    pub(crate) fn criteria(message: impl Display) -> Self {
        Self {
            message: message.to_string(),
            status: Status::Failed,
        }
    }

    /// A file or folder below `--out` could not be written.
    pub(crate) fn write(path: &Path, reason: &std::io::Error) -> Self {
        Self::write_of(path, "--out", reason)
    }

    /// A file or folder named by `option` could not be written.
    pub(crate) fn write_of(path: &Path, option: &str, reason: &std::io::Error) -> Self {
        Self::input(format!(
            "{}: expected to write it, found: {reason}; check the folder's permissions and the free space, or name another with {option}",
            path.display()
        ))
    }

    pub(crate) fn thread(reason: std::io::Error) -> Self {
        Self::input(format!(
            "expected to start a thread, found: {reason}; end other programs"
        ))
    }

    /// Prefixes the message with a location.
    pub(crate) fn at(self, place: &str) -> Self {
        Self {
            message: format!("{place}: {}", self.message),
            ..self
        }
    }

    pub(crate) fn status(&self) -> Status {
        self.status
    }
}

impl Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.message)
    }
}

impl From<stillpoint::recordings::RecordingError> for Failure {
    fn from(e: stillpoint::recordings::RecordingError) -> Self {
        Self::input(e)
    }
}

impl From<stillpoint::datasets::DatasetError> for Failure {
    fn from(e: stillpoint::datasets::DatasetError) -> Self {
        Self::input(e)
    }
}
