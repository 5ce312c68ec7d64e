//! Kernels of orientation and descriptor.

use std::arch::x86_64::*;

use stillpoint_imaging::GrayImage;

use super::{check, load};
use crate::{
    Descriptor,
    orientation::{HALF_WIDTHS, RADIUS},
};

/// For each row of the disc the weights of its 31 pixels, and 0 for the 32nd; 0 outside the disc.
static DISC_WEIGHTS: [[i8; 32]; RADIUS + 1] = disc(false);
/// As above with all bits set inside the disc.
static DISC_MASKS: [[i8; 32]; RADIUS + 1] = disc(true);

const fn disc(mask: bool) -> [[i8; 32]; RADIUS + 1] {
    let mut rows = [[0; 32]; RADIUS + 1];
    let mut v = 0;
    while v <= RADIUS {
        let mut column = RADIUS - HALF_WIDTHS[v];
        while column <= RADIUS + HALF_WIDTHS[v] {
            rows[v][column] = if mask {
                -1
            } else {
                column as i8 - RADIUS as i8
            };
            column += 1;
        }
        v += 1;
    }
    rows
}

/// Twin of [`crate::orientation::moments_scalar`].
pub(crate) fn moments(image: &GrayImage, x: usize, y: usize) -> (i32, i32) {
    check();
    assert!(x >= RADIUS && x + 17 <= image.width());
    assert!(y >= RADIUS && y + RADIUS < image.height());
    // SAFETY: `check` has seen AVX2; the 31 rows of 32 pixels around (x, y) are inside.
    unsafe { moments_kernel(image, x, y) }
}

/// # Safety
/// Rows `y - 15..=y + 15` and columns `x - 15..=x + 16` are inside the image.
#[target_feature(enable = "avx2")]
unsafe fn moments_kernel(image: &GrayImage, x: usize, y: usize) -> (i32, i32) {
    let width = image.width();
    let data = image.data();
    let ones = _mm256_set1_epi16(1);
    let zero = _mm256_setzero_si256();
    // SAFETY: the caller promises that the patch is inside.
    let row = |y: usize| unsafe { load(data, y * width + x - RADIUS) };
    // SAFETY: both tables have 32 bytes per row.
    let table = |rows: &[[i8; 32]; RADIUS + 1], v: usize| unsafe {
        _mm256_loadu_si256(rows[v].as_ptr().cast())
    };
    let centre = _mm256_maddubs_epi16(row(y), table(&DISC_WEIGHTS, 0));
    let mut m10 = _mm256_madd_epi16(centre, ones);
    let mut m01 = zero;
    for v in 1..=RADIUS {
        let (above, below) = (row(y - v), row(y + v));
        let (weights, mask) = (table(&DISC_WEIGHTS, v), table(&DISC_MASKS, v));
        // At most 2 x 2 x 255 x 15, which fits a signed word.
        let sums = _mm256_add_epi16(
            _mm256_maddubs_epi16(above, weights),
            _mm256_maddubs_epi16(below, weights),
        );
        m10 = _mm256_add_epi32(m10, _mm256_madd_epi16(sums, ones));
        let difference = _mm256_sub_epi64(
            _mm256_sad_epu8(_mm256_and_si256(below, mask), zero),
            _mm256_sad_epu8(_mm256_and_si256(above, mask), zero),
        );
        let weighted = _mm256_mul_epi32(difference, _mm256_set1_epi64x(v as i64));
        m01 = _mm256_add_epi64(m01, weighted);
    }
    // The low half of a quad word sum is the sum modulo 2^32.
    let low = _mm256_and_si256(m01, _mm256_set1_epi64x(0xffff_ffff));
    (horizontal_sum(m10), horizontal_sum(low))
}

