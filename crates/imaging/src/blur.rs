//! 7x7 Gaussian smoothing, sigma 2 px, separable and in integers.

use crate::{GrayImage, Simd};

/// The Gaussian of sigma 2 at 0, 1, 2, 3 px, scaled so that the seven taps add up to 128.
pub(crate) const TAPS: [i16; 4] = [28, 24, 17, 9];

/// Smooths images, reusing its buffer. Pixels outside the image repeat the border.
#[derive(Clone, Debug)]
pub struct Blur {
    /// Ring of seven horizontally smoothed rows, values times 128.
    ring: Vec<u16>,
    simd: Simd,
}

impl Blur {
    /// A filter that runs on `simd`.
    #[must_use]
    pub fn new(simd: Simd) -> Self {
        Self {
            ring: Vec::new(),
            simd,
        }
    }

    /// Writes the smoothed `source` to `target`, which gets its size.
    pub fn run(&mut self, source: &GrayImage, target: &mut GrayImage) {
        let (width, height) = (source.width(), source.height());
        target.resize(width, height);
        if width == 0 || height == 0 {
            return;
        }
        self.ring.resize(7 * width, 0);
        let mut next = 0;
        for y in 0..height {
            while next < height.min(y + 4) {
                let slot = next % 7 * width;
                smooth_row(
                    source.row(next),
                    &mut self.ring[slot..slot + width],
                    self.simd,
                );
                next += 1;
            }
            let rows: [&[u16]; 7] = std::array::from_fn(|k| {
                let row = (y + k).saturating_sub(3).min(height - 1);
                let slot = row % 7 * width;
                &self.ring[slot..slot + width]
            });
            smooth_columns(
                &rows,
                &mut target.data_mut()[y * width..(y + 1) * width],
                self.simd,
            );
        }
    }
}

fn smooth_row(source: &[u8], out: &mut [u16], simd: Simd) {
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::smooth_row(source, out);
    }
    let _ = simd;
    smooth_row_span(source, 0..source.len(), out);
}

/// Smooths the pixels of `span` along the row. Values are pixel times 128, at most 32640.
pub(crate) fn smooth_row_span(source: &[u8], span: std::ops::Range<usize>, out: &mut [u16]) {
    let last = source.len() - 1;
    let at = |x: usize| u16::from(source[x.min(last)]);
    for x in span {
        let mut sum = at(x) * TAPS[0] as u16;
        for k in 1..4 {
            sum += (at(x.saturating_sub(k)) + at(x + k)) * TAPS[k] as u16;
        }
        out[x] = sum;
    }
}

fn smooth_columns(rows: &[&[u16]; 7], out: &mut [u8], simd: Simd) {
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::smooth_columns(rows, out);
    }
    let _ = simd;
    smooth_columns_span(rows, 0, out);
}

/// Smooths along the columns from pixel `begin` to the end of the row. Products are cut to 1/128 grey levels, as the vector multiply does.
pub(crate) fn smooth_columns_span(rows: &[&[u16]; 7], begin: usize, out: &mut [u8]) {
    let scaled = |value: u32, tap: i16| (value * (tap as u32) << 9) >> 16;
    for x in begin..out.len() {
        let at = |k: usize| u32::from(rows[k][x]);
        let mut sum = scaled(at(3), TAPS[0]);
        for k in 1..4 {
            sum += scaled(at(3 - k) + at(3 + k), TAPS[k]);
        }
        out[x] = ((sum + 64) >> 7) as u8;
    }
}
