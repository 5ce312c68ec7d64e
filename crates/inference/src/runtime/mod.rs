//! Runtimes of networks. A runtime takes a model's bytes and the planes of an image, and returns the output values; the heads interpret
//! them.

#[cfg(feature = "onnxruntime")]
mod onnxruntime;
mod rten;
#[cfg(test)]
mod tests;

pub use rten::is_expected;

#[cfg(feature = "onnxruntime")]
pub use onnxruntime::{OnnxRuntime, RuntimeError};

/// Selects the runtime.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Runtime {
    /// `rten`: pure Rust, always available.
    #[default]
    Rten,
    /// ONNX Runtime: two to three times as fast, if its shared library is installed.
    #[cfg(feature = "onnxruntime")]
    OnnxRuntime(OnnxRuntime),
}

/// An array of values; `shape`'s last dimension runs fastest.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Tensor {
    /// Name of the output in the graph; empty until the network sets it.
    pub(super) name: String,
    pub(super) shape: Vec<usize>,
    pub(super) data: Vec<f32>,
}

/// A loaded model that is ready to run.
pub(super) trait Session: Send {
    /// All outputs in the model's order for an input of 1 x 3 x `height` x `width` values; integer outputs as floats.
    ///
    /// # Errors
    /// Error of the runtime, on one line.
    fn run(&mut self, planes: &[f32], width: usize, height: usize) -> Result<Vec<Tensor>, String>;

    /// The runtime with its version, e.g. `rten 0.27.0`.
    fn runtime(&self) -> &str;
}

/// Loads a model with the image input `input`, for this many threads.
///
/// # Errors
/// Error of the runtime, on one line.
pub(super) fn load(
    bytes: Vec<u8>,
    input: &str,
    threads: usize,
    runtime: &Runtime,
) -> Result<Box<dyn Session>, String> {
    Ok(match runtime {
        Runtime::Rten => Box::new(rten::RtenSession::load(bytes, input, threads)?),
        #[cfg(feature = "onnxruntime")]
        Runtime::OnnxRuntime(library) => Box::new(onnxruntime::OnnxRuntimeSession::load(
            &bytes, input, threads, library,
        )?),
    })
}

fn one_line(reason: &dyn std::fmt::Display) -> String {
    reason
        .to_string()
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}
