//! What can be wrong with a checkpoint, said so that the user can correct it.

/// A checkpoint cannot be imported.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The bytes are something else.
    #[error(
        "expected a checkpoint as PyTorch 1.6 or newer saves it (a zip archive with a data.pkl), found {found}; {advice}"
    )]
    NoCheckpoint {
        /// What they seem to be.
        found: String,
        /// What to do.
        advice: &'static str,
    },
    /// The archive is damaged, or is none that PyTorch writes.
    #[error(
        "byte {at} of the file: expected {expected}, found {found}; the file is damaged or was packed by something else than torch.save: get it again"
    )]
    Archive {
        /// Where in the file.
        at: u64,
        /// What should be there.
        expected: &'static str,
        /// What is there.
        found: String,
    },
    /// The pickle inside is damaged, or uses what torch.save does not write.
    #[error(
        "byte {at} of data.pkl: expected {expected}, found {found}; the file is damaged or was not made by torch.save: get it again"
    )]
    Pickle {
        /// Where in the pickle.
        at: usize,
        /// What should be there.
        expected: &'static str,
        /// What is there.
        found: String,
    },
    /// The pickle names a class or function that no checkpoint of a known kind needs. It was not called.
    #[error(
        "byte {at} of data.pkl: expected only tensors and layers of PyTorch and YOLOv7, found `{class}`; nothing was executed. If you do not trust the file, delete it; else save the checkpoint again without this object"
    )]
    Refused {
        /// Where in the pickle.
        at: usize,
        /// Its full name.
        class: String,
    },
    /// The file asks for more than any checkpoint needs.
    #[error(
        "{place}: expected at most {limit} {what}, found more; no checkpoint of a known kind needs as many, so the file is damaged or malicious: get it again"
    )]
    Limit {
        /// Where it was noticed.
        place: String,
        /// Of what.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
    /// A tensor does not fit what is stored.
    #[error(
        "{path}: expected {expected}, found {found}; the file is damaged, or not a checkpoint of a detector: get it again"
    )]
    Tensor {
        /// Which one, by its path in the module.
        path: String,
        /// What was expected.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A module is not as its class has it.
    #[error(
        "{path}: expected {expected}, found {found}; import knows official YOLOv7-tiny checkpoints and networks of the same kinds of layers: export others to ONNX with the project that trained them"
    )]
    Module {
        /// Which one, by its path.
        path: String,
        /// What was expected.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The network has kinds of layers that are not known.
    #[error(
        "expected layers of the kinds {}, found also {}; export this network to ONNX with the project that trained it", super::kinds::KNOWN, kinds.join(", ")
    )]
    Layers {
        /// Their classes, each once.
        kinds: Vec<String>,
    },
    /// What the checkpoint says of its boxes and classes makes no sense to a detector.
    #[error(
        "expected a network whose boxes and classes a detector can use, found:\n{}\nexport this network to ONNX with the project that trained it, and write a model card for it", problems.join("\n")
    )]
    Card {
        /// All of it, in terms of the model card.
        problems: Vec<String>,
    },
}

/// Shorthand of the import's steps.
pub(super) type Result<T> = std::result::Result<T, ImportError>;

/// Text of unknown origin for a message: short, and without control characters.
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
