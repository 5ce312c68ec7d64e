//! Kernels of orientation and descriptor.

use std::arch::aarch64::*;

use stillpoint_imaging::GrayImage;

use super::{check, load};
use crate::{
    Descriptor,
    orientation::{HALF_WIDTHS, RADIUS},
};

/// For each row of the disc 31 pixels and one more, with all bits set inside the disc.
static DISC_MASKS: [[u8; 32]; RADIUS + 1] = disc();

const fn disc() -> [[u8; 32]; RADIUS + 1] {
    let mut rows = [[0; 32]; RADIUS + 1];
    let mut v = 0;
    while v <= RADIUS {
        let mut column = RADIUS - HALF_WIDTHS[v];
        while column <= RADIUS + HALF_WIDTHS[v] {
            rows[v][column] = u8::MAX;
            column += 1;
        }
        v += 1;
    }
    rows
}

/// Distances of the 32 columns from the centre.
static DISTANCES: [i16; 32] = {
    let mut columns = [0; 32];
    let mut i = 0;
    while i < 32 {
        columns[i] = i as i16 - RADIUS as i16;
        i += 1;
    }
    columns
};

/// Twin of [`crate::orientation::moments_scalar`].
pub(crate) fn moments(image: &GrayImage, x: usize, y: usize) -> (i32, i32) {
    check();
    assert!(x >= RADIUS && x + 17 <= image.width());
    assert!(y >= RADIUS && y + RADIUS < image.height());
    // SAFETY: `check` has seen NEON; the 31 rows of 32 pixels around (x, y) are inside.
    unsafe { moments_kernel(image, x, y) }
}

/// # Safety
/// Rows `y - 15..=y + 15` and columns `x - 15..=x + 16` are inside the image.
#[target_feature(enable = "neon")]
unsafe fn moments_kernel(image: &GrayImage, x: usize, y: usize) -> (i32, i32) {
    let width = image.width();
    let data = image.data();
    let row = |y: usize, half: usize, mask: uint8x16_t| {
        // SAFETY: the caller promises that the patch is inside.
        let pixels = unsafe { load(data, y * width + x - RADIUS + 16 * half) };
        vandq_u8(pixels, mask)
    };
    // SAFETY: the table has 32 bytes per row.
    let mask = |v: usize, half: usize| unsafe { load(&DISC_MASKS[v], 16 * half) };
    let (mut m10, mut m01) = (vdupq_n_s32(0), vdupq_n_s32(0));
    for half in 0..2 {
        let centre = row(y, half, mask(0, half));
        // Sums of columns, at most 31 x 255, and of columns weighted by their rows, at most 120 x 255: both fit.
        let mut sums = [vmovl_u8(vget_low_u8(centre)), vmovl_high_u8(centre)];
        let mut weighted = [vdupq_n_s16(0); 2];
        for v in 1..=RADIUS {
            let mask = mask(v, half);
            let (above, below) = (row(y - v, half, mask), row(y + v, half, mask));
            let both = [
                vaddl_u8(vget_low_u8(above), vget_low_u8(below)),
                vaddl_high_u8(above, below),
            ];
            let difference = [
                vsubl_u8(vget_low_u8(below), vget_low_u8(above)),
                vsubl_high_u8(below, above),
            ];
            for i in 0..2 {
                sums[i] = vaddq_u16(sums[i], both[i]);
                let difference = vreinterpretq_s16_u16(difference[i]);
                weighted[i] = vmlaq_n_s16(weighted[i], difference, v as i16);
            }
        }
        for i in 0..2 {
            // SAFETY: the table has 32 entries; i and the half are at most 1.
            let distances = unsafe { vld1q_s16(DISTANCES.as_ptr().add(16 * half + 8 * i)) };
            let sums = vreinterpretq_s16_u16(sums[i]);
            m10 = vmlal_s16(m10, vget_low_s16(sums), vget_low_s16(distances));
            m10 = vmlal_high_s16(m10, sums, distances);
            m01 = vpadalq_s16(m01, weighted[i]);
        }
    }
    (vaddvq_s32(m10), vaddvq_s32(m01))
}

