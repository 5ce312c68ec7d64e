//! Bilinear down-scaling in fixed-point integers.
//!
//! Pixel centres are at integers and images are aligned at their upper left *corner*, i.e. at (-0.5, -0.5): target pixel x samples the source at
//! `(x + 0.5) factor - 0.5`, clamped to the image.

use crate::{GrayImage, Simd};

/// Where the target pixels of one axis sample the source: between `left` and `left + 1`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Axis {
    /// Index of the pixel before the sample; at most source length - 2 where the source has two pixels.
    pub(crate) left: Vec<u32>,
    /// Fraction towards the next pixel in 1/128, 1..=127. Both weights then fit a signed byte; the error is at most 1/128 px.
    pub(crate) fraction: Vec<u8>,
    /// For each group of eight targets: whether a load of 16 source bytes at the first `left` holds all pixels that they need and is inside the row.
    pub(crate) group_fits: Vec<bool>,
    /// For each group of eight targets: byte indices of the 8 x (left, right) pairs, relative to the first `left`.
    pub(crate) group_shuffle: Vec<[u8; 16]>,
    /// For each group of eight targets: the weights of the pairs.
    pub(crate) group_weights: Vec<[i8; 16]>,
}

impl Axis {
    pub(crate) fn new(source: usize, target: usize, factor: f64) -> Self {
        let mut axis = Axis::default();
        let last = source.saturating_sub(2) as f64;
        for i in 0..target {
            let position = (i as f64 + 0.5) * factor - 0.5;
            let left = position.floor().clamp(0.0, last);
            let fraction = ((position - left) * 128.0).round().clamp(1.0, 127.0);
            axis.left.push(left as u32);
            axis.fraction.push(fraction as u8);
        }
        for start in (0..target / 8 * 8).step_by(8) {
            let first = axis.left[start];
            let span = axis.left[start + 7] + 1 - first;
            axis.group_fits
                .push(span < 16 && first as usize + 16 <= source);
            let (mut shuffle, mut weights) = ([0; 16], [0; 16]);
            for k in 0..8 {
                let offset = (axis.left[start + k] - first).min(14) as u8;
                shuffle[2 * k] = offset;
                shuffle[2 * k + 1] = offset + 1;
                weights[2 * k] = (128 - i16::from(axis.fraction[start + k])) as i8;
                weights[2 * k + 1] = axis.fraction[start + k] as i8;
            }
            axis.group_shuffle.push(shuffle);
            axis.group_weights.push(weights);
        }
        axis
    }
}

/// A resampler between two fixed sizes, with its buffers.
#[derive(Clone, Debug)]
pub(crate) struct Resizer {
    source: (usize, usize),
    target: (usize, usize),
    columns: Axis,
    rows: Axis,
    /// Two horizontally resampled source rows, pixel value times 128.
    lines: [Vec<i16>; 2],
    simd: Simd,
}

impl Resizer {
    pub(crate) fn new(
        source: (usize, usize),
        target: (usize, usize),
        factor: f64,
        simd: Simd,
    ) -> Self {
        Self {
            source,
            target,
            columns: Axis::new(source.0, target.0, factor),
            rows: Axis::new(source.1, target.1, factor),
            lines: [vec![0; target.0], vec![0; target.0]],
            simd,
        }
    }

    /// Resamples `source`, which must have the size given to `new`, into `target`, which gets the other.
    pub(crate) fn run(&mut self, source: &GrayImage, target: &mut GrayImage) {
        debug_assert_eq!((source.width(), source.height()), self.source);
        let (width, height) = self.target;
        target.resize(width, height);
        if self.source.0 == 0 || self.source.1 == 0 || width == 0 {
            target.data_mut().fill(0);
            return;
        }
        // Source row held by each line; a row is resampled once even when two target rows use it.
        let mut held = [usize::MAX; 2];
        for y in 0..height {
            let top = self.rows.left[y] as usize;
            let bottom = (top + 1).min(self.source.1 - 1);
            if held[0] != top {
                if held[1] == top {
                    self.lines.swap(0, 1);
                    held.swap(0, 1);
                } else {
                    resample_row(
                        source.row(top),
                        &self.columns,
                        &mut self.lines[0],
                        self.simd,
                    );
                    held[0] = top;
                }
            }
            if held[1] != bottom {
                resample_row(
                    source.row(bottom),
                    &self.columns,
                    &mut self.lines[1],
                    self.simd,
                );
                held[1] = bottom;
            }
            let fraction = i16::from(self.rows.fraction[y]);
            let out = &mut target.data_mut()[y * width..(y + 1) * width];
            blend_rows(&self.lines[0], &self.lines[1], fraction, out, self.simd);
        }
    }
}

fn resample_row(source: &[u8], columns: &Axis, out: &mut [i16], simd: Simd) {
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::resample_row(source, columns, out);
    }
    let _ = simd;
    resample_span(source, columns, 0, out);
}

/// Resamples the targets from `begin` to the end of the row.
pub(crate) fn resample_span(source: &[u8], columns: &Axis, begin: usize, out: &mut [i16]) {
    let last = source.len() - 1;
    for x in begin..out.len() {
        let left = columns.left[x] as usize;
        let (a, b) = (source[left], source[(left + 1).min(last)]);
        let fraction = i16::from(columns.fraction[x]);
        out[x] = i16::from(a) * (128 - fraction) + i16::from(b) * fraction;
    }
}

fn blend_rows(top: &[i16], bottom: &[i16], fraction: i16, out: &mut [u8], simd: Simd) {
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::blend_rows(top, bottom, fraction, out);
    }
    let _ = simd;
    blend_span(top, bottom, fraction, 0, out);
}

/// Blends the pixels from `begin` to the end of the row.
pub(crate) fn blend_span(top: &[i16], bottom: &[i16], fraction: i16, begin: usize, out: &mut [u8]) {
    let fraction = i32::from(fraction);
    for x in begin..out.len() {
        let (a, b) = (i32::from(top[x]), i32::from(bottom[x]));
        let value = a + (((b - a) * fraction + 64) >> 7);
        out[x] = ((value + 64) >> 7) as u8;
    }
}
