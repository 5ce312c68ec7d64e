//! Models that are tried in a process of their own before this one loads them.

use crate::detector::file::{Content, ModelFile};
use crate::detector::network::{Network, Running, load_tried};
use crate::failure::Failure;
use crate::models::trial;

/// Loads a model. `option` named it, for messages.
///
/// # Errors
/// Files that cannot be read, a card that cannot be used, a model that does not load or run, a runtime that is not there.
pub(crate) fn open(model: &ModelFile, how: &Running, option: &str) -> Result<Network, Failure> {
    let content = model
        .read()
        .map_err(|e| Failure::input(format!("{option} {e}")))?;
    load(&model.name, &content, how, option)
}

/// Loads a model that was read; `name` is what it is called. See [`open`].
///
/// # Errors
/// A card that cannot be used, a model that does not load or run, a runtime that is not there.
pub(crate) fn load(
    name: &str,
    content: &Content,
    how: &Running,
    option: &str,
) -> Result<Network, Failure> {
    trial::check(name, content, how, option)?;
    load_tried(name, content, how, option)
}
