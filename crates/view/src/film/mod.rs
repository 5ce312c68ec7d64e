//! A run as a moving picture: on the left the view with what moves in it, on the right the surface that grows, with trajectories.
//!
//! Answers: how a run looks, picture by picture. Takes what is known at its end (surface, final poses), so that nothing jumps while it
//! grows: each part of the surface appears with the first picture that saw it.

mod camera;
mod compose;
mod legend;
mod movie;
mod seen;
mod solid;
mod view;

pub use compose::{Film, Plot, Stand, Track};
pub use movie::{MovieOptions, write_gif, write_webp};
pub use seen::{Look, first_seen};
pub use solid::Surface;
pub use view::view;
