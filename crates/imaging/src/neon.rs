//! NEON kernels, each bit-identical to a scalar twin. The only unsafe code of the crate on 64-bit Arm.
//!
//! Luma has none: the compiler generates better NEON code from its portable version than the hand-written one.
#![allow(unsafe_code)]

use std::arch::aarch64::*;

use crate::{
    Simd,
    blur::{TAPS, smooth_columns_scalar, smooth_row_span},
    resize::{Axis, blend_scalar, resample_scalar},
};

/// Pixels per block of all kernels.
const BLOCK: usize = 16;

/// Guards every entry point, so that no NEON instruction runs on a machine without NEON. Free where all machines of a
/// target have NEON.
#[inline]
fn check() {
    assert!(Simd::Neon.has_neon(), "NEON kernel called without NEON");
}

#[inline]
#[target_feature(enable = "neon")]
fn load_u8(slice: &[u8], index: usize) -> uint8x16_t {
    let window = &slice[index..index + 16];
    // SAFETY: the window holds the 16 bytes read; the load needs no alignment.
    unsafe { vld1q_u8(window.as_ptr()) }
}

#[inline]
#[target_feature(enable = "neon")]
fn load_u16(slice: &[u16], index: usize) -> uint16x8_t {
    let window = &slice[index..index + 8];
    // SAFETY: the window holds the 16 bytes read; the load needs no alignment.
    unsafe { vld1q_u16(window.as_ptr()) }
}

#[inline]
#[target_feature(enable = "neon")]
fn load_i16(slice: &[i16], index: usize) -> int16x8_t {
    let window = &slice[index..index + 8];
    // SAFETY: the window holds the 16 bytes read; the load needs no alignment.
    unsafe { vld1q_s16(window.as_ptr()) }
}

#[inline]
#[target_feature(enable = "neon")]
fn store_u8(slice: &mut [u8], index: usize, value: uint8x16_t) {
    let window = &mut slice[index..index + 16];
    // SAFETY: the window holds the 16 bytes written; the store needs no alignment.
    unsafe { vst1q_u8(window.as_mut_ptr(), value) }
}

#[inline]
#[target_feature(enable = "neon")]
fn store_u16(slice: &mut [u16], index: usize, value: uint16x8_t) {
    let window = &mut slice[index..index + 8];
    // SAFETY: the window holds the 16 bytes written; the store needs no alignment.
    unsafe { vst1q_u16(window.as_mut_ptr(), value) }
}

#[inline]
#[target_feature(enable = "neon")]
fn store_i16(slice: &mut [i16], index: usize, value: int16x8_t) {
    let window = &mut slice[index..index + 8];
    // SAFETY: the window holds the 16 bytes written; the store needs no alignment.
    unsafe { vst1q_s16(window.as_mut_ptr(), value) }
}

/// Starts of blocks that cover 0..width (at least one block); the last one may overlap its predecessor.
#[inline(always)]
fn blocks(width: usize) -> impl Iterator<Item = usize> {
    (0..width.div_ceil(BLOCK)).map(move |k| (BLOCK * k).min(width - BLOCK))
}

/// Twin of [`resample_scalar`].
pub(crate) fn resample_row(source: &[u8], columns: &Axis, out: &mut [i16]) {
    check();
    // SAFETY: `check` has seen that the machine has NEON.
    unsafe { resample_row_kernel(source, columns, out) }
}

#[target_feature(enable = "neon")]
fn resample_row_kernel(source: &[u8], columns: &Axis, out: &mut [i16]) {
    if columns.groups.is_empty() {
        return resample_scalar(source, columns, out);
    }
    for group in &columns.groups {
        let bytes = load_u8(source, group.base);
        // SAFETY: both arrays hold the 16 bytes read; the loads need no alignment.
        let (shuffle, weights) = unsafe {
            (
                vld1q_u8(group.shuffle.as_ptr()),
                vld1q_s8(group.weights.as_ptr()),
            )
        };
        let pairs = vqtbl1q_u8(bytes, shuffle);
        // Weights are 1 to 127: the sign is irrelevant.
        let weights = vreinterpretq_u8_s8(weights);
        let low = vmull_u8(vget_low_u8(pairs), vget_low_u8(weights));
        let sums = vpaddq_u16(low, vmull_high_u8(pairs, weights));
        store_i16(out, group.start, vreinterpretq_s16_u16(sums));
    }
}

/// Twin of [`blend_scalar`].
pub(crate) fn blend_rows(top: &[i16], bottom: &[i16], fraction: i16, out: &mut [u8]) {
    check();
    // SAFETY: `check` has seen that the machine has NEON.
    unsafe { blend_rows_kernel(top, bottom, fraction, out) }
}

