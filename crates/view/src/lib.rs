//! Draws frames with the system's results: features by verdict, object boxes, moving regions, and the state.
//!
//! Converts plain data ([`Overlay`]) to pixels; it makes no decisions, reads no files, and does not influence the system.
//!
//! ```
//! use stillpoint_imaging::{DepthImage, FrameId, GrayImage, RgbdFrame};
//! use stillpoint_view::{Animation, AnimationOptions, Colour, Mark, Overlay, draw, write_png};
//!
//! let frame = RgbdFrame {
//!     id: FrameId(0),
//!     stamp: 0.0,
//!     depth_stamp: 0.0,
//!     gray: GrayImage::new(640, 480),
//!     colour: None,
//!     depth: DepthImage::from_vec(640, 480, vec![0.0; 640 * 480])?,
//! };
//! let overlay = Overlay {
//!     keypoints: &[(100.0, 80.0, Mark::Static), (320.5, 200.0, Mark::Dynamic(Colour::SEMANTIC))],
//!     badge: Some(("TRACKED", Colour::STATIC)),
//!     caption: "frame 0, 185 inliers",
//!     legend: true,
//!     ..Overlay::default()
//! };
//! let picture = draw(&frame, &overlay);
//! let mut png = Vec::new();
//! write_png(&picture, &mut png)?;
//!
//! let mut animation = Animation::new(Vec::new(), AnimationOptions::default());
//! animation.push(&picture)?;
//! let gif = animation.finish()?;
//! assert!(gif.starts_with(b"GIF89a"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod animation;
mod colour;
mod draw;
mod encode;
mod error;
pub mod film;
pub mod live;
mod overlay;
mod palette;
mod panel;
mod picture;
pub mod report;
mod shapes;
mod speed;
mod text;
mod tinted;
mod verdicts;

pub use animation::{Animation, AnimationOptions};
pub use colour::Colour;
pub use draw::{draw, side_by_side};
pub use encode::{write_jpeg, write_mask, write_png};
pub use error::ViewError;
pub use overlay::{Keypoint, Mark, Overlay, OverlayBox};
pub use picture::Picture;
pub use speed::certain_speed;
pub use verdicts::{Labels, Style, picture};
