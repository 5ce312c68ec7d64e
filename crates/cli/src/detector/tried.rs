//! Loads models after a trial in a separate process.

use crate::detector::file::{Content, ModelFile};
use crate::detector::network::{Network, Running, load_tried};
use crate::failure::Failure;
use crate::models::trial;

/// Reads, tries and loads a model. `option` named it, for messages.
///
/// # Errors
/// Unreadable files, an invalid card, a model that does not load or run, a missing runtime.
pub(crate) fn open(model: &ModelFile, how: &Running, option: &str) -> Result<Network, Failure> {
    let content = model
        .read()
        .map_err(|e| Failure::input(format!("{option} {e}")))?;
    load(&model.name, &content, how, option)
}

/// Tries and loads a model that was read; `name` is for messages. See [`open`].
///
/// # Errors
/// An invalid card, a model that does not load or run, a missing runtime.
pub(crate) fn load(
    name: &str,
    content: &Content,
    how: &Running,
    option: &str,
) -> Result<Network, Failure> {
    trial::check(name, content, how, option)?;
    load_tried(name, content, how, option)
}
