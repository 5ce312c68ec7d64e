//! Kernels of the flow: a row of 16 pixels at a time.

use std::arch::aarch64::*;

use stillpoint_imaging::GrayImage;

use super::{check, load};
use crate::flow::patch::{DifferenceSums, GradientSums, LANES, Row, Template, WindowPlace};

/// A row in two vectors.
type Lanes = [int16x8_t; 2];

/// Twin of [`Template::sample_scalar`].
pub(crate) fn sample_window(
    template: &mut Template,
    image: &GrayImage,
    place: WindowPlace,
) -> GradientSums {
    check();
    let stride = image.width();
    assert!(place.index > stride);
    assert!(place.index + (template.side + 1) * stride + LANES + 2 <= image.data().len());
    // SAFETY: `check` has seen NEON; the first and the last pixel of the rows are inside.
    unsafe { sample_kernel(template, image, place) }
}

/// # Safety
/// `place.index > stride`, and `place.index + (side + 1) stride + 18` is inside the data.
#[target_feature(enable = "neon")]
unsafe fn sample_kernel(
    template: &mut Template,
    image: &GrayImage,
    place: WindowPlace,
) -> GradientSums {
    let (data, stride, fy) = (image.data(), image.width(), place.fy);
    let used = masks(&template.columns);
    let start = place.index - stride;
    // Row `y - 1` of the window, from `column - 1` on; y is at most side + 2, column at most 2.
    // SAFETY: the caller promises that these pixels are inside.
    let pixels =
        |y: usize, column: usize| unsafe { row(data, start + y * stride + column - 1, place.fx) };
    let zero = vdupq_n_s32(0);
    let (mut xx, mut xy, mut yy, mut x, mut y_sum) = (zero, zero, zero, zero, zero);
    let mut left = pixels(1, 0);
    let mut right = pixels(1, 2);
    let mut below = pixels(2, 1);
    let (mut before, mut centre) = {
        let middle = pixels(1, 1);
        (blend(pixels(0, 1), middle, fy), blend(middle, below, fy))
    };
    for y in 0..template.side {
        let next = pixels(y + 3, 1);
        let after = blend(below, next, fy);
        let (next_left, next_right) = (pixels(y + 2, 0), pixels(y + 2, 2));
        let (ahead, behind) = (blend(right, next_right, fy), blend(left, next_left, fy));
        let (mut gx, mut gy) = (ahead, after);
        for i in 0..2 {
            let across = vsubq_s16(ahead[i], behind[i]);
            let down = vsubq_s16(after[i], before[i]);
            gx[i] = vandq_s16(vqrdmulhq_n_s16(across, 1 << 11), used[i]);
            gy[i] = vandq_s16(vqrdmulhq_n_s16(down, 1 << 11), used[i]);
            x = vpadalq_s16(x, gx[i]);
            y_sum = vpadalq_s16(y_sum, gy[i]);
        }
        store_row(&mut template.gray[y], centre);
        store_row(&mut template.gx[y], gx);
        store_row(&mut template.gy[y], gy);
        xx = add_products(xx, gx, gx);
        xy = add_products(xy, gx, gy);
        yy = add_products(yy, gy, gy);
        (before, centre, below) = (centre, after, next);
        (left, right) = (next_left, next_right);
    }
    GradientSums {
        xx: vaddvq_s32(xx),
        xy: vaddvq_s32(xy),
        yy: vaddvq_s32(yy),
        x: vaddvq_s32(x),
        y: vaddvq_s32(y_sum),
    }
}

/// Twin of [`Template::compare_scalar`].
pub(crate) fn compare_window(
    template: &Template,
    image: &GrayImage,
    place: WindowPlace,
    offset: i16,
) -> DifferenceSums {
    check();
    assert!(place.index + template.side * image.width() + LANES < image.data().len());
    // SAFETY: `check` has seen NEON; the last pixel of the last row is inside.
    unsafe { compare_kernel(template, image, place, offset) }
}

