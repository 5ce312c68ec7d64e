//! `--runtime`: chooses the runtime of networks.

use crate::args::models::RuntimeChoice;
use crate::failure::Failure;
use std::path::PathBuf;
use stillpoint::inference::{OnnxRuntime, Runtime};

const ADVICE: &str = "get it with `pip install onnxruntime`, or name its file in the environment variable ORT_DYLIB_PATH";
/// Where [`OnnxRuntime::candidates`] looks, in words.
const PLACES: &str = "ORT_DYLIB_PATH, the program's folder, the Python of VIRTUAL_ENV, of CONDA_PREFIX and on PATH, the user's Python packages, and the system's libraries";

#[derive(Debug, Default)]
pub(crate) struct Libraries {
    pub(crate) usable: Option<OnnxRuntime>,
    /// The candidates before it, and why each is unusable.
    pub(crate) refused: Vec<String>,
}

impl Libraries {
    /// Tries the installed libraries in the order of [`OnnxRuntime::candidates`], up to the first usable one.
    pub(crate) fn find() -> Self {
        Self::among(OnnxRuntime::candidates(&|name| std::env::var_os(name)))
    }

    fn among(files: Vec<PathBuf>) -> Self {
        let mut found = Self::default();
        for file in files {
            match OnnxRuntime::load(&file) {
                Ok(library) => {
                    found.usable = Some(library);
                    break;
                }
                Err(e) => found.refused.push(e.to_string()),
            }
        }
        found
    }

    /// Why the first candidate, which the user most likely means, is unusable.
    fn refusal(&self) -> String {
        let first = self.refused.first().cloned().unwrap_or_default();
        match self.refused.len() {
            0 | 1 => first,
            n => format!("{first} ({} more cannot be used either)", n - 1),
        }
    }
}

#[derive(Debug)]
pub(crate) struct Chosen {
    pub(crate) runtime: Runtime,
    /// Why an installed but unusable faster runtime is not used.
    pub(crate) warning: Option<String>,
}

/// Chooses the runtime.
///
/// # Errors
/// `onnxruntime` without a usable library.
pub(crate) fn choose(choice: RuntimeChoice) -> Result<Chosen, Failure> {
    match choice {
        RuntimeChoice::Rten => Ok(rten(None)),
        _ => of_libraries(choice, Libraries::find()),
    }
}

fn rten(warning: Option<String>) -> Chosen {
    Chosen {
        runtime: Runtime::Rten,
        warning,
    }
}

fn of_libraries(choice: RuntimeChoice, found: Libraries) -> Result<Chosen, Failure> {
    let asked = choice == RuntimeChoice::Onnxruntime;
    match (&found.usable, found.refused.is_empty()) {
        (Some(library), clean) => Ok(Chosen {
            runtime: Runtime::OnnxRuntime(library.clone()),
            warning: (!clean).then(|| {
                format!(
                    "ONNX Runtime is run from {}, since another library was found first: {}",
                    library.library().display(),
                    found.refusal()
                )
            }),
        }),
        (None, true) if asked => Err(Failure::input(format!(
            "--runtime onnxruntime: expected the library of ONNX Runtime, found none in {PLACES}; {ADVICE}, or use --runtime rten"
        ))),
        (None, false) if asked => Err(Failure::input(format!(
            "--runtime onnxruntime: {}",
            found.refusal()
        ))),
        (None, true) => Ok(rten(None)),
        (None, false) => Ok(rten(Some(format!(
            "the network is run by rten: {}",
            found.refusal()
        )))),
    }
}

pub(crate) fn library(runtime: &Runtime) -> Option<String> {
    match runtime {
        Runtime::OnnxRuntime(library) => Some(library.library().display().to_string()),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn broken(n: usize) -> Libraries {
        Libraries {
            usable: None,
            refused: (1..=n).map(|k| format!("lib{k}.so: too old")).collect(),
        }
    }

    #[test]
    fn missing_onnxruntime_fails_only_if_requested() {
        let auto = of_libraries(RuntimeChoice::Auto, broken(0)).unwrap();
        assert_eq!((auto.runtime, auto.warning), (Runtime::Rten, None));
        let e = of_libraries(RuntimeChoice::Onnxruntime, broken(0)).unwrap_err();
        for part in ["found none in", "ORT_DYLIB_PATH", "pip install onnxruntime"] {
            assert!(e.to_string().contains(part), "{e}");
        }
    }

    #[test]
    fn broken_libraries_are_reported() {
        let auto = of_libraries(RuntimeChoice::Auto, broken(5)).unwrap();
        assert_eq!(auto.runtime, Runtime::Rten);
        let said = auto.warning.unwrap();
        assert!(said.contains("lib1.so: too old"), "{said}");
        assert!(said.ends_with("(4 more cannot be used either)"), "{said}");
        let e = of_libraries(RuntimeChoice::Onnxruntime, broken(1)).unwrap_err();
        assert!(e.to_string().contains("lib1.so: too old"), "{e}");
    }

    #[test]
    fn non_library_files_are_refused() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let found = Libraries::among(vec![file.path().to_owned()]);
        assert!(found.usable.is_none());
        assert_eq!(found.refused.len(), 1, "{found:?}");
    }
}
