//! What can be wrong with a model, said so that the user can mend it.

use super::card::Head;
use super::heads::expectation;
use super::interface::Interface;

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
    /// The model has inputs and outputs that no head is known to have. The message has several lines.
    #[error(
        "{name}: expected a detector that is known or has a card, found one with\n{found}\n{}",
        advice(name)
    )]
    Interface {
        /// Name of the model.
        name: String,
        /// Its inputs and outputs, one a line.
        found: String,
    },
    /// A card says something else than the model.
    #[error("{name}: {key}: expected {expected}, found {found}; {advice}")]
    Card {
        /// Name of the model.
        name: String,
        /// Key of the card.
        key: &'static str,
        /// What the card asks for.
        expected: String,
        /// What the model has.
        found: String,
        /// What to do.
        advice: &'static str,
    },
    /// The model was loaded but does not run.
    #[error(
        "{name}: expected the model to run on an image of {size} px, found: {reason}; export the model anew or use another one"
    )]
    Run {
        /// Name of the model.
        name: String,
        /// Width and height of the input.
        size: String,
        /// What the runtime said.
        reason: String,
    },
    /// The size of the input that was asked for is none that the model takes.
    #[error(
        "{name}: expected a model that takes {asked} px, found {reason}; use {other}, or export the model for the other size"
    )]
    Size {
        /// Name of the model.
        name: String,
        /// Width and height that were asked for.
        asked: String,
        /// Why not.
        reason: String,
        /// What can be used instead.
        other: String,
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

impl ModelError {
    /// Of a model with these inputs and outputs.
    pub(super) fn interface(name: &str, interface: &Interface) -> Self {
        Self::Interface {
            name: name.to_owned(),
            found: interface.listing(),
        }
    }
}

/// What each head expects, and how to say which one a model has.
fn advice(name: &str) -> String {
    let mut lines = vec!["Heads, each with one input [1, 3, H, W] and".to_owned()];
    lines.extend(Head::ALL.map(|head| format!("  {:<13} {}", head.name(), expectation(head))));
    let card = match name
        .len()
        .checked_sub(5)
        .and_then(|at| name.split_at_checked(at))
    {
        Some((stem, end)) if end.eq_ignore_ascii_case(".onnx") => format!("{stem}.toml"),
        _ => format!("{name}.toml"),
    };
    lines.push(format!(
        "If it has one of them, write a card beside it, {card}, that says how to read it, e.g."
    ));
    lines.extend(
        [
            "  head = \"yolo-grid\"",
            "  classes = [\"person\", \"-\", \"chair\"]",
            "  [input]",
            "  colour = \"rgb\"",
        ]
        .map(str::to_owned),
    );
    lines.join("\n")
}
