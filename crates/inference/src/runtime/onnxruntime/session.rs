//! A model in ONNX Runtime.

use super::super::{Session, Tensor, one_line};
use super::OnnxRuntime;
use ort::logging::LogLevel;
use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};
use ort::value::{TensorElementType, TensorRef, ValueRef};

pub(in super::super) struct OnnxRuntimeSession {
    session: ort::session::Session,
    input: String,
    runtime: String,
}

impl OnnxRuntimeSession {
    /// Loads a model with the image input `input`. `OnnxRuntime` proves that the library is loaded.
    pub(in super::super) fn load(
        bytes: &[u8],
        input: &str,
        threads: usize,
        library: &OnnxRuntime,
    ) -> Result<Self, String> {
        let session = options(threads)
            .and_then(|mut options| options.commit_from_memory(bytes))
            .map_err(|e| one_line(&e))?;
        if !session.inputs().iter().any(|i| i.name() == input) {
            return Err(format!("a model without the input {input}"));
        }
        Ok(Self {
            session,
            input: input.to_owned(),
            runtime: format!("ONNX Runtime {}", library.version()),
        })
    }
}

fn options(threads: usize) -> ort::Result<SessionBuilder> {
    Ok(ort::session::Session::builder()?
        // Errors are returned; the library would print them as well.
        .with_log_level(LogLevel::Fatal)?
        .with_optimization_level(GraphOptimizationLevel::All)?
        .with_intra_threads(threads)?
        .with_inter_threads(1)?
        .with_parallel_execution(false)?
        .with_deterministic_compute(true)?
        // Waiting threads sleep: the other cores belong to tracking and mapping.
        .with_intra_op_spinning(false)?)
}

impl Session for OnnxRuntimeSession {
    fn run(&mut self, planes: &[f32], width: usize, height: usize) -> Result<Vec<Tensor>, String> {
        let input = TensorRef::from_array_view(([1, 3, height, width], planes))
            .map_err(|e| one_line(&e))?;
        let outputs = self
            .session
            .run(ort::inputs![self.input.as_str() => input])
            .map_err(|e| one_line(&e))?;
        outputs.values().map(|value| tensor(&value)).collect()
    }

    fn runtime(&self) -> &str {
        &self.runtime
    }
}

fn tensor(value: &ValueRef<'_>) -> Result<Tensor, String> {
    let refuse = |found: &dyn std::fmt::Display| format!("an output of {}", one_line(found));
    let kind = value.dtype().tensor_type();
    let kind = kind.ok_or_else(|| refuse(value.dtype()))?;
    macro_rules! numbers {
        ($type:ty) => {{
            let (shape, data) = value
                .try_extract_tensor::<$type>()
                .map_err(|e| one_line(&e))?;
            (shape, data.iter().map(|&v| v as f32).collect())
        }};
    }
    let (shape, data) = match kind {
        TensorElementType::Float32 => {
            let (shape, data) = value
                .try_extract_tensor::<f32>()
                .map_err(|e| one_line(&e))?;
            (shape, data.to_vec())
        }
        TensorElementType::Float64 => numbers!(f64),
        TensorElementType::Int32 => numbers!(i32),
        TensorElementType::Int64 => numbers!(i64),
        TensorElementType::Uint8 => numbers!(u8),
        TensorElementType::Int8 => numbers!(i8),
        other => return Err(refuse(&other)),
    };
    let size = |&size: &i64| usize::try_from(size).unwrap_or(0);
    Ok(Tensor {
        name: String::new(),
        shape: shape.iter().map(size).collect(),
        data,
    })
}
