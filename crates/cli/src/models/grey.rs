//! An image that models are tried with.

use crate::failure::Failure;
use stillpoint::imaging::ColourImage;

/// The image that is looked at, px: the size of most depth cameras' images.
pub(crate) const SIZE: (usize, usize) = (640, 480);

/// An image without anything in it.
pub(crate) fn grey() -> Result<ColourImage, Failure> {
    let (width, height) = SIZE;
    ColourImage::from_vec(width, height, vec![114; 3 * width * height]).map_err(Failure::input)
}