/// Sum of the eight lanes.
#[inline]
#[target_feature(enable = "avx2")]
fn horizontal_sum(lanes: __m256i) -> i32 {
    let four = _mm_add_epi32(
        _mm256_castsi256_si128(lanes),
        _mm256_extracti128_si256::<1>(lanes),
    );
    let two = _mm_add_epi32(four, _mm_unpackhi_epi64(four, four));
    _mm_cvtsi128_si32(_mm_add_epi32(two, _mm_shuffle_epi32::<1>(two)))
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
    // SAFETY: `check` has seen AVX2.
    let (least, most) = unsafe { rotate(xs, ys, direction, stride, centre, &mut indices) };
    assert!(
        least >= 0 && (most as usize) < window.len(),
        "sample outside the image"
    );
    // SAFETY: `check` has seen AVX2, and all indices are between the least and the most, which are inside.
    unsafe { compare(window, &indices) }
}

/// Writes the indices of the rotated points; returns the smallest and the largest.
#[target_feature(enable = "avx2")]
fn rotate(
    xs: &[f32; 512],
    ys: &[f32; 512],
    (cos, sin): (f32, f32),
    stride: i32,
    centre: i32,
    indices: &mut [i32; 512],
) -> (i32, i32) {
    let (cos, sin) = (_mm256_set1_ps(cos), _mm256_set1_ps(sin));
    let (stride, centre) = (_mm256_set1_epi32(stride), _mm256_set1_epi32(centre));
    let (mut least, mut most) = (_mm256_set1_epi32(i32::MAX), _mm256_set1_epi32(i32::MIN));
    for i in (0..512).step_by(8) {
        // SAFETY: i + 8 is at most 512, the length of the arrays.
        let (x, y) = unsafe {
            (
                _mm256_loadu_ps(xs.as_ptr().add(i)),
                _mm256_loadu_ps(ys.as_ptr().add(i)),
            )
        };
        let column = _mm256_sub_ps(_mm256_mul_ps(x, cos), _mm256_mul_ps(y, sin));
        let row = _mm256_add_ps(_mm256_mul_ps(x, sin), _mm256_mul_ps(y, cos));
        // The conversion rounds halves to even, the mode that Rust guarantees.
        let (column, row) = (_mm256_cvtps_epi32(column), _mm256_cvtps_epi32(row));
        let offset = _mm256_add_epi32(_mm256_mullo_epi32(row, stride), column);
        let index = _mm256_add_epi32(offset, centre);
        (least, most) = (
            _mm256_min_epi32(least, index),
            _mm256_max_epi32(most, index),
        );
        // SAFETY: i + 8 is at most 512, the length of the array.
        unsafe { _mm256_storeu_si256(indices.as_mut_ptr().add(i).cast(), index) };
    }
    let (mut low, mut high) = ([0_i32; 8], [0_i32; 8]);
    // SAFETY: both arrays hold the 32 bytes written; the stores need no alignment.
    unsafe {
        _mm256_storeu_si256(low.as_mut_ptr().cast(), least);
        _mm256_storeu_si256(high.as_mut_ptr().cast(), most);
    }
    let least = low.into_iter().fold(i32::MAX, i32::min);
    (least, high.into_iter().fold(i32::MIN, i32::max))
}

/// # Safety
/// All `indices` are inside `window`.
#[target_feature(enable = "avx2")]
unsafe fn compare(window: &[u8], indices: &[i32; 512]) -> Descriptor {
    // Collecting the samples first leaves only loads and stores in the hot loop; the comparisons are then 32 at a time.
    let mut samples = [0_u8; 512];
    for (sample, &index) in samples.iter_mut().zip(indices) {
        // SAFETY: the caller promises that the index is inside.
        *sample = unsafe { *window.get_unchecked(index as usize) };
    }
    let mut words = [0; 4];
    for block in 0..8 {
        // SAFETY: the second load ends at 256 + 7 * 32 + 32 = 512, the length of the array.
        let (a, b) = unsafe { (load(&samples, 32 * block), load(&samples, 256 + 32 * block)) };
        // Bytes where the first is not darker: the minimum is the second.
        let not_darker = _mm256_cmpeq_epi8(_mm256_min_epu8(a, b), b);
        let bits = !_mm256_movemask_epi8(not_darker) as u32;
        words[block / 2] |= u64::from(bits) << (32 * (block % 2));
    }
    Descriptor(words)
}
