//! ONNX Runtime: its shared library is loaded at run time, so neither building nor starting requires it.
//!
//! Answers: possible paths of a library, and whether a file is usable; runs networks on it.

mod candidates;
mod error;
mod library;
mod session;
mod whole;

pub use error::RuntimeError;
pub(super) use session::OnnxRuntimeSession;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

static LOADED: OnceLock<OnnxRuntime> = OnceLock::new();

/// The shared library of ONNX Runtime, loaded and checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OnnxRuntime {
    library: PathBuf,
    version: String,
}

impl OnnxRuntime {
    /// Oldest usable version.
    pub const OLDEST: &'static str = library::OLDEST;

    /// Libraries of ONNX Runtime on this machine, in the order in which to try them: the path in `ORT_DYLIB_PATH` (a file, which need not
    /// exist, or a folder); beside the executable; in the Python of `VIRTUAL_ENV`, of `CONDA_PREFIX` and in those on `PATH`; in the user's
    /// own Python packages; in the system's library folders. Within a folder the newest version comes first. Each file occurs once,
    /// whatever its names. The same folders give the same list.
    ///
    /// `environment` returns the value of a variable, e.g. `&|name| std::env::var_os(name)`.
    #[must_use]
    pub fn candidates(environment: &dyn Fn(&str) -> Option<OsString>) -> Vec<PathBuf> {
        candidates::candidates(environment)
    }

    /// Loads a library by its file, e.g. `libonnxruntime.so.1.31.1`. Its code runs in this process: load only trusted ones.
    ///
    /// A process holds one library until it ends. Loading the same file again returns it, and another one is refused. A file that is
    /// refused for another reason does not block the next.
    ///
    /// # Errors
    /// [`RuntimeError`] if the file does not exist, is not a library of ONNX Runtime for this architecture or is too old, or another one is
    /// loaded already.
    pub fn load(library: &Path) -> Result<Self, RuntimeError> {
        let missing = |_| RuntimeError::Missing {
            library: library.to_owned(),
        };
        // With links resolved, so that one file under two names is one library.
        let library = library.canonicalize().map_err(missing)?;
        let same = |loaded: &Self| (loaded.library == library).then(|| loaded.clone());
        if let Some(loaded) = LOADED.get().and_then(same) {
            return Ok(loaded);
        }
        // Checked even if another one is loaded: the fault of a bad file is more useful than that it comes too late.
        let found = library::check(&library)?;
        // Threads may get here at once: `ort` takes the first library.
        let handed_over = found.hand_over(&library);
        if handed_over.is_ok() {
            LOADED.get_or_init(|| Self {
                library: library.clone(),
                version: found.version().to_owned(),
            });
        }
        match LOADED.get() {
            Some(loaded) => same(loaded).ok_or_else(|| RuntimeError::Taken {
                library: library.clone(),
                loaded: Some(loaded.library.clone()),
            }),
            None => Err(handed_over.err().unwrap_or(RuntimeError::Taken {
                library,
                loaded: None,
            })),
        }
    }

    /// Version reported by the library, e.g. `1.31.1`.
    pub fn version(&self) -> &str {
        &self.version
    }

    /// Its file, links resolved.
    pub fn library(&self) -> &Path {
        &self.library
    }
}
