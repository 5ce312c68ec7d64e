//! AVX2 kernels of this crate, each the twin of a scalar function that gives the same bits. The only unsafe code of the crate.
#![allow(unsafe_code)]

use std::{arch::x86_64::*, ops::Range};

use stillpoint_imaging::{GrayImage, Simd};

use crate::{
    BestTwo, Descriptor, FeatureGrid, Window,
    fast::{CIRCLE, Corner, maxima_span, score_span},
    matching,
    orientation::{HALF_WIDTHS, RADIUS},
};

/// Every entry calls this, so that no instruction runs on a machine that lacks it. The detection is cached by the standard library.
#[inline]
fn check() {
    assert!(Simd::Avx2.has_avx2(), "AVX2 kernel called without AVX2");
}

/// 32 bytes at `slice[index..]`.
///
/// # Safety
/// `index + 32 <= slice.len()`.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn load(slice: &[u8], index: usize) -> __m256i {
    debug_assert!(index + 32 <= slice.len());
    // SAFETY: the caller promises that the bytes are inside; the load needs no alignment.
    unsafe { _mm256_loadu_si256(slice.as_ptr().add(index).cast()) }
}

/// Twin of [`score_span`].
pub(crate) fn score_rows(
    image: &GrayImage,
    rows: Range<usize>,
    columns: Range<usize>,
    low: u8,
    scores: &mut [u8],
) {
    check();
    let (width, height) = (image.width(), image.height());
    assert!(rows.start >= 3 && rows.end + 3 <= height && scores.len() == image.data().len());
    assert!(columns.start >= 3 && columns.end + 3 <= width);
    for y in rows {
        if columns.len() < 32 {
            let out = &mut scores[y * width..(y + 1) * width];
            score_span(image, y, columns.clone(), low, out);
        } else {
            // SAFETY: `check` has seen AVX2; the row and the at least 32 columns are 3 px inside the image, which has the size of `scores`.
            unsafe { score_row(image, y, columns.clone(), low, scores) }
        }
    }
}

/// # Safety
/// `columns` are at least 32; they and `y` are at least 3 px from the border of `image`, and `scores` has the size of `image`.
#[target_feature(enable = "avx2")]
unsafe fn score_row(
    image: &GrayImage,
    y: usize,
    columns: Range<usize>,
    low: u8,
    scores: &mut [u8],
) {
    let width = image.width();
    let data = image.data();
    let offsets = CIRCLE.map(|(dx, dy)| dy as isize * width as isize + dx as isize);
    let threshold = _mm256_set1_epi8(low as i8);
    let mut x = columns.start;
    while x < columns.end {
        // The last block overlaps the one before; it writes the same values again.
        let start = x.min(columns.end - 32);
        let index = y * width + start;
        // SAFETY: the block and its circles are inside, as the caller promises for all columns of the row.
        let score = unsafe { score_block(data, index, &offsets, threshold) };
        // SAFETY: the block lies inside the row, and `scores` has the size of the image.
        unsafe { _mm256_storeu_si256(scores.as_mut_ptr().add(index).cast(), score) };
        x += 32;
    }
}

