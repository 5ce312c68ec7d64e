//! Bilinear down-scaling in fixed-point integers.
//!
//! Pixel centres are at integers and images are aligned at their upper left *corner*, i.e. at (-0.5, -0.5): target pixel x samples the source at
//! `(x + 0.5) factor - 0.5`, clamped to the image.

use crate::{GrayImage, Simd};

/// Sampling positions of the target pixels along one axis: between `left` and `left + 1`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Axis {
    /// Index of the pixel before the sample; at most source length - 2 if the source has two pixels.
    pub(crate) left: Vec<u32>,
    /// Weight of the next pixel in 1/128, 1..=127. Both weights then fit a signed byte; the error is at most 1/128 px.
    pub(crate) fraction: Vec<u8>,
    /// Groups of eight targets that cover all of them (the last may overlap its predecessor); empty when a group cannot
    /// be built.
    #[cfg_attr(
        not(any(target_arch = "x86_64", target_arch = "aarch64")),
        allow(dead_code)
    )]
    pub(crate) groups: Vec<Group>,
}

/// Computes eight adjacent targets from 16 adjacent source bytes.
// Only used by vector kernels.
#[cfg_attr(
    not(any(target_arch = "x86_64", target_arch = "aarch64")),
    allow(dead_code)
)]
#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub(crate) start: usize,
    pub(crate) base: usize,
    /// Byte indices of the 8 x (left, right) pairs, relative to `base`.
    pub(crate) shuffle: [u8; 16],
    pub(crate) weights: [i8; 16],
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
        if source >= 16 && target >= 8 {
            let groups =
                (0..target.div_ceil(8)).map(|k| axis.group((8 * k).min(target - 8), source));
            axis.groups = groups.collect::<Option<_>>().unwrap_or_default();
        }
        axis
    }

    /// The group of eight targets from `start` on; `None` when they need more than 16 source bytes.
    fn group(&self, start: usize, source: usize) -> Option<Group> {
        let base = (self.left[start] as usize).min(source - 16);
        let (mut shuffle, mut weights) = ([0; 16], [0; 16]);
        for k in 0..8 {
            let offset = self.left[start + k] as usize - base;
            if offset > 14 {
                return None;
            }
            let fraction = self.fraction[start + k] as i8;
            (shuffle[2 * k], shuffle[2 * k + 1]) = (offset as u8, offset as u8 + 1);
            // 1..=127, written so that 128 need not fit.
            (weights[2 * k], weights[2 * k + 1]) = (127 - fraction + 1, fraction);
        }
        Some(Group {
            start,
            base,
            shuffle,
            weights,
        })
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

    /// Resamples `source`, which must have the size given to `new`, into `target`, which is resized.
    pub(crate) fn run(&mut self, source: &GrayImage, target: &mut GrayImage) {
        debug_assert_eq!((source.width(), source.height()), self.source);
        let (width, height) = self.target;
        target.resize(width, height);
        if self.source.0 == 0 || self.source.1 == 0 || width == 0 {
            target.data_mut().fill(0);
            return;
        }
        // Source row held by each line: a row used by two target rows is resampled once.
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
    #[cfg(target_arch = "aarch64")]
    if simd.has_neon() {
        return crate::neon::resample_row(source, columns, out);
    }
    let _ = simd;
    resample_scalar(source, columns, out);
}

/// Resamples a row; values are grey levels times 128.
pub(crate) fn resample_scalar(source: &[u8], columns: &Axis, out: &mut [i16]) {
    let last = source.len() - 1;
    let samples = columns.left.iter().zip(&columns.fraction);
    for (value, (&left, &fraction)) in out.iter_mut().zip(samples) {
        let left = left as usize;
        let (a, b) = (source[left], source[(left + 1).min(last)]);
        let fraction = i16::from(fraction);
        *value = i16::from(a) * (128 - fraction) + i16::from(b) * fraction;
    }
}

fn blend_rows(top: &[i16], bottom: &[i16], fraction: i16, out: &mut [u8], simd: Simd) {
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::blend_rows(top, bottom, fraction, out);
    }
    #[cfg(target_arch = "aarch64")]
    if simd.has_neon() {
        return crate::neon::blend_rows(top, bottom, fraction, out);
    }
    let _ = simd;
    blend_scalar(top, bottom, fraction, out);
}

pub(crate) fn blend_scalar(top: &[i16], bottom: &[i16], fraction: i16, out: &mut [u8]) {
    for ((value, &a), &b) in out.iter_mut().zip(top).zip(bottom) {
        let step = (i32::from(b - a) * i32::from(fraction) + 64) >> 7;
        *value = ((a + step as i16 + 64) >> 7) as u8;
    }
}
