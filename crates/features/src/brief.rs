//! ORB descriptor: the rotated sampling pattern on the smoothed image.

use stillpoint_imaging::{GrayImage, Simd};

use crate::{Descriptor, pattern::PATTERN};

/// Largest distance in x or y of a rotated sample from its keypoint, px: the pattern's radius is 18.39, of samples 13
/// px aside both ways (Rublee et al. 2011).
pub(crate) const REACH: usize = 18;

#[derive(Clone, Debug)]
pub(crate) struct Brief {
    /// x and y of the first points of all tests, then of the second points, px.
    points_x: [f32; 512],
    points_y: [f32; 512],
    simd: Simd,
}

impl Brief {
    pub(crate) fn new(simd: Simd) -> Self {
        let column = |k: usize| {
            std::array::from_fn(|i| f32::from(PATTERN[i % 256][if i < 256 { k } else { k + 2 }]))
        };
        Self {
            points_x: column(0),
            points_y: column(1),
            simd,
        }
    }

    /// The descriptor at (x, y), at least [`REACH`] px from the border of `smooth`, rotated by (cosine, sine).
    pub(crate) fn describe(
        &self,
        smooth: &GrayImage,
        x: usize,
        y: usize,
        direction: (f32, f32),
    ) -> Descriptor {
        let width = smooth.width();
        assert!(x >= REACH && y >= REACH && x + REACH < width && y + REACH < smooth.height());
        let window = &smooth.data()[(y - REACH) * width + x - REACH..];
        let centre = (REACH * width + REACH) as i32;
        let (xs, ys) = (&self.points_x, &self.points_y);
        #[cfg(target_arch = "x86_64")]
        if self.simd.has_avx2() {
            return crate::avx2::describe(xs, ys, direction, width as i32, (window, centre));
        }
        #[cfg(target_arch = "aarch64")]
        if self.simd.has_neon() {
            return crate::neon::describe(xs, ys, direction, width as i32, (window, centre));
        }
        let _ = self.simd;
        let mut offsets = [0; 512];
        rotate_scalar(xs, ys, direction, width as i32, &mut offsets);
        compare_scalar(window, centre, &offsets)
    }
}

/// Offsets `round(y') stride + round(x')` of the rotated points, halves rounded to even.
pub(crate) fn rotate_scalar(
    xs: &[f32],
    ys: &[f32],
    (cos, sin): (f32, f32),
    stride: i32,
    offsets: &mut [i32],
) {
    for ((offset, &x), &y) in offsets.iter_mut().zip(xs).zip(ys) {
        let column = nearest(x * cos - y * sin);
        let row = nearest(x * sin + y * cos);
        *offset = row * stride + column;
    }
}

/// Rounds a small value to the nearest integer, halves to even. Near 1.5 x 2^23 floats are integers, so the addition
/// rounds; unlike the standard function it needs no call on machines without a rounding instruction.
fn nearest(value: f32) -> i32 {
    /// 1.5 x 2^23, where floats of single precision are whole numbers.
    const WHOLE: f32 = 12_582_912.0;
    (value + WHOLE).to_bits() as i32 - WHOLE.to_bits() as i32
}

/// Compares the samples: the first 256 offsets with the other 256, all relative to `window[centre]`.
pub(crate) fn compare_scalar(window: &[u8], centre: i32, offsets: &[i32]) -> Descriptor {
    let (first, second) = offsets.split_at(256);
    let mut words = [0; 4];
    for ((word, first), second) in words
        .iter_mut()
        .zip(first.chunks_exact(64))
        .zip(second.chunks_exact(64))
    {
        for (i, (&a, &b)) in first.iter().zip(second).enumerate() {
            let darker = window[(centre + a) as usize] < window[(centre + b) as usize];
            *word |= u64::from(darker) << i;
        }
    }
    Descriptor(words)
}