/// Scores of 32 pixels, 0 where they are not above the threshold.
///
/// # Safety
/// `index + offset + 32` is inside `data` for each offset.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn score_block(
    data: &[u8],
    index: usize,
    offsets: &[isize; 16],
    threshold: __m256i,
) -> __m256i {
    // SAFETY: the caller promises that all these loads are inside.
    let at = |k: usize| unsafe { load(data, index.wrapping_add_signed(offsets[k])) };
    // SAFETY: as above; the centre lies between the circle's pixels.
    let centre = unsafe { load(data, index) };
    let above = |bright: __m256i, dark: __m256i| {
        _mm256_max_epu8(
            _mm256_subs_epu8(bright, centre),
            _mm256_subs_epu8(centre, dark),
        )
    };
    let none_above = |score: __m256i| {
        let excess = _mm256_subs_epu8(score, threshold);
        _mm256_testz_si256(excess, excess) == 1
    };
    let pair = |k: usize| {
        let (a, b) = (at(k), at(k + 8));
        (_mm256_max_epu8(a, b), _mm256_min_epu8(a, b))
    };
    let both = |a: (__m256i, __m256i), b: (__m256i, __m256i)| {
        (_mm256_min_epu8(a.0, b.0), _mm256_max_epu8(a.1, b.1))
    };
    // Nine adjacent pixels of 16 hold at least one of any two opposite ones, so these bound the score.
    let bound = both(pair(0), pair(4));
    if none_above(above(bound.0, bound.1)) {
        return _mm256_setzero_si256();
    }
    let bound = both(bound, both(pair(2), pair(6)));
    if none_above(above(bound.0, bound.1)) {
        return _mm256_setzero_si256();
    }
    let circle: [__m256i; 16] = std::array::from_fn(at);
    // Extremes over two, four, eight pixels that start at odd places; an arc of nine adds the pixel before or after the eight.
    let two: [_; 8] = std::array::from_fn(|i| {
        let (a, b) = (circle[2 * i + 1], circle[(2 * i + 2) % 16]);
        (_mm256_min_epu8(a, b), _mm256_max_epu8(a, b))
    });
    let wider = |of: &[(__m256i, __m256i); 8], step: usize| -> [(__m256i, __m256i); 8] {
        std::array::from_fn(|i| {
            let (a, b) = (of[i], of[(i + step) % 8]);
            (_mm256_min_epu8(a.0, b.0), _mm256_max_epu8(a.1, b.1))
        })
    };
    let eight = wider(&wider(&two, 1), 2);
    let (mut bright, mut dark) = (_mm256_setzero_si256(), _mm256_set1_epi8(-1));
    for i in 0..8 {
        let (first, last) = (circle[2 * i], circle[(2 * i + 9) % 16]);
        let (least, most) = eight[i];
        bright = _mm256_max_epu8(bright, _mm256_min_epu8(least, _mm256_max_epu8(first, last)));
        dark = _mm256_min_epu8(dark, _mm256_max_epu8(most, _mm256_min_epu8(first, last)));
    }
    let score = above(bright, dark);
    let not_above = _mm256_cmpeq_epi8(_mm256_subs_epu8(score, threshold), _mm256_setzero_si256());
    _mm256_andnot_si256(not_above, score)
}

/// Twin of [`maxima_span`].
pub(crate) fn find_row_maxima(
    scores: &GrayImage,
    y: usize,
    columns: Range<usize>,
    thresholds: &[u8],
    corners: &mut Vec<Corner>,
) {
    check();
    assert!(y >= 1 && y + 1 < scores.height());
    assert!(columns.start >= 1 && columns.end < scores.width());
    assert!(thresholds.len() == scores.width());
    if columns.len() < 32 {
        maxima_span(scores, y, columns, thresholds, corners);
    } else {
        // SAFETY: `check` has seen AVX2; the row and the at least 32 columns, and their neighbours, are inside; there is a threshold per column.
        unsafe { maxima_row(scores, y, columns, thresholds, corners) };
    }
}

