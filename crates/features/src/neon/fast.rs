//! Kernels of the corner detector.

use std::{arch::aarch64::*, ops::Range};

use stillpoint_imaging::GrayImage;

use super::{check, load};
use crate::fast::{CIRCLE, Corner, maxima_span, score_span};

/// Pixels per block: the bytes of a vector register of 128 bits.
const BLOCK: usize = 16;

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
        if columns.len() < BLOCK {
            let out = &mut scores[y * width..(y + 1) * width];
            score_span(image, y, columns.clone(), low, out);
        } else {
            // SAFETY: `check` has seen NEON; the row and the at least 16 columns are 3 px inside the image, which has the size of `scores`.
            unsafe { score_row(image, y, columns.clone(), low, scores) }
        }
    }
}

/// # Safety
/// `columns` are at least 16; they and `y` are at least 3 px from the border of `image`, and `scores` has the size of `image`.
#[target_feature(enable = "neon")]
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
    let mut x = columns.start;
    while x < columns.end {
        // The last block overlaps the one before; it writes the same values again.
        let start = x.min(columns.end - BLOCK);
        let index = y * width + start;
        // SAFETY: the block and its circles are inside, as the caller promises for all columns of the row.
        let score = unsafe { score_block(data, index, &offsets, low) };
        // SAFETY: the block lies inside the row, and `scores` has the size of the image.
        unsafe { vst1q_u8(scores.as_mut_ptr().add(index), score) };
        x += BLOCK;
    }
}

/// Scores of 16 pixels, 0 if not above the threshold.
///
/// # Safety
/// `index + offset + 16` is inside `data` for each offset.
#[inline]
#[target_feature(enable = "neon")]
unsafe fn score_block(data: &[u8], index: usize, offsets: &[isize; 16], low: u8) -> uint8x16_t {
    // SAFETY: the caller promises that all these loads are inside.
    let at = |k: usize| unsafe { load(data, index.wrapping_add_signed(offsets[k])) };
    // SAFETY: as above; the centre lies between the circle's pixels.
    let centre = unsafe { load(data, index) };
    let above = |bright: uint8x16_t, dark: uint8x16_t| {
        vmaxq_u8(vqsubq_u8(bright, centre), vqsubq_u8(centre, dark))
    };
    let none_above = |score: uint8x16_t| vmaxvq_u8(score) <= low;
    let pair = |k: usize| {
        let (a, b) = (at(k), at(k + 8));
        (vmaxq_u8(a, b), vminq_u8(a, b))
    };
    let both = |a: (uint8x16_t, uint8x16_t), b: (uint8x16_t, uint8x16_t)| {
        (vminq_u8(a.0, b.0), vmaxq_u8(a.1, b.1))
    };
    // Nine adjacent pixels of 16 contain at least one of any two opposite ones, so these bound the score.
    let bound = both(pair(0), pair(4));
    if none_above(above(bound.0, bound.1)) {
        return vdupq_n_u8(0);
    }
    let bound = both(bound, both(pair(2), pair(6)));
    if none_above(above(bound.0, bound.1)) {
        return vdupq_n_u8(0);
    }
    let circle: [uint8x16_t; 16] = std::array::from_fn(at);
    // Extremes over two, four, eight pixels that start at odd indices; an arc of nine adds the pixel before or after
    // the eight.
    let two: [_; 8] = std::array::from_fn(|i| {
        let (a, b) = (circle[2 * i + 1], circle[(2 * i + 2) % 16]);
        (vminq_u8(a, b), vmaxq_u8(a, b))
    });
    let wider = |of: &[(uint8x16_t, uint8x16_t); 8], step: usize| -> [(_, _); 8] {
        std::array::from_fn(|i| {
            let (a, b) = (of[i], of[(i + step) % 8]);
            (vminq_u8(a.0, b.0), vmaxq_u8(a.1, b.1))
        })
    };
    let eight = wider(&wider(&two, 1), 2);
    let (mut bright, mut dark) = (vdupq_n_u8(0), vdupq_n_u8(u8::MAX));
    for i in 0..8 {
        let (first, last) = (circle[2 * i], circle[(2 * i + 9) % 16]);
        let (least, most) = eight[i];
        bright = vmaxq_u8(bright, vminq_u8(least, vmaxq_u8(first, last)));
        dark = vminq_u8(dark, vmaxq_u8(most, vminq_u8(first, last)));
    }
    let score = above(bright, dark);
    vandq_u8(score, vcgtq_u8(score, vdupq_n_u8(low)))
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
    if columns.len() < BLOCK {
        maxima_span(scores, y, columns, thresholds, corners);
    } else {
        // SAFETY: `check` has seen NEON; the row and the at least 16 columns, and their neighbours, are inside; there is a threshold per column.
        unsafe { maxima_row(scores, y, columns, thresholds, corners) };
    }
}

/// # Safety
/// `columns` are at least 16; they and `y` are at least 1 px from the border of `scores`, which is as wide as `thresholds`.
#[target_feature(enable = "neon")]
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
    for block in columns.clone().step_by(BLOCK) {
        let x = block.min(columns.end - BLOCK);
        let index = y * width + x;
        let score = at(index);
        // SAFETY: the block lies inside the row, which is as long as `thresholds`.
        let high_enough = vcgtq_u8(score, unsafe { load(thresholds, x) });
        if nibbles(high_enough) == 0 {
            continue;
        }
        let line = |i: usize| vmaxq_u8(vmaxq_u8(at(i - 1), at(i)), at(i + 1));
        let before = vmaxq_u8(line(index - width), at(index - 1));
        let after = vmaxq_u8(line(index + width), at(index + 1));
        let maximum = vandq_u8(vcgtq_u8(score, before), vcgeq_u8(score, after));
        let mut mask = nibbles(vandq_u8(high_enough, maximum));
        // The last block overlaps the one before, whose pixels are done.
        mask &= u64::MAX << (4 * (block - x));
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize / 4;
            corners.push(Corner {
                x: (x + lane) as u16,
                y: y as u16,
                score: data[index + lane],
            });
            mask &= !(0xf << (4 * lane));
        }
    }
}

/// Four bits for each byte, whose bits are all equal.
#[inline]
#[target_feature(enable = "neon")]
fn nibbles(mask: uint8x16_t) -> u64 {
    let narrow = vshrn_n_u16::<4>(vreinterpretq_u16_u8(mask));
    vget_lane_u64::<0>(vreinterpret_u64_u8(narrow))
}
