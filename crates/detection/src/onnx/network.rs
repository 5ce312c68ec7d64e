//! A model that is loaded and ready to run.

use super::error::ModelError;
use super::interface::{Dimension, Interface};
use super::runtime::{self, Session};
use super::{container, yolox};
use crate::detector::DetectError;
use stillpoint_imaging::FrameId;

/// The loaded model with what it takes to run it.
pub(super) struct Network {
    session: Box<dyn Session>,
    /// Of the input, px.
    pub(super) width: usize,
    pub(super) height: usize,
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
        let interface = Interface::read(&bytes).map_err(|e| unreadable(e.to_string()))?;
        let refuse = |found: String| ModelError::Interface {
            name: name.to_owned(),
            found,
        };
        let sides = interface.to_string();
        let ([input], [_]) = (&interface.inputs[..], &interface.outputs[..]) else {
            return Err(refuse(sides));
        };
        let fixed = |d: &Dimension| match d {
            Dimension::Fixed(size) => usize::try_from(*size).unwrap_or(0),
            Dimension::Free(_) => 0,
        };
        let shape: Vec<usize> = input.shape.iter().flatten().map(fixed).collect();
        let &[batch, channels, height, width] = &shape[..] else {
            return Err(refuse(sides));
        };
        if (batch, channels) != (1, 3) || !yolox::fits(width, height) {
            return Err(refuse(sides));
        }
        let session = runtime::load(bytes, &input.name, threads, &runtime::Runtime::default())
            .map_err(unreadable)?;
        let mut network = Self {
            session,
            width,
            height,
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
    pub(super) fn run(&mut self, planes: &[f32]) -> Result<Vec<f32>, Failure> {
        let mut outputs = self
            .session
            .run(planes, self.width, self.height)
            .map_err(Failure::Runtime)?;
        let expected = [1, yolox::rows(self.width, self.height), yolox::COLUMNS];
        match &mut outputs[..] {
            [output] if output.shape == expected => Ok(std::mem::take(&mut output.data)),
            other => Err(Failure::Output {
                expected: format!("an output of {expected:?}"),
                found: format!("{:?}", other.iter().map(|t| &t.shape).collect::<Vec<_>>()),
            }),
        }
    }

    /// The runtime with its version.
    pub(super) fn runtime(&self) -> &str {
        self.session.runtime()
    }
}
