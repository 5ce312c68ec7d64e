//! Pictures of what the system saw: features coloured by verdict, boxes of objects, depth segments, the state.
//!
//! Answers: how a frame looks with what was found in it drawn over it. Takes plain data ([`Overlay`]) and gives pixels;
//! decides nothing, reads no files, and nothing that it draws goes back into the system.

mod animation;
mod colour;
mod draw;
mod encode;
mod error;
mod font;
mod overlay;
mod picture;
mod shapes;
mod text;

pub use animation::{Animation, AnimationOptions};
pub use colour::Colour;
pub use draw::{draw, side_by_side};
pub use encode::write_png;
pub use error::ViewError;
pub use overlay::{CellLabels, Keypoint, Mark, Overlay, OverlayBox};
pub use picture::Picture;
