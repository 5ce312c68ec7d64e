//! A model that is loaded and ready to run, at any input size that its graph allows.

use super::card::CardInput;
use super::error::ModelError;
use super::interface::Interface;
use super::known::{declared_numbers, image_input, image_of};
use super::letterbox::plain;
use super::runtime::{self, Runtime, Session, Tensor};
use super::size::Size;
use super::{container, graph, limits};

/// Sizes at which a network is kept ready. Pictures of a folder often have two, upright and lying; each holds all weights.
const KEPT: usize = 2;

/// The model's file with what it takes to run it.
pub(super) struct Network {
    model: Vec<u8>,
    interface: Interface,
    /// Name of the input that takes the image.
    input: String,
    /// Name of the input that takes the size to which the network brings its boxes, if it has one.
    target: Option<String>,
    /// Of the input, if the file says it.
    pub(super) own: Option<Size>,
    runtime: Runtime,
    threads: usize,
    /// The last used one first.
    sessions: Vec<(Size, Box<dyn Session>)>,
}

impl Network {
    /// Reads what a model takes. It is loaded by the first run.
    ///
    /// # Errors
    /// [`ModelError`] for bytes that are no model and for models that do not take one image.
    pub(super) fn open(
        model: Vec<u8>,
        name: &str,
        threads: usize,
        runtime: &Runtime,
    ) -> Result<Self, ModelError> {
        let unreadable = |reason: String| ModelError::Load {
            name: name.to_owned(),
            reason,
        };
        container::check(&model).map_err(unreadable)?;
        limits::check(&model).map_err(unreadable)?;
        let interface = Interface::read(&model).map_err(|e| unreadable(e.to_string()))?;
        let image = image_input(&interface).and_then(|(image, target)| {
            let names = [Some(image), target].map(|p| p.map(|p| p.name.clone()));
            Some((names, image_of(image)?))
        });
        let Some(([Some(input), target], own)) = image else {
            return Err(ModelError::interface(name, &interface, false));
        };
        if declared_numbers(&interface).is_none() {
            let reason = "outputs of over 67 million numbers, as no detector has them";
            return Err(unreadable(reason.to_owned()));
        }
        Ok(Self {
            model,
            interface,
            input,
            target,
            own,
            runtime: runtime.clone(),
            threads,
            sessions: Vec::new(),
        })
    }

    /// Makes it ready to run at this size, which may take as long as ten runs.
    ///
    /// # Errors
    /// What the runtime said, on one line.
    pub(super) fn prepare(&mut self, size: Size) -> Result<(), String> {
        if let Some(place) = self.sessions.iter().position(|(s, _)| *s == size) {
            self.sessions[..=place].rotate_right(1);
            return Ok(());
        }
        let target = self.target.as_deref();
        let model = graph::resized(&self.model, &self.input, target, self.own, size)
            .map_err(|e| e.to_string())?;
        let session = runtime::load(model, &self.input, self.threads, &self.runtime)?;
        self.sessions.insert(0, (size, session));
        self.sessions.truncate(KEPT);
        Ok(())
    }

    /// Gives up being ready at this size.
    pub(super) fn forget(&mut self, size: Size) {
        self.sessions.retain(|(s, _)| *s != size);
    }

    /// Runs it on the three planes of an input of this size.
    ///
    /// # Errors
    /// What the runtime said, on one line.
    pub(super) fn run(&mut self, planes: &[f32], size: Size) -> Result<Vec<Tensor>, String> {
        self.prepare(size)?;
        let Some((_, session)) = self.sessions.first_mut() else {
            return Err("no session".to_owned());
        };
        let mut outputs = session.run(planes, size.width, size.height)?;
        for (output, port) in outputs.iter_mut().zip(&self.interface.outputs) {
            output.name.clone_from(&port.name);
        }
        Ok(outputs)
    }

    /// Runs it on an image without anything in it.
    ///
    /// # Errors
    /// What the runtime said, on one line.
    pub(super) fn run_plain(
        &mut self,
        card: &CardInput,
        size: Size,
    ) -> Result<Vec<Tensor>, String> {
        self.run(&plain(card, size), size)
    }

    /// What it takes and gives, as its file says.
    pub(super) fn interface(&self) -> &Interface {
        &self.interface
    }

    /// The runtime with its version.
    pub(super) fn runtime(&self) -> Option<&str> {
        self.sessions.first().map(|(_, session)| session.runtime())
    }
}
