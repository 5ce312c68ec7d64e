//! Time of scaling and smoothing a 640x480 image: `cargo bench -p stillpoint-imaging`.

use divan::Bencher;
use stillpoint_imaging::{GrayImage, Pyramid, Simd};

fn main() {
    divan::main();
}

/// Vector instruction set of this target.
const VECTORS: Simd = if cfg!(target_arch = "aarch64") {
    Simd::Neon
} else {
    Simd::Avx2
};

fn noise() -> GrayImage {
    let mut image = GrayImage::new(640, 480);
    let mut state = 1_u32;
    for pixel in image.data_mut() {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *pixel = (state >> 24) as u8;
    }
    image
}

#[divan::bench(args = [Simd::Scalar, VECTORS])]
fn build(bencher: Bencher, simd: Simd) {
    let image = noise();
    let mut pyramid = Pyramid::new(5, 1.45, simd);
    bencher.bench_local(|| pyramid.build(&image));
}

#[divan::bench(args = [Simd::Scalar, VECTORS])]
fn smooth(bencher: Bencher, simd: Simd) {
    let mut pyramid = Pyramid::new(5, 1.45, simd);
    pyramid.build(&noise());
    bencher.bench_local(|| pyramid.smooth_all());
}
