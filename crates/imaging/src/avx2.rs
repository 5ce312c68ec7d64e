//! AVX2 kernels, each bit-identical to a scalar twin. The only unsafe code of the crate.
#![allow(unsafe_code)]

use std::arch::x86_64::*;

use crate::{
    Simd,
    blur::{TAPS, smooth_columns_scalar, smooth_row_span},
    resize::{Axis, blend_scalar, resample_scalar},
};

/// Guards every entry point, so that no AVX2 instruction runs on a machine without AVX2. The standard library caches
/// the detection.
#[inline]
fn check() {
    assert!(Simd::Avx2.has_avx2(), "AVX2 kernel called without AVX2");
}

#[inline]
#[target_feature(enable = "avx2")]
fn load_u8(slice: &[u8], index: usize) -> __m256i {
    let window = &slice[index..index + 32];
    // SAFETY: the window holds the 32 bytes read; the load needs no alignment.
    unsafe { _mm256_loadu_si256(window.as_ptr().cast()) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn load_half_u8(slice: &[u8], index: usize) -> __m128i {
    let window = &slice[index..index + 16];
    // SAFETY: the window holds the 16 bytes read; the load needs no alignment.
    unsafe { _mm_loadu_si128(window.as_ptr().cast()) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn load_u16(slice: &[u16], index: usize) -> __m256i {
    let window = &slice[index..index + 16];
    // SAFETY: the window holds the 32 bytes read; the load needs no alignment.
    unsafe { _mm256_loadu_si256(window.as_ptr().cast()) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn load_i16(slice: &[i16], index: usize) -> __m256i {
    let window = &slice[index..index + 16];
    // SAFETY: the window holds the 32 bytes read; the load needs no alignment.
    unsafe { _mm256_loadu_si256(window.as_ptr().cast()) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn store_u8(slice: &mut [u8], index: usize, value: __m256i) {
    let window = &mut slice[index..index + 32];
    // SAFETY: the window holds the 32 bytes written; the store needs no alignment.
    unsafe { _mm256_storeu_si256(window.as_mut_ptr().cast(), value) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn store_u16(slice: &mut [u16], index: usize, value: __m256i) {
    let window = &mut slice[index..index + 16];
    // SAFETY: the window holds the 32 bytes written; the store needs no alignment.
    unsafe { _mm256_storeu_si256(window.as_mut_ptr().cast(), value) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn store_half_i16(slice: &mut [i16], index: usize, value: __m128i) {
    let window = &mut slice[index..index + 8];
    // SAFETY: the window holds the 16 bytes written; the store needs no alignment.
    unsafe { _mm_storeu_si128(window.as_mut_ptr().cast(), value) }
}

/// Twin of [`luma_scalar`](crate::image::luma_scalar).
pub(crate) fn luma(rgb: &[u8], out: &mut [u8]) {
    check();
    // SAFETY: `check` has seen that the machine has AVX2.
    unsafe { luma_kernel(rgb, out) }
}

/// Pixels of a block of [`luma_kernel`].
const LUMA: usize = 16;

#[target_feature(enable = "avx2")]
fn luma_kernel(rgb: &[u8], out: &mut [u8]) {
    if out.len() < LUMA {
        return crate::image::luma_scalar(rgb, out);
    }
    // Shuffle masks that gather the bytes of one channel from the three vectors of a block; -1 gives 0.
    let place = |channel: i8, vector: i8, pixel: i8| {
        let at = 3 * pixel + channel - 16 * vector;
        if (0..16).contains(&at) { at } else { -1 }
    };
    let masks: [[__m128i; 3]; 3] = std::array::from_fn(|channel| {
        std::array::from_fn(|vector| {
            let bytes: [i8; 16] =
                std::array::from_fn(|pixel| place(channel as i8, vector as i8, pixel as i8));
            // SAFETY: the array holds the 16 bytes read; the load needs no alignment.
            unsafe { _mm_loadu_si128(bytes.as_ptr().cast()) }
        })
    });
    let weights = [77, 150, 29].map(|w| _mm256_set1_epi16(w));
    for start in blocks(out.len(), LUMA) {
        let vectors = [0, 16, 32].map(|at| load_half_u8(rgb, 3 * start + at));
        let mut sum = _mm256_set1_epi16(128);
        for (mask, weight) in masks.iter().zip(weights) {
            let parts: [__m128i; 3] =
                std::array::from_fn(|v| _mm_shuffle_epi8(vectors[v], mask[v]));
            let bytes = _mm_or_si128(_mm_or_si128(parts[0], parts[1]), parts[2]);
            // At most 256 * 255 + 128, which 16 bits hold.
            let products = _mm256_mullo_epi16(_mm256_cvtepu8_epi16(bytes), weight);
            sum = _mm256_add_epi16(sum, products);
        }
        let grey = _mm256_srli_epi16::<8>(sum);
        let packed = _mm256_packus_epi16(grey, grey);
        // The low halves of both lanes, side by side.
        let packed = _mm256_permute4x64_epi64::<0b1000>(packed);
        let window = &mut out[start..start + LUMA];
        // SAFETY: the window holds the 16 bytes written; the store needs no alignment.
        unsafe {
            _mm_storeu_si128(window.as_mut_ptr().cast(), _mm256_castsi256_si128(packed));
        }
    }
}

/// Twin of [`resample_scalar`].
pub(crate) fn resample_row(source: &[u8], columns: &Axis, out: &mut [i16]) {
    check();
    // SAFETY: `check` has seen that the machine has AVX2.
    unsafe { resample_row_kernel(source, columns, out) }
}

#[target_feature(enable = "avx2")]
fn resample_row_kernel(source: &[u8], columns: &Axis, out: &mut [i16]) {
    if columns.groups.is_empty() {
        return resample_scalar(source, columns, out);
    }
    for group in &columns.groups {
        let bytes = load_half_u8(source, group.base);
        // SAFETY: both arrays hold the 16 bytes read; the loads need no alignment.
        let (shuffle, weights) = unsafe {
            (
                _mm_loadu_si128(group.shuffle.as_ptr().cast()),
                _mm_loadu_si128(group.weights.as_ptr().cast()),
            )
        };
        let pairs = _mm_shuffle_epi8(bytes, shuffle);
        store_half_i16(out, group.start, _mm_maddubs_epi16(pairs, weights));
    }
}

/// Starts of blocks of `block` pixels that cover 0..width (at least one block); the last one may overlap its
/// predecessor.
#[inline(always)]
fn blocks(width: usize, block: usize) -> impl Iterator<Item = usize> {
    (0..width.div_ceil(block)).map(move |k| (block * k).min(width - block))
}

/// Twin of [`blend_scalar`].
pub(crate) fn blend_rows(top: &[i16], bottom: &[i16], fraction: i16, out: &mut [u8]) {
    check();
    // SAFETY: `check` has seen that the machine has AVX2.
    unsafe { blend_rows_kernel(top, bottom, fraction, out) }
}

#[target_feature(enable = "avx2")]
fn blend_rows_kernel(top: &[i16], bottom: &[i16], fraction: i16, out: &mut [u8]) {
    if out.len() < 32 {
        return blend_scalar(top, bottom, fraction, out);
    }
    let (top, bottom) = (&top[..out.len()], &bottom[..out.len()]);
    // The rounding multiply computes (d * (f * 256) + 2^14) >> 15, which is (d f + 64) >> 7.
    let factor = _mm256_set1_epi16(fraction << 8);
    let half = _mm256_set1_epi16(64);
    let blend = |x: usize| {
        let (a, b) = (load_i16(top, x), load_i16(bottom, x));
        let step = _mm256_mulhrs_epi16(_mm256_sub_epi16(b, a), factor);
        // At most 32640 + 64, which still fits a signed word.
        _mm256_srai_epi16::<7>(_mm256_add_epi16(_mm256_add_epi16(a, step), half))
    };
    for x in blocks(out.len(), 32) {
        let packed = _mm256_packus_epi16(blend(x), blend(x + 16));
        store_u8(out, x, _mm256_permute4x64_epi64::<0b11_01_10_00>(packed));
    }
}

/// Twin of [`smooth_row_span`] over a whole row.
pub(crate) fn smooth_row(source: &[u8], out: &mut [u16]) {
    check();
    // SAFETY: `check` has seen that the machine has AVX2.
    unsafe { smooth_row_kernel(source, out) }
}

#[target_feature(enable = "avx2")]
fn smooth_row_kernel(source: &[u8], out: &mut [u16]) {
    let width = source.len();
    if width < 64 {
        return smooth_row_span(source, 0..width, out);
    }
    // Weights of pairs of neighbouring bytes; the pairs start at -3, -1, 1 and 3 px from the target.
    let pair = |a: i16, b: i16| _mm256_set1_epi16(a | (b << 8));
    let weights = [
        pair(TAPS[3], TAPS[2]),
        pair(TAPS[1], TAPS[0]),
        pair(TAPS[1], TAPS[2]),
        pair(TAPS[3], 0),
    ];
    // Sums for the sixteen targets x, x + 2, ..., x + 30.
    let every_second = |x: usize| {
        let sum = |k: usize| _mm256_maddubs_epi16(load_u8(source, x + 2 * k - 3), weights[k]);
        _mm256_add_epi16(
            _mm256_add_epi16(sum(0), sum(1)),
            _mm256_add_epi16(sum(2), sum(3)),
        )
    };
    // The first load begins 3 px before the block, the last ends 4 px after it.
    for start in blocks(width - 7, 32) {
        let x = start + 3;
        let (even, odd) = (every_second(x), every_second(x + 1));
        let (low, high) = (
            _mm256_unpacklo_epi16(even, odd),
            _mm256_unpackhi_epi16(even, odd),
        );
        store_u16(out, x, _mm256_permute2x128_si256::<0x20>(low, high));
        store_u16(out, x + 16, _mm256_permute2x128_si256::<0x31>(low, high));
    }
    smooth_row_span(source, 0..3, out);
    smooth_row_span(source, width - 4..width, out);
}

/// Twin of [`smooth_columns_scalar`].
pub(crate) fn smooth_columns(rows: &[&[u16]; 7], out: &mut [u8]) {
    check();
    // SAFETY: `check` has seen that the machine has AVX2.
    unsafe { smooth_columns_kernel(rows, out) }
}

#[target_feature(enable = "avx2")]
fn smooth_columns_kernel(rows: &[&[u16]; 7], out: &mut [u8]) {
    if out.len() < 32 {
        return smooth_columns_scalar(rows, out);
    }
    // Equal lengths: one bounds check serves all loads of a block.
    let rows = rows.map(|row| &row[..out.len()]);
    let taps = [
        _mm256_set1_epi16(TAPS[0] << 9),
        _mm256_set1_epi16(TAPS[1] << 9),
        _mm256_set1_epi16(TAPS[2] << 9),
        _mm256_set1_epi16(TAPS[3] << 9),
    ];
    for start in blocks(out.len(), 32) {
        // A loop, since the compiler would call a function for each half through memory.
        let mut halves = [_mm256_set1_epi16(64); 2];
        for (half, sum) in halves.iter_mut().enumerate() {
            let x = start + 16 * half;
            *sum = _mm256_add_epi16(*sum, _mm256_mulhi_epu16(load_u16(rows[3], x), taps[0]));
            for k in 1..4 {
                // At most 2 x 32640, which fits an unsigned word.
                let pair = _mm256_add_epi16(load_u16(rows[3 - k], x), load_u16(rows[3 + k], x));
                *sum = _mm256_add_epi16(*sum, _mm256_mulhi_epu16(pair, taps[k]));
            }
            *sum = _mm256_srli_epi16::<7>(*sum);
        }
        let packed = _mm256_packus_epi16(halves[0], halves[1]);
        store_u8(
            out,
            start,
            _mm256_permute4x64_epi64::<0b11_01_10_00>(packed),
        );
    }
}