#[target_feature(enable = "neon")]
fn blend_rows_kernel(top: &[i16], bottom: &[i16], fraction: i16, out: &mut [u8]) {
    if out.len() < BLOCK {
        return blend_scalar(top, bottom, fraction, out);
    }
    let (top, bottom) = (&top[..out.len()], &bottom[..out.len()]);
    // The rounding multiply computes (d * (f * 256) + 2^14) >> 15, which is (d f + 64) >> 7.
    let factor = vdupq_n_s16(fraction << 8);
    let blend = |x: usize| {
        let (a, b) = (load_i16(top, x), load_i16(bottom, x));
        vaddq_s16(a, vqrdmulhq_s16(vsubq_s16(b, a), factor))
    };
    for x in blocks(out.len()) {
        // The rounding shift adds the 64.
        let low = vqrshrun_n_s16::<7>(blend(x));
        store_u8(out, x, vqrshrun_high_n_s16::<7>(low, blend(x + 8)));
    }
}

/// Twin of [`smooth_row_span`] over a whole row.
pub(crate) fn smooth_row(source: &[u8], out: &mut [u16]) {
    check();
    // SAFETY: `check` has seen that the machine has NEON.
    unsafe { smooth_row_kernel(source, out) }
}

#[target_feature(enable = "neon")]
fn smooth_row_kernel(source: &[u8], out: &mut [u16]) {
    let width = source.len();
    if width < REACH {
        return smooth_row_span(source, 0..width, out);
    }
    let inner = &mut out[3..width - 3];
    for (window, out) in source
        .windows(REACH)
        .step_by(BLOCK)
        .zip(inner.chunks_exact_mut(BLOCK))
    {
        smooth_block(window, out);
    }
    smooth_block(&source[width - REACH..], &mut inner[width - REACH..]);
    smooth_row_span(source, 0..3, out);
    smooth_row_span(source, width - 3..width, out);
}

/// Input pixels of a block, which extends 3 px to both sides.
const REACH: usize = BLOCK + 6;

#[inline]
#[target_feature(enable = "neon")]
fn smooth_block(window: &[u8], out: &mut [u16]) {
    let tap = |k: usize| TAPS[k] as u16;
    let centre = load_u8(window, 3);
    let mut low = vmulq_n_u16(vmovl_u8(vget_low_u8(centre)), tap(0));
    let mut high = vmulq_n_u16(vmovl_high_u8(centre), tap(0));
    for k in 1..4 {
        let (a, b) = (load_u8(window, 3 - k), load_u8(window, 3 + k));
        let pair = vaddl_u8(vget_low_u8(a), vget_low_u8(b));
        low = vmlaq_n_u16(low, pair, tap(k));
        high = vmlaq_n_u16(high, vaddl_high_u8(a, b), tap(k));
    }
    store_u16(out, 0, low);
    store_u16(out, 8, high);
}

/// Twin of [`smooth_columns_scalar`].
pub(crate) fn smooth_columns(rows: &[&[u16]; 7], out: &mut [u8]) {
    check();
    // SAFETY: `check` has seen that the machine has NEON.
    unsafe { smooth_columns_kernel(rows, out) }
}

#[target_feature(enable = "neon")]
fn smooth_columns_kernel(rows: &[&[u16]; 7], out: &mut [u8]) {
    if out.len() < BLOCK {
        return smooth_columns_scalar(rows, out);
    }
    // Equal lengths: one bounds check serves all loads of a block.
    let rows = rows.map(|row| &row[..out.len()]);
    // The doubling multiply computes v * (tap * 256) * 2 >> 16, which is v tap >> 7, of signed words. A pair is at most
    // 2 x 32640, an unsigned word: minus 2^15 it fits a signed one, and its product is smaller by 256 tap, a whole
    // number, which is added at the end.
    let scaled = |v: uint16x8_t, k: usize| {
        let product = vqdmulhq_n_s16(vreinterpretq_s16_u16(v), TAPS[k] << 8);
        vreinterpretq_u16_s16(product)
    };
    let sign = vdupq_n_u16(1 << 15);
    let taken = vdupq_n_u16(256 * (TAPS[1] + TAPS[2] + TAPS[3]) as u16);
    let sum = |x: usize| {
        let mut sum = vaddq_u16(taken, scaled(load_u16(rows[3], x), 0));
        for k in 1..4 {
            let pair = vaddq_u16(load_u16(rows[3 - k], x), load_u16(rows[3 + k], x));
            sum = vaddq_u16(sum, scaled(veorq_u16(pair, sign), k));
        }
        sum
    };
    for x in blocks(out.len()) {
        // The rounding shift adds the 64.
        let low = vrshrn_n_u16::<7>(sum(x));
        store_u8(out, x, vrshrn_high_n_u16::<7>(low, sum(x + 8)));
    }
}
