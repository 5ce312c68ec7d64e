//! What can be wrong with a model, said so that the user can correct it.

use super::card::Head;
use super::heads::expectation;
use super::interface::Interface;

/// A model cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The bytes are no model, or one with operators that the runtime does not have.
    #[error(
        "{name}: expected an ONNX model that the runtime can load, found: {reason}; check the file, or export the model again"
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
        advice(name, *raw_maps)
    )]
    Interface {
        /// Name of the model.
        name: String,
        /// Its inputs and outputs, one a line.
        found: String,
        /// Whether the outputs are those of `yolo-anchors`, whose anchors only a card says.
        raw_maps: bool,
    },
    /// A card, given or built in, says something else than the model.
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
        "{name}: expected the model to run on an image of {size} px, found: {reason}; export the model again or use another one"
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
    pub(super) fn interface(name: &str, interface: &Interface, raw_maps: bool) -> Self {
        Self::Interface {
            name: name.to_owned(),
            found: interface.listing(),
            raw_maps,
        }
    }
}

/// What each head expects, and how to say which one a model has.
fn advice(name: &str, raw_maps: bool) -> String {
    let card = card_name(name);
    if raw_maps {
        return format!("{RAW_MAPS}\n{card}\n{ANCHORS}");
    }
    let mut lines = vec!["Heads, each with one input [1, 3, H, W] and".to_owned()];
    lines.extend(Head::ALL.map(|head| format!("  {:<13} {}", head.name(), expectation(head))));
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

const RAW_MAPS: &str = "These are raw maps (yolo-anchors). Boxes are relative to the model's anchors, which its outputs do not say and which must
be given in a card beside it:";
/// As the training code of these models has them.
const ANCHORS: &str = "  head = \"yolo-anchors\"
  [output]
  anchors = the line of these two that is the model's, or its own:
YOLOv7:
  anchors = [[12, 16, 19, 36, 40, 28], [36, 75, 76, 55, 72, 146], [142, 110, 192, 243, 459, 401]]
YOLOv5 and YOLOv7-tiny:
  anchors = [[10, 13, 16, 30, 33, 23], [30, 61, 62, 45, 59, 119], [116, 90, 156, 198, 373, 326]]";

/// Where the card of a model lies.
fn card_name(name: &str) -> String {
    match name
        .len()
        .checked_sub(5)
        .and_then(|at| name.split_at_checked(at))
    {
        Some((stem, end)) if end.eq_ignore_ascii_case(".onnx") => format!("{stem}.toml"),
        _ => format!("{name}.toml"),
    }
}
