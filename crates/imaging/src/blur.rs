//! 7x7 Gaussian smoothing, sigma 2 px, separable and in integers.

use std::ops::Range;

use crate::{GrayImage, Simd};

/// Gaussian of sigma 2 at 0, 1, 2, 3 px, scaled so that the seven taps sum to 128.
pub(crate) const TAPS: [i16; 4] = [28, 24, 17, 9];

/// Smooths images, reusing its buffer. Pixels outside the image replicate the border.
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

    /// Writes the smoothed `source` to `target`, which is resized.
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
    #[cfg(target_arch = "aarch64")]
    if simd.has_neon() {
        return crate::neon::smooth_row(source, out);
    }
    let _ = simd;
    smooth_row_span(source, 0..source.len(), out);
}

/// Smooths the pixels of `span` along the row. Output is pixel times 128, at most 32640.
pub(crate) fn smooth_row_span(source: &[u8], span: Range<usize>, out: &mut [u16]) {
    let inner = span.start.max(3)..span.end.min(source.len().saturating_sub(3));
    if inner.is_empty() {
        return smooth_row_border(source, span, out);
    }
    smooth_row_border(source, span.start..inner.start, out);
    smooth_row_border(source, inner.end..span.end, out);
    // Slices of equal length remove bounds checks, so that the loop is vectorised.
    let shifted: [&[u8]; 7] =
        std::array::from_fn(|k| &source[inner.start + k - 3..][..inner.len()]);
    for (i, value) in out[inner.clone()].iter_mut().enumerate() {
        let pair = |k: usize| u16::from(shifted[3 - k][i]) + u16::from(shifted[3 + k][i]);
        *value = u16::from(shifted[3][i]) * TAPS[0] as u16
            + pair(1) * TAPS[1] as u16
            + pair(2) * TAPS[2] as u16
            + pair(3) * TAPS[3] as u16;
    }
}

/// Likewise, with replicated borders.
fn smooth_row_border(source: &[u8], span: Range<usize>, out: &mut [u16]) {
    let last = source.len() - 1;
    let at = |x: usize| u16::from(source[x.min(last)]);
    for x in span {
        let pair = |k: usize| at(x.saturating_sub(k)) + at(x + k);
        out[x] = at(x) * TAPS[0] as u16
            + pair(1) * TAPS[1] as u16
            + pair(2) * TAPS[2] as u16
            + pair(3) * TAPS[3] as u16;
    }
}

fn smooth_columns(rows: &[&[u16]; 7], out: &mut [u8], simd: Simd) {
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::smooth_columns(rows, out);
    }
    #[cfg(target_arch = "aarch64")]
    if simd.has_neon() {
        return crate::neon::smooth_columns(rows, out);
    }
    let _ = simd;
    smooth_columns_scalar(rows, out);
}

/// Smooths along the columns. Products are truncated to 1/128 grey levels, like those of the vector multiply.
pub(crate) fn smooth_columns_scalar(rows: &[&[u16]; 7], out: &mut [u8]) {
    let scaled = |value: u16, tap: i16| ((u32::from(value) * ((tap as u32) << 9)) >> 16) as u16;
    let rows = rows.map(|row| &row[..out.len()]);
    for (i, value) in out.iter_mut().enumerate() {
        // At most 2 x 32640, which fits.
        let pair = |k: usize| rows[3 - k][i] + rows[3 + k][i];
        let sum = scaled(rows[3][i], TAPS[0])
            + scaled(pair(1), TAPS[1])
            + scaled(pair(2), TAPS[2])
            + scaled(pair(3), TAPS[3]);
        *value = ((sum + 64) >> 7) as u8;
    }
}
