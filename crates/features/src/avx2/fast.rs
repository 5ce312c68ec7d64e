//! Kernels of the corner detector.

use std::{arch::x86_64::*, ops::Range};

use stillpoint_imaging::GrayImage;

use super::{check, load};
use crate::fast::{CIRCLE, Corner, maxima_span, score_span};

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

/// Scores of 32 pixels, 0 if not above the threshold.
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
    // Nine adjacent pixels of 16 contain at least one of any two opposite ones, so these bound the score.
    let bound = both(pair(0), pair(4));
    if none_above(above(bound.0, bound.1)) {
        return _mm256_setzero_si256();
    }
    let bound = both(bound, both(pair(2), pair(6)));
    if none_above(above(bound.0, bound.1)) {
        return _mm256_setzero_si256();
    }
    let circle: [__m256i; 16] = std::array::from_fn(at);
    // Extremes over two, four, eight pixels that start at odd indices; an arc of nine adds the pixel before or after
    // the eight.
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
