//! Errors of checkpoints, and their messages.

/// Error: a checkpoint cannot be imported.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// Not a checkpoint.
    #[error(
        "expected a checkpoint as PyTorch 1.6 or newer saves it (a zip archive with a data.pkl), found {found}; {advice}"
    )]
    NoCheckpoint {
        /// Apparent format.
        found: String,
        /// Remedy.
        advice: &'static str,
    },
    /// The archive is damaged, or not written by PyTorch.
    #[error(
        "byte {at} of the file: expected {expected}, found {found}; the file is damaged or was packed by something else than torch.save: get it again"
    )]
    Archive {
        /// Offset in the file.
        at: u64,
        /// Expectation.
        expected: &'static str,
        /// Finding.
        found: String,
    },
    /// The pickle is damaged, or uses features that torch.save does not write.
    #[error(
        "byte {at} of data.pkl: expected {expected}, found {found}; the file is damaged or was not made by torch.save: get it again"
    )]
    Pickle {
        /// Offset in the pickle.
        at: usize,
        /// Expectation.
        expected: &'static str,
        /// Finding.
        found: String,
    },
    /// The pickle names a class or function that no known checkpoint needs. It was not called.
    #[error(
        "byte {at} of data.pkl: expected only tensors and layers of PyTorch and YOLOv7, found `{class}`; nothing was executed. If you do not trust the file, delete it; else save the checkpoint again without this object"
    )]
    Refused {
        /// Offset in the pickle.
        at: usize,
        /// Its full name.
        class: String,
    },
    /// The file exceeds a limit that is ample for any checkpoint.
    #[error(
        "{place}: expected at most {limit} {what}, found more; no checkpoint of a known kind needs as many, so the file is damaged or malicious: get it again"
    )]
    Limit {
        /// Place of the excess.
        place: String,
        /// Kind of the items.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
    /// A tensor contradicts its stored data.
    #[error(
        "{path}: expected {expected}, found {found}; the file is damaged, or not a checkpoint of a detector: get it again"
    )]
    Tensor {
        /// Its path in the module.
        path: String,
        /// Expectation.
        expected: String,
        /// Finding.
        found: String,
    },
    /// A module differs from its class.
    #[error(
        "{path}: expected {expected}, found {found}; import knows official YOLOv7-tiny checkpoints and networks of the same kinds of layers: export others to ONNX with the project that trained them"
    )]
    Module {
        /// Its path.
        path: String,
        /// Expectation.
        expected: String,
        /// Finding.
        found: String,
    },
    /// The network has unknown kinds of layers.
    #[error(
        "expected layers of the kinds {}, found also {}; export this network to ONNX with the project that trained it", super::kinds::KNOWN, kinds.join(", ")
    )]
    Layers {
        /// Their classes, each once.
        kinds: Vec<String>,
    },
    /// The checkpoint's boxes and classes are not usable for a detector.
    #[error(
        "expected a network whose boxes and classes a detector can use, found:\n{}\nexport this network to ONNX with the project that trained it, and write a model card for it", problems.join("\n")
    )]
    Card {
        /// All problems, in terms of the model card.
        problems: Vec<String>,
    },
}

pub(super) type Result<T> = std::result::Result<T, ImportError>;

/// Text of unknown origin for a message: shortened, and without control characters.
pub(super) fn shown(text: &str) -> String {
    const LONGEST: usize = 80;
    let mut shown: String = text
        .chars()
        .take(LONGEST)
        .flat_map(char::escape_debug)
        .collect();
    if text.chars().nth(LONGEST).is_some() {
        shown.push_str("...");
    }
    shown
}
