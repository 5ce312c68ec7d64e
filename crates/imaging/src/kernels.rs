//! Internal kernels exposed for benchmarks only; not part of the interface.

use crate::{ColourImage, GrayImage, Simd, image};

/// [`ColourImage::to_gray`] with a given instruction set; `out` must have the size of `image`.
pub fn gray(image: &ColourImage, out: &mut GrayImage, simd: Simd) {
    image::luma(image.data(), out.data_mut(), simd);
}
