//! Images, pyramids and compressed depth.

mod pyramid;
mod rvl;
