//! Why a library cannot be used, said so that the user can correct it.

use super::library::OLDEST;
use std::path::PathBuf;

/// What to do without a usable library.
const ADVICE: &str = "name another file, install one with `pip install onnxruntime`, or use the runtime `rten`, which needs none";

/// A shared library of ONNX Runtime cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RuntimeError {
    /// There is no such file.
    #[error(
        "{}: expected the shared library of ONNX Runtime, found no file that can be read; {ADVICE}", .library.display()
    )]
    Missing {
        /// The file.
        library: PathBuf,
    },
    /// The system cannot load the file: damaged, for another kind of machine, or without a library that it needs.
    #[error(
        "{}: expected the shared library of ONNX Runtime for this machine, found: {reason}; {ADVICE}", .library.display()
    )]
    Unloadable {
        /// The file.
        library: PathBuf,
        /// What the system said.
        reason: String,
    },
    /// A library, but not this one.
    #[error(
        "{}: expected the shared library of ONNX Runtime, found another library: {reason}; {ADVICE}", .library.display()
    )]
    Foreign {
        /// The file.
        library: PathBuf,
        /// What it lacks.
        reason: String,
    },
    /// A version whose interface is older than what is needed.
    #[error(
        "{}: expected ONNX Runtime {OLDEST} or newer, found {version}; {ADVICE}", .library.display()
    )]
    Old {
        /// The file.
        library: PathBuf,
        /// As the library says.
        version: String,
    },
    /// The process has loaded another one, and holds only one.
    #[error(
        "{}: expected one ONNX Runtime per process, found {} loaded already; use that one, or start the program again",
        .library.display(), .loaded.as_deref().map_or("one of other code".into(), |l| l.display().to_string())
    )]
    Taken {
        /// The file.
        library: PathBuf,
        /// The one that is loaded; `None` if code that is not this crate's loaded it.
        loaded: Option<PathBuf>,
    },
}