/// # Safety
/// `columns` are at least 32; they and `y` are at least 1 px from the border of `scores`, which is as wide as `thresholds`.
#[target_feature(enable = "avx2")]
unsafe fn maxima_row(
    scores: &GrayImage,
    y: usize,
    columns: Range<usize>,
    thresholds: &[u8],
    corners: &mut Vec<Corner>,
) {
    let width = scores.width();
    let data = scores.data();
    // SAFETY: the caller promises that the neighbours of all pixels of the blocks are inside.
    let at = |index: usize| unsafe { load(data, index) };
    for block in columns.clone().step_by(32) {
        let x = block.min(columns.end - 32);
        let index = y * width + x;
        let score = at(index);
        // SAFETY: the block lies inside the row, which is as long as `thresholds`.
        let excess = _mm256_subs_epu8(score, unsafe { load(thresholds, x) });
        if _mm256_testz_si256(excess, excess) == 1 {
            continue;
        }
        let too_low = _mm256_cmpeq_epi8(excess, _mm256_setzero_si256());
        let line = |i: usize| _mm256_max_epu8(_mm256_max_epu8(at(i - 1), at(i)), at(i + 1));
        let before = _mm256_max_epu8(line(index - width), at(index - 1));
        let after = _mm256_max_epu8(line(index + width), at(index + 1));
        let not_above = _mm256_cmpeq_epi8(_mm256_max_epu8(score, before), before);
        let not_below = _mm256_cmpeq_epi8(_mm256_max_epu8(score, after), score);
        let maximum = _mm256_andnot_si256(not_above, not_below);
        let mut mask = _mm256_movemask_epi8(_mm256_andnot_si256(too_low, maximum)) as u32;
        // The last block overlaps the one before, whose pixels are done.
        mask &= u32::MAX << (block - x);
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            corners.push(Corner {
                x: (x + lane) as u16,
                y: y as u16,
                score: data[index + lane],
            });
            mask &= mask - 1;
        }
    }
}

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
    // The low half of a quad word sum is the sum modulo 2^32; the high halves are left out.
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

/// Writes the indices of the rotated points; returns the least and the greatest one.
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
        // The conversion rounds halves to even, which is the mode that Rust guarantees.
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
    // Collecting the samples first leaves nothing but loads and stores in the hot loop; the comparisons are then 32 at a time.
    let mut samples = [0_u8; 512];
    for (sample, &index) in samples.iter_mut().zip(indices) {
        // SAFETY: the caller promises that the index is inside.
        *sample = unsafe { *window.get_unchecked(index as usize) };
    }
    let mut words = [0; 4];
    for block in 0..8 {
        // SAFETY: the second load ends at 256 + 7 * 32 + 32 = 512, the length of the array.
        let (a, b) = unsafe { (load(&samples, 32 * block), load(&samples, 256 + 32 * block)) };
        // Bytes where the first is not darker: the smaller of both is the second.
        let not_darker = _mm256_cmpeq_epi8(_mm256_min_epu8(a, b), b);
        let bits = !_mm256_movemask_epi8(not_darker) as u32;
        words[block / 2] |= u64::from(bits) << (32 * (block % 2));
    }
    Descriptor(words)
}

/// [`matching::best_two_portable`] with the machine's instruction to count bits.
pub(crate) fn best_two(
    grid: &FeatureGrid,
    window: &Window,
    descriptor: &Descriptor,
    descriptors: &[Descriptor],
    accept: impl FnMut(u32) -> bool,
) -> Option<BestTwo> {
    /// The same, compiled for the instruction.
    #[target_feature(enable = "popcnt")]
    fn kernel(
        grid: &FeatureGrid,
        window: &Window,
        descriptor: &Descriptor,
        descriptors: &[Descriptor],
        accept: impl FnMut(u32) -> bool,
    ) -> Option<BestTwo> {
        matching::best_two_portable(grid, window, descriptor, descriptors, accept)
    }
    check();
    // SAFETY: `check` has seen the instruction.
    unsafe { kernel(grid, window, descriptor, descriptors, accept) }
}

/// [`matching::match_brute_force_portable`] with the machine's instruction to count bits.
pub(crate) fn match_brute_force(
    query: &[Descriptor],
    train: &[Descriptor],
    max_distance: u32,
    ratio: f32,
) -> Vec<Option<u32>> {
    /// The same, compiled for the instruction.
    #[target_feature(enable = "popcnt")]
    fn kernel(
        query: &[Descriptor],
        train: &[Descriptor],
        max_distance: u32,
        ratio: f32,
    ) -> Vec<Option<u32>> {
        matching::match_brute_force_portable(query, train, max_distance, ratio)
    }
    check();
    // SAFETY: `check` has seen the instruction.
    unsafe { kernel(query, train, max_distance, ratio) }
}
