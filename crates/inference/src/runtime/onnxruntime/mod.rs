//! ONNX Runtime: its shared library is loaded at run time, so that nothing of it is needed to build or to start.
//!
//! Answers: where a library may be, whether a file is one that can be used, and runs networks on it.

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

/// The library of this process.
static LOADED: OnceLock<OnnxRuntime> = OnceLock::new();

/// The shared library of ONNX Runtime, loaded and found to be usable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OnnxRuntime {
    library: PathBuf,
    version: String,
}

impl OnnxRuntime {
    /// Oldest version that can be used.
    pub const OLDEST: &'static str = library::OLDEST;

    /// Libraries of ONNX Runtime on this machine, the one to try first in front: what `ORT_DYLIB_PATH` names (a file, which
    /// need not be there, or a folder); beside the executable; in the Python of `VIRTUAL_ENV`, of `CONDA_PREFIX` and in those on
    /// `PATH`; in the user's own Python packages; in the system's folders for libraries. Within a folder the newest version comes
    /// first. A file that several names lead to comes once. The same folders give the same list.
    ///
    /// `environment` gives the value of a variable, e.g. `&|name| std::env::var_os(name)`.
    #[must_use]
    pub fn candidates(environment: &dyn Fn(&str) -> Option<OsString>) -> Vec<PathBuf> {
        candidates::candidates(environment)
    }

    /// Loads a library by its file, e.g. `libonnxruntime.so.1.31.1`. The code in it runs in this process: load none that you
    /// do not trust.
    ///
    /// A process has room for one library, and keeps it until it ends. Once one is loaded, the same file gives it again, and
    /// another one is refused. A file that is refused for another reason leaves the room to the next.
    ///
    /// # Errors
    /// [`RuntimeError`] if there is no such file, it is no library of ONNX Runtime for this kind of machine or is too old,
    /// or another one is loaded already.
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
        // Looked at even if another one is loaded: what is wrong with a bad file is worth more than that it comes too late.
        let found = library::check(&library)?;
        // Threads may come here at once: `ort` takes the first library that it is given.
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

    /// As the library says, e.g. `1.31.1`.
    pub fn version(&self) -> &str {
        &self.version
    }

    /// Its file, links resolved.
    pub fn library(&self) -> &Path {
        &self.library
    }
}
