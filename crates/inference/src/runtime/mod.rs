//! What runs a network. A runtime takes a model's bytes and the planes of an image, and gives the outputs' numbers; what they
//! mean is the heads' business.

#[cfg(feature = "onnxruntime")]
mod onnxruntime;
mod rten;
#[cfg(test)]
mod tests;

pub use rten::is_expected;

#[cfg(feature = "onnxruntime")]
pub use onnxruntime::{OnnxRuntime, RuntimeError};

/// Which runtime runs a network.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Runtime {
    /// `rten`: pure Rust, always there.
    #[default]
    Rten,
    /// ONNX Runtime: two to three times as fast, where its shared library is installed.
    #[cfg(feature = "onnxruntime")]
    OnnxRuntime(OnnxRuntime),
}

/// Numbers in rows, planes and so on: `shape`'s last dimension runs fastest.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Tensor {
    /// Of the output in the graph; empty until the network names it.
    pub(super) name: String,
    pub(super) shape: Vec<usize>,
    pub(super) data: Vec<f32>,
}

/// A loaded model that is ready to run.
pub(super) trait Session: Send {
    /// All outputs in the model's order for an input of 1 x 3 x `height` x `width` numbers; outputs of integers as floats.
    ///
    /// # Errors
    /// What the runtime said, on one line.
    fn run(&mut self, planes: &[f32], width: usize, height: usize) -> Result<Vec<Tensor>, String>;

    /// The runtime with its version, e.g. `rten 0.27.0`.
    fn runtime(&self) -> &str;
}

/// Loads a model whose image goes into `input`, for this many threads.
///
/// # Errors
/// What the runtime said, on one line.
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

/// A reason as part of a one-line message.
fn one_line(reason: &dyn std::fmt::Display) -> String {
    reason
        .to_string()
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}