/// Twin of [`crate::brief::rotate_scalar`] followed by [`crate::brief::compare_scalar`]; the window comes with the index of its centre.
pub(crate) fn describe(
    xs: &[f32; 512],
    ys: &[f32; 512],
    direction: (f32, f32),
    stride: i32,
    (window, centre): (&[u8], i32),
) -> Descriptor {
    check();
    let mut indices = [0; 512];
    // SAFETY: `check` has seen NEON.
    let (least, most) = unsafe { rotate(xs, ys, direction, stride, centre, &mut indices) };
    assert!(
        least >= 0 && (most as usize) < window.len(),
        "sample outside the image"
    );
    // SAFETY: `check` has seen NEON, and all indices are between the least and the most, which are inside.
    unsafe { compare(window, &indices) }
}

/// Writes the indices of the rotated points; returns the smallest and the largest.
#[target_feature(enable = "neon")]
fn rotate(
    xs: &[f32; 512],
    ys: &[f32; 512],
    (cos, sin): (f32, f32),
    stride: i32,
    centre: i32,
    indices: &mut [i32; 512],
) -> (i32, i32) {
    let centre = vdupq_n_s32(centre);
    let (mut least, mut most) = (vdupq_n_s32(i32::MAX), vdupq_n_s32(i32::MIN));
    for i in (0..512).step_by(4) {
        // SAFETY: i + 4 is at most 512, the length of the arrays.
        let (x, y) = unsafe { (vld1q_f32(xs.as_ptr().add(i)), vld1q_f32(ys.as_ptr().add(i))) };
        let column = vsubq_f32(vmulq_n_f32(x, cos), vmulq_n_f32(y, sin));
        let row = vaddq_f32(vmulq_n_f32(x, sin), vmulq_n_f32(y, cos));
        // The conversion rounds halves to even.
        let (column, row) = (vcvtnq_s32_f32(column), vcvtnq_s32_f32(row));
        let index = vmlaq_n_s32(vaddq_s32(column, centre), row, stride);
        (least, most) = (vminq_s32(least, index), vmaxq_s32(most, index));
        // SAFETY: i + 4 is at most 512, the length of the array.
        unsafe { vst1q_s32(indices.as_mut_ptr().add(i), index) };
    }
    (vminvq_s32(least), vmaxvq_s32(most))
}

/// # Safety
/// All `indices` are inside `window`.
#[target_feature(enable = "neon")]
unsafe fn compare(window: &[u8], indices: &[i32; 512]) -> Descriptor {
    // Collecting the samples first leaves only loads and stores in the hot loop; the comparisons are then 64 at a time.
    let mut samples = [0_u8; 512];
    // Unrolled by eight to reduce loop overhead.
    for (samples, indices) in samples.chunks_exact_mut(8).zip(indices.chunks_exact(8)) {
        for (sample, &index) in samples.iter_mut().zip(indices) {
            // SAFETY: the caller promises that the index is inside.
            *sample = unsafe { *window.get_unchecked(index as usize) };
        }
    }
    // The bit of each byte in the packed byte.
    let bits = vreinterpretq_u8_u64(vdupq_n_u64(0x8040_2010_0804_0201));
    let mut words = [0; 4];
    for (k, word) in words.iter_mut().enumerate() {
        let darker = |part: usize| {
            let at = 64 * k + 16 * part;
            // SAFETY: the second load ends at 256 + 3 * 64 + 3 * 16 + 16 = 512, the length of the array.
            let (a, b) = unsafe { (load(&samples, at), load(&samples, 256 + at)) };
            vandq_u8(vcltq_u8(a, b), bits)
        };
        // Pairwise addition three times packs eight bytes into one.
        let (low, high) = (
            vpaddq_u8(darker(0), darker(1)),
            vpaddq_u8(darker(2), darker(3)),
        );
        let bytes = vpaddq_u8(low, high);
        let bytes = vpaddq_u8(bytes, bytes);
        *word = vgetq_lane_u64::<0>(vreinterpretq_u64_u8(bytes));
    }
    Descriptor(words)
}
