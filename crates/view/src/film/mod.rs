//! Animation of a run: on the left the camera image with moving regions, on the right the growing surface with trajectories.
//!
//! Uses the final surface and poses, so that nothing jumps: each part of the surface appears with the first image that saw it.

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
