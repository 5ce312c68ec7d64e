//! Kernels of the flow: a row of 16 pixels at a time.

use std::arch::x86_64::*;

use stillpoint_imaging::GrayImage;

use super::check;
use crate::flow::patch::{DifferenceSums, GradientSums, LANES, Row, Template, WindowPlace};

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
    // SAFETY: `check` has seen AVX2; the first and the last pixel of the rows are inside.
    unsafe { sample_kernel(template, image, place) }
}

/// # Safety
/// `place.index > stride`, and `place.index + (side + 1) stride + 18` is inside the data.
#[target_feature(enable = "avx2")]
unsafe fn sample_kernel(
    template: &mut Template,
    image: &GrayImage,
    place: WindowPlace,
) -> GradientSums {
    let (data, stride) = (image.data(), image.width());
    let (fx, fy) = (_mm256_set1_epi16(place.fx), _mm256_set1_epi16(place.fy));
    let columns = load_row(&template.columns);
    let sixteenth = _mm256_set1_epi16(1 << 11);
    let start = place.index - stride;
    // Row `y - 1` of the window, from `column - 1` on; y is at most side + 2, column at most 2.
    // SAFETY: the caller promises that these pixels are inside.
    let pixels =
        |y: usize, column: usize| unsafe { row(data, start + y * stride + column - 1, fx) };
    let zero = _mm256_setzero_si256();
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
        let across = _mm256_sub_epi16(blend(right, next_right, fy), blend(left, next_left, fy));
        let down = _mm256_sub_epi16(after, before);
        // The sign instruction clears columns where its second argument is 0 and leaves those where it is 1.
        let gx = _mm256_sign_epi16(_mm256_mulhrs_epi16(across, sixteenth), columns);
        let gy = _mm256_sign_epi16(_mm256_mulhrs_epi16(down, sixteenth), columns);
        store_row(&mut template.gray[y], centre);
        store_row(&mut template.gx[y], gx);
        store_row(&mut template.gy[y], gy);
        xx = _mm256_add_epi32(xx, _mm256_madd_epi16(gx, gx));
        xy = _mm256_add_epi32(xy, _mm256_madd_epi16(gx, gy));
        yy = _mm256_add_epi32(yy, _mm256_madd_epi16(gy, gy));
        x = _mm256_add_epi32(x, _mm256_madd_epi16(gx, columns));
        y_sum = _mm256_add_epi32(y_sum, _mm256_madd_epi16(gy, columns));
        (before, centre, below) = (centre, after, next);
        (left, right) = (next_left, next_right);
    }
    let [xx, xy, yy, x] = sums([xx, xy, yy, x]);
    let [y, ..] = sums([y_sum, zero, zero, zero]);
    GradientSums { xx, xy, yy, x, y }
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
    // SAFETY: `check` has seen AVX2; the last pixel of the last row is inside.
    unsafe { compare_kernel(template, image, place, offset) }
}

/// # Safety
/// `place.index + side stride + 16` is inside the data.
#[target_feature(enable = "avx2")]
unsafe fn compare_kernel(
    template: &Template,
    image: &GrayImage,
    place: WindowPlace,
    offset: i16,
) -> DifferenceSums {
    let (data, stride) = (image.data(), image.width());
    let (fx, fy) = (_mm256_set1_epi16(place.fx), _mm256_set1_epi16(place.fy));
    let offset = _mm256_set1_epi16(offset);
    let columns = load_row(&template.columns);
    let quarter = _mm256_set1_epi16(1 << 13);
    let zero = _mm256_setzero_si256();
    let (mut gx_e, mut gy_e, mut e_sum, mut abs_e) = (zero, zero, zero, zero);
    // SAFETY: y is at most `side`; the caller promises that these pixels are inside.
    let pixels = |y: usize| unsafe { row(data, place.index + y * stride, fx) };
    let mut above = pixels(0);
    let rows = template.gray.iter().zip(&template.gx).zip(&template.gy);
    for (y, ((gray, gx), gy)) in rows.enumerate().take(template.side) {
        let below = pixels(y + 1);
        let other = blend(above, below, fy);
        let difference = _mm256_sub_epi16(_mm256_sub_epi16(other, load_row(gray)), offset);
        let e = _mm256_mulhrs_epi16(difference, quarter);
        gx_e = _mm256_add_epi32(gx_e, _mm256_madd_epi16(load_row(gx), e));
        gy_e = _mm256_add_epi32(gy_e, _mm256_madd_epi16(load_row(gy), e));
        e_sum = _mm256_add_epi32(e_sum, _mm256_madd_epi16(e, columns));
        abs_e = _mm256_add_epi32(abs_e, _mm256_madd_epi16(_mm256_abs_epi16(e), columns));
        above = below;
    }
    let [gx_e, gy_e, e, abs_e] = sums([gx_e, gy_e, e_sum, abs_e]);
    DifferenceSums {
        gx_e,
        gy_e,
        e,
        abs_e,
    }
}

/// 16 pixels from `index` on, interpolated with their right neighbours, 1/64 grey level.
///
/// # Safety
/// `index + 17 <= data.len()`.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn row(data: &[u8], index: usize, fx: __m256i) -> __m256i {
    debug_assert!(index + LANES < data.len());
    // SAFETY: the caller promises that the bytes are inside; the loads need no alignment.
    let (a, b) = unsafe {
        let start = data.as_ptr().add(index);
        (
            _mm_loadu_si128(start.cast()),
            _mm_loadu_si128(start.add(1).cast()),
        )
    };
    let (a, b) = (_mm256_cvtepu8_epi16(a), _mm256_cvtepu8_epi16(b));
    blend(_mm256_slli_epi16::<6>(a), _mm256_slli_epi16::<6>(b), fx)
}

#[inline]
#[target_feature(enable = "avx2")]
fn blend(a: __m256i, b: __m256i, fraction: __m256i) -> __m256i {
    _mm256_add_epi16(a, _mm256_mulhrs_epi16(_mm256_sub_epi16(b, a), fraction))
}

#[inline]
#[target_feature(enable = "avx2")]
fn load_row(row: &Row) -> __m256i {
    // SAFETY: a row has 32 bytes and is aligned to 32.
    unsafe { _mm256_load_si256(row.0.as_ptr().cast()) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn store_row(row: &mut Row, lanes: __m256i) {
    // SAFETY: a row has 32 bytes and is aligned to 32.
    unsafe { _mm256_store_si256(row.0.as_mut_ptr().cast(), lanes) }
}

/// The sums of the eight lanes of each vector.
#[inline]
#[target_feature(enable = "avx2")]
fn sums([a, b, c, d]: [__m256i; 4]) -> [i32; 4] {
    let lanes = _mm256_hadd_epi32(_mm256_hadd_epi32(a, b), _mm256_hadd_epi32(c, d));
    let four = _mm_add_epi32(
        _mm256_castsi256_si128(lanes),
        _mm256_extracti128_si256::<1>(lanes),
    );
    let mut out = [0; 4];
    // SAFETY: the array holds the 16 bytes written; the store needs no alignment.
    unsafe { _mm_storeu_si128(out.as_mut_ptr().cast(), four) };
    out
}
