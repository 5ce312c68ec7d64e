//! Errors of models, and their messages.

use super::card::Head;
use super::heads::expectation;
use super::interface::Interface;

/// Error: a model cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// Not a model, or one with operators that the runtime lacks.
    #[error(
        "{name}: expected an ONNX model that the runtime can load, found: {reason}; check the file, or export the model again"
    )]
    Load {
        /// Name of the model.
        name: String,
        /// Error of the runtime.
        reason: String,
    },
    /// Inputs and outputs match no known head. The message has several lines.
    #[error(
        "{name}: expected a detector that is known or has a card, found one with\n{found}\n{}",
        advice(name, *raw_maps)
    )]
    Interface {
        /// Name of the model.
        name: String,
        /// Its inputs and outputs, one per line.
        found: String,
        /// Whether the outputs are those of `yolo-anchors`, whose anchors must come from a card.
        raw_maps: bool,
    },
    /// A card, given or built in, contradicts the model.
    #[error("{name}: {key}: expected {expected}, found {found}; {advice}")]
    Card {
        /// Name of the model.
        name: String,
        /// Key of the card.
        key: &'static str,
        /// Value required by the card.
        expected: String,
        /// Value of the model.
        found: String,
        /// Remedy.
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
        /// Error of the runtime.
        reason: String,
    },
    /// The model does not take the requested input size.
    #[error(
        "{name}: expected a model that takes {asked} px, found {reason}; use {other}, or export the model for the other size"
    )]
    Size {
        /// Name of the model.
        name: String,
        /// Requested width and height.
        asked: String,
        /// Reason.
        reason: String,
        /// Usable alternative.
        other: String,
    },
    /// An option is out of its range.
    #[error("{option}: expected {expected}, found {found}; choose a value in this range")]
    Option {
        /// Its name.
        option: &'static str,
        /// Its range.
        expected: &'static str,
        /// Its value.
        found: String,
    },
}

impl ModelError {
    pub(super) fn interface(name: &str, interface: &Interface, raw_maps: bool) -> Self {
        Self::Interface {
            name: name.to_owned(),
            found: interface.listing(),
            raw_maps,
        }
    }
}

/// The expectations of each head, and how to state a model's head.
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
/// As in the training code of these models.
const ANCHORS: &str = "  head = \"yolo-anchors\"
  [output]
  anchors = the line of these two that is the model's, or its own:
YOLOv7:
  anchors = [[12, 16, 19, 36, 40, 28], [36, 75, 76, 55, 72, 146], [142, 110, 192, 243, 459, 401]]
YOLOv5 and YOLOv7-tiny:
  anchors = [[10, 13, 16, 30, 33, 23], [30, 61, 62, 45, 59, 119], [116, 90, 156, 198, 373, 326]]";

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
