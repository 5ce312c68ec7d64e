//! A model that is loaded and ready to run.

use super::error::ModelError;
use super::{container, yolox};
use crate::detector::DetectError;
use rten::{Dimension, Model, NodeId, RunOptions, ThreadPool, ValueView};
use std::sync::Arc;
use stillpoint_imaging::FrameId;

/// The runtime, as summaries name it; a test holds it against Cargo.lock.
pub(super) const RUNTIME: &str = "rten 0.24.0";

/// The loaded model with what it takes to run it.
pub(super) struct Network {
    model: Model,
    input: NodeId,
    output: NodeId,
    /// Of the input, px.
    pub(super) width: usize,
    pub(super) height: usize,
    pool: Arc<ThreadPool>,
}

/// The network did not answer as it should.
pub(super) enum Failure {
    Runtime(String),
    Output { expected: String, found: String },
}

impl Failure {
    pub(super) fn at(self, frame: FrameId) -> DetectError {
        match self {
            Self::Runtime(reason) => DetectError::Runtime { frame, reason },
            Self::Output { expected, found } => DetectError::Output {
                frame,
                expected,
                found,
            },
        }
    }
}

impl Network {
    /// Loads a model and runs it once, so that one that does not fit is refused.
    pub(super) fn load(bytes: Vec<u8>, name: &str, threads: usize) -> Result<Self, ModelError> {
        let unreadable = |reason: String| ModelError::Load {
            name: name.to_owned(),
            reason,
        };
        container::check(&bytes).map_err(unreadable)?;
        let model = Model::load(bytes).map_err(|e| unreadable(one_line(&e)))?;
        let refuse = |found: String| ModelError::Interface {
            name: name.to_owned(),
            found,
        };
        let sides = interface(&model);
        let (&[input], &[output]) = (model.input_ids(), model.output_ids()) else {
            return Err(refuse(sides));
        };
        let shape = model
            .node_info(input)
            .and_then(|n| n.shape())
            .unwrap_or_default();
        let &[batch, channels, height, width] = &fixed(&shape)[..] else {
            return Err(refuse(sides));
        };
        if (batch, channels) != (1, 3) || !yolox::fits(width, height) {
            return Err(refuse(sides));
        }
        let network = Self {
            model,
            input,
            output,
            width,
            height,
            pool: Arc::new(ThreadPool::with_num_threads(threads)),
        };
        let grey = vec![114.0; 3 * width * height];
        match network.run(&grey) {
            Ok(output) if yolox::is_decoded(&output) => Err(refuse("boxes in pixels".to_owned())),
            Ok(_) => Ok(network),
            Err(Failure::Output { .. }) => Err(refuse(sides)),
            Err(Failure::Runtime(reason)) => Err(ModelError::Run {
                name: name.to_owned(),
                reason,
            }),
        }
    }

    /// Runs the network on planes of 3 x height x width; the output's rows one after another.
    pub(super) fn run(&self, planes: &[f32]) -> Result<Vec<f32>, Failure> {
        let runtime = |e: &dyn std::fmt::Display| Failure::Runtime(one_line(e));
        let input = ValueView::from_shape([1, 3, self.height, self.width].as_slice(), planes)
            .map_err(|e| runtime(&e))?;
        // Its own threads, since the default pool takes all cores.
        let options = RunOptions::default().with_thread_pool(Some(Arc::clone(&self.pool)));
        let [output] = self
            .model
            .run_n(
                vec![(self.input, input.into())],
                [self.output],
                Some(options),
            )
            .map_err(|e| runtime(&e))?;
        let expected = [1, yolox::rows(self.width, self.height), yolox::COLUMNS];
        let wrong = |found: String| Failure::Output {
            expected: format!("an output of {expected:?}"),
            found,
        };
        let (shape, data) = output
            .into_shape_vec::<f32, 3>()
            .map_err(|e| wrong(one_line(&e)))?;
        if shape == expected {
            Ok(data)
        } else {
            Err(wrong(format!("{shape:?}")))
        }
    }
}

/// The sizes of a shape; 0 for those that are not fixed.
fn fixed(shape: &[Dimension]) -> Vec<usize> {
    shape
        .iter()
        .map(|d| match d {
            Dimension::Fixed(size) => *size,
            Dimension::Symbolic(_) => 0,
        })
        .collect()
}

/// A model's inputs and outputs, for a message.
fn interface(model: &Model) -> String {
    let describe = |ids: &[NodeId]| {
        let mut parts = Vec::new();
        for info in ids.iter().filter_map(|&id| model.node_info(id)) {
            let sizes = |d: &Dimension| match d {
                Dimension::Fixed(size) => size.to_string(),
                Dimension::Symbolic(name) => name.clone(),
            };
            let shape = info.shape().map_or("of unknown shape".to_owned(), |s| {
                format!("[{}]", s.iter().map(sizes).collect::<Vec<_>>().join(", "))
            });
            parts.push(format!(
                "{} {shape}",
                info.name().unwrap_or("(without a name)")
            ));
        }
        if parts.is_empty() {
            "none".to_owned()
        } else {
            parts.join(", ")
        }
    };
    format!(
        "inputs: {}; outputs: {}",
        describe(model.input_ids()),
        describe(model.output_ids())
    )
}

/// A reason as part of a one-line message.
fn one_line(reason: &dyn std::fmt::Display) -> String {
    reason
        .to_string()
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}
