//! How a command ended, and the one place that maps it to exit codes.

use std::fmt::Display;
use std::path::Path;

/// The end of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Status {
    /// Everything worked.
    Ok,
    /// It ran, but lost track or failed its criteria.
    Failed,
    /// The arguments or the input cannot be used.
    Unusable,
}

impl Status {
    /// What the process exits with.
    pub(crate) fn code(self) -> u8 {
        match self {
            Self::Ok => 0,
            Self::Failed => 1,
            Self::Unusable => 2,
        }
    }
}

/// A command that could not be carried out, with a message that says what was expected, what was found, where, and what to
/// do.
#[derive(Debug)]
pub(crate) struct Failure {
    message: String,
    status: Status,
}

impl Failure {
    /// Usage or input is wrong.
    pub(crate) fn input(message: impl Display) -> Self {
        Self {
            message: message.to_string(),
            status: Status::Unusable,
        }
    }

    /// It ran and failed its criteria.
    pub(crate) fn criteria(message: impl Display) -> Self {
        Self {
            message: message.to_string(),
            status: Status::Failed,
        }
    }

    /// A file or folder that `--out` named could not be written.
    pub(crate) fn write(path: &Path, reason: &std::io::Error) -> Self {
        Self::write_of(path, "--out", reason)
    }

    /// A file or folder that `option` named could not be written.
    pub(crate) fn write_of(path: &Path, option: &str, reason: &std::io::Error) -> Self {
        Self::input(format!(
            "{}: expected to write it, found: {reason}; check the folder's permissions and the free space, or name another with {option}",
            path.display()
        ))
    }

    /// A thread could not be started.
    pub(crate) fn thread(reason: std::io::Error) -> Self {
        Self::input(format!(
            "expected to start a thread, found: {reason}; end other programs"
        ))
    }

    /// The same, with where it was found.
    pub(crate) fn at(self, place: &str) -> Self {
        Self {
            message: format!("{place}: {}", self.message),
            ..self
        }
    }

    /// What the process exits with.
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
