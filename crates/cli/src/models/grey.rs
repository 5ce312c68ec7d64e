//! The image that models are tried with.

use crate::failure::Failure;
use stillpoint::imaging::ColourImage;

/// Image size, px: that of most depth cameras.
pub(crate) const SIZE: (usize, usize) = (640, 480);

pub(crate) fn grey() -> Result<ColourImage, Failure> {
    let (width, height) = SIZE;
    ColourImage::from_vec(width, height, vec![114; 3 * width * height]).map_err(Failure::input)
}
