//! Images, pyramids and RGB-D frames.
//!
//! Answers: what a frame is and how its pixels are reached. Does not know files (crate `datasets`) or features.

mod frame;
mod image;

pub use frame::{FrameId, FrameSource, RgbdFrame, SourceError};
pub use image::{ColourImage, DepthImage, GrayImage, SizeError};
