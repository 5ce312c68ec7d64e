//! Errors of the library of ONNX Runtime, and their messages.

use super::library::OLDEST;
use std::path::PathBuf;

const ADVICE: &str = "name another file, install one with `pip install onnxruntime`, or use the runtime `rten`, which needs none";

/// Error: a shared library of ONNX Runtime cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RuntimeError {
    /// The file does not exist.
    #[error(
        "{}: expected the shared library of ONNX Runtime, found no file that can be read; {ADVICE}", .library.display()
    )]
    Missing {
        /// The file.
        library: PathBuf,
    },
    /// The system cannot load the file: damaged, for another architecture, or without a library that it needs.
    #[error(
        "{}: expected the shared library of ONNX Runtime for this machine, found: {reason}; {ADVICE}", .library.display()
    )]
    Unloadable {
        /// The file.
        library: PathBuf,
        /// Error of the system.
        reason: String,
    },
    /// Another library.
    #[error(
        "{}: expected the shared library of ONNX Runtime, found another library: {reason}; {ADVICE}", .library.display()
    )]
    Foreign {
        /// The file.
        library: PathBuf,
        /// Missing symbol.
        reason: String,
    },
    /// A version with an older interface than required.
    #[error(
        "{}: expected ONNX Runtime {OLDEST} or newer, found {version}; {ADVICE}", .library.display()
    )]
    Old {
        /// The file.
        library: PathBuf,
        /// Version reported by the library.
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
        /// The loaded one; `None` if code outside this crate loaded it.
        loaded: Option<PathBuf>,
    },
}