/// # Safety
/// `place.index + side stride + 16` is inside the data.
#[target_feature(enable = "neon")]
unsafe fn compare_kernel(
    template: &Template,
    image: &GrayImage,
    place: WindowPlace,
    offset: i16,
) -> DifferenceSums {
    let (data, stride) = (image.data(), image.width());
    let offset = vdupq_n_s16(offset);
    let used = masks(&template.columns);
    let zero = vdupq_n_s32(0);
    let (mut gx_e, mut gy_e, mut e_sum, mut abs_e) = (zero, zero, zero, zero);
    // SAFETY: y is at most `side`; the caller promises that these pixels are inside.
    let pixels = |y: usize| unsafe { row(data, place.index + y * stride, place.fx) };
    let mut above = pixels(0);
    let rows = template.gray.iter().zip(&template.gx).zip(&template.gy);
    for (y, ((gray, gx), gy)) in rows.enumerate().take(template.side) {
        let below = pixels(y + 1);
        let (mut e, gray) = (blend(above, below, place.fy), load_row(gray));
        for i in 0..2 {
            let difference = vsubq_s16(vsubq_s16(e[i], gray[i]), offset);
            e[i] = vandq_s16(vqrdmulhq_n_s16(difference, 1 << 13), used[i]);
            e_sum = vpadalq_s16(e_sum, e[i]);
            abs_e = vpadalq_s16(abs_e, vabsq_s16(e[i]));
        }
        gx_e = add_products(gx_e, load_row(gx), e);
        gy_e = add_products(gy_e, load_row(gy), e);
        above = below;
    }
    DifferenceSums {
        gx_e: vaddvq_s32(gx_e),
        gy_e: vaddvq_s32(gy_e),
        e: vaddvq_s32(e_sum),
        abs_e: vaddvq_s32(abs_e),
    }
}

/// 16 pixels from `index` on, interpolated with their right neighbours, 1/64 grey level.
///
/// # Safety
/// `index + 17 <= data.len()`.
#[inline]
#[target_feature(enable = "neon")]
unsafe fn row(data: &[u8], index: usize, fx: i16) -> Lanes {
    debug_assert!(index + LANES < data.len());
    // SAFETY: the caller promises that the bytes are inside.
    let (a, b) = unsafe { (load(data, index), load(data, index + 1)) };
    let wide = |v: uint8x16_t| {
        [
            vreinterpretq_s16_u16(vshll_n_u8::<6>(vget_low_u8(v))),
            vreinterpretq_s16_u16(vshll_high_n_u8::<6>(v)),
        ]
    };
    blend(wide(a), wide(b), fx)
}

/// The doubling, rounding multiply computes `(v * fraction + 2^14) >> 15`.
#[inline]
#[target_feature(enable = "neon")]
fn blend(a: Lanes, b: Lanes, fraction: i16) -> Lanes {
    let one = |a, b| vaddq_s16(a, vqrdmulhq_n_s16(vsubq_s16(b, a), fraction));
    [one(a[0], b[0]), one(a[1], b[1])]
}

/// Adds the products of 16 lanes to four sums.
#[inline]
#[target_feature(enable = "neon")]
fn add_products(mut sums: int32x4_t, a: Lanes, b: Lanes) -> int32x4_t {
    for i in 0..2 {
        sums = vmlal_s16(sums, vget_low_s16(a[i]), vget_low_s16(b[i]));
        sums = vmlal_high_s16(sums, a[i], b[i]);
    }
    sums
}

/// All bits of the columns that are 1.
#[inline]
#[target_feature(enable = "neon")]
fn masks(columns: &Row) -> Lanes {
    load_row(columns).map(|c| vnegq_s16(c))
}

#[inline]
#[target_feature(enable = "neon")]
fn load_row(row: &Row) -> Lanes {
    let at = row.0.as_ptr();
    // SAFETY: a row has two times eight values.
    unsafe { [vld1q_s16(at), vld1q_s16(at.add(8))] }
}

#[inline]
#[target_feature(enable = "neon")]
fn store_row(row: &mut Row, lanes: Lanes) {
    let at = row.0.as_mut_ptr();
    // SAFETY: a row has two times eight values.
    unsafe {
        vst1q_s16(at, lanes[0]);
        vst1q_s16(at.add(8), lanes[1]);
    }
}
