//! What can be wrong with a model, said so that the user can mend it.

/// What the YOLOX head needs.
const EXPECTED: &str = "a YOLOX model: one input of [1, 3, H, W] with H and W fixed multiples of 32 up to 4096, one output of [1, H W (1/64 + 1/256 + 1/1024), 85] with raw boxes";

/// A model cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The bytes are no model, or one with operators that the runtime does not have.
    #[error(
        "{name}: expected an ONNX model that the runtime can load, found: {reason}; check the file, or export the model anew"
    )]
    Load {
        /// Name of the model.
        name: String,
        /// What the runtime said.
        reason: String,
    },
    /// The model does not have the inputs and outputs of the head.
    #[error(
        "{name}: expected {EXPECTED}; found {found}; use a YOLOX model exported without decoding and for a fixed size"
    )]
    Interface {
        /// Name of the model.
        name: String,
        /// Its inputs and outputs, or what else does not fit.
        found: String,
    },
    /// The model was loaded but does not run.
    #[error(
        "{name}: expected the model to run on a grey image, found: {reason}; export the model anew or use another one"
    )]
    Run {
        /// Name of the model.
        name: String,
        /// What the runtime said.
        reason: String,
    },
    /// An option is out of its range.
    #[error("{option}: expected {expected}, found {found}; choose a value in this range")]
    Option {
        /// Which one.
        option: &'static str,
        /// Its range.
        expected: &'static str,
        /// Its value.
        found: String,
    },
}
