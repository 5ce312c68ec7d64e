//! What has kernels and is not asked for them, for benchmarks only: no part of the interface.

use crate::{ColourImage, GrayImage, Simd, image};

/// [`ColourImage::to_gray`] on an instruction set; `out` has the size of `image`.
pub fn gray(image: &ColourImage, out: &mut GrayImage, simd: Simd) {
    image::luma(image.data(), out.data_mut(), simd);
}
