//! Pictures of what the system saw: features coloured by verdict, boxes of objects, depth segments, the state.
//!
//! Answers: how a frame looks with what was found in it drawn over it. Takes plain data ([`Overlay`]) and gives pixels;
//! decides nothing, reads no files, and nothing that it draws goes back into the system.

mod colour;
mod overlay;

pub use colour::Colour;
pub use overlay::{CellLabels, Keypoint, Mark, Overlay, OverlayBox};
