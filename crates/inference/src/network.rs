//! A model, loaded and ready to run at any input size that its graph allows.

use super::card::CardInput;
use super::error::ModelError;
use super::interface::Interface;
use super::known::{declared_numbers, image_input, image_of};
use super::letterbox::plain;
use super::runtime::{self, Runtime, Session, Tensor};
use super::size::Size;
use super::{container, graph, limits};

/// Number of sizes for which a network is kept ready. Images of a folder often have two, portrait and landscape; each holds all weights.
const KEPT: usize = 2;

pub(super) struct Network {
    model: Vec<u8>,
    interface: Interface,
    input: String,
    /// Name of the input for the size to which the network scales its boxes, if any.
    target: Option<String>,
    /// Declared size of the input, if any.
    pub(super) own: Option<Size>,
    runtime: Runtime,
    threads: usize,
    sessions: Vec<(Size, Box<dyn Session>)>,
}

impl Network {
    /// Reads a model's interface. The first run loads it.
    ///
    /// # Errors
    /// [`ModelError`] for invalid bytes and for models that do not take one image.
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

    /// Prepares it for this size, which may take as long as ten runs.
    ///
    /// # Errors
    /// Error of the runtime, on one line.
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

    pub(super) fn forget(&mut self, size: Size) {
        self.sessions.retain(|(s, _)| *s != size);
    }

    /// Runs it on the three planes of an input of this size.
    ///
    /// # Errors
    /// Error of the runtime, on one line.
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

    /// Runs it on a blank image.
    ///
    /// # Errors
    /// Error of the runtime, on one line.
    pub(super) fn run_plain(
        &mut self,
        card: &CardInput,
        size: Size,
    ) -> Result<Vec<Tensor>, String> {
        self.run(&plain(card, size), size)
    }

    pub(super) fn interface(&self) -> &Interface {
        &self.interface
    }

    pub(super) fn runtime(&self) -> Option<&str> {
        self.sessions.first().map(|(_, session)| session.runtime())
    }
}
