//! AVX2 kernels, each bit-identical to a scalar twin. The only unsafe code of the crate on x86-64.
#![allow(unsafe_code)]

use std::arch::x86_64::*;

use crate::block::{Block, FULL, SIDE};
use crate::observation::{COLOUR_PX, PER_METRE};
use crate::pixels::{GAP, NO_GAP, Row, RowOut, fill_row_scalar};
use crate::voxels::{LEAST_MIX, MOST_WEIGHT, NEAR, Placed, SEEN_THROUGH, Sight};
use stillpoint_imaging::Simd;

/// Panics on a machine without AVX2. Called at every entry; the standard library caches the detection.
#[inline]
fn check() {
    assert!(Simd::Avx2.has_avx2(), "AVX2 kernel called without AVX2");
}

/// Twin of [`fill_row_scalar`]: the same code compiled for wider vectors. No operations are fused, so that the bits are the same.
pub(crate) fn fill_row(row: &Row<'_>, out: &mut RowOut<'_>) -> [u16; 2] {
    #[target_feature(enable = "avx2")]
    fn wide(row: &Row<'_>, out: &mut RowOut<'_>) -> [u16; 2] {
        fill_row_scalar(row, out)
    }
    check();
    // SAFETY: `check` verified that the machine has AVX2.
    unsafe { wide(row, out) }
}

/// Twin of [`crate::voxels::update_scalar`].
pub(crate) fn update(sight: &Sight<'_>, placed: &Placed, block: &mut Block) -> bool {
    check();
    let pixels = sight.width * sight.height;
    let colours = sight.colour_width * sight.height.div_ceil(COLOUR_PX);
    assert!(
        sight.pixels.len() >= pixels
            && sight.colours.len() >= colours
            && sight.colour_width == sight.width.div_ceil(COLOUR_PX)
            && pixels < i32::MAX as usize,
        "images are smaller than they are said to be"
    );
    // SAFETY: `check` verified that the machine has AVX2; the images have the size that the kernel assumes.
    unsafe { update_kernel(sight, placed, block) }
}

struct Constants {
    fx: __m256,
    fy: __m256,
    cx: __m256,
    cy: __m256,
    last_u: __m256,
    last_v: __m256,
    width: __m256i,
    truncation: __m256,
    minus_truncation: __m256,
    clear: __m256,
    fall: __m256,
    scale: __m256,
    step: [__m256; 3],
}

#[inline]
#[target_feature(enable = "avx2")]
fn constants(sight: &Sight<'_>, placed: &Placed) -> Constants {
    let all = _mm256_set1_ps;
    let [fx, fy, cx, cy] = sight.camera;
    let lanes = _mm256_setr_ps(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0);
    let along = |i: usize| _mm256_mul_ps(_mm256_set1_ps(placed.steps[0][i]), lanes);
    Constants {
        fx: all(fx),
        fy: all(fy),
        cx: all(cx),
        cy: all(cy),
        last_u: all((sight.width - 1) as f32),
        last_v: all((sight.height - 1) as f32),
        width: _mm256_set1_epi32(sight.width as i32),
        truncation: all(sight.rule.truncation),
        minus_truncation: all(-sight.rule.truncation),
        clear: all(placed.clear_weight),
        fall: all(sight.rule.fall),
        scale: all(sight.rule.scale),
        step: [along(0), along(1), along(2)],
    }
}

/// # Safety
/// `sight.pixels` has `width * height` entries and `sight.colours` one for every `COLOUR_PX` pixels of these.
#[target_feature(enable = "avx2")]
unsafe fn update_kernel(sight: &Sight<'_>, placed: &Placed, block: &mut Block) -> bool {
    let c = constants(sight, placed);
    let mut any = false;
    for row in 0..SIDE * SIDE {
        let first = placed.row(row % SIDE, row / SIDE);
        let start = SIDE * row;
        // SAFETY: guaranteed by the caller.
        let Some(seen) = (unsafe { look(sight, &c, first) }) else {
            continue;
        };
        let Some(lanes) = sort(&c, &seen, block, start) else {
            continue;
        };
        any = true;
        let learnt = average(&c, &seen, &lanes, block, start);
        // SAFETY: guaranteed by the caller.
        unsafe {
            paint(
                sight,
                &seen,
                &lanes,
                &learnt,
                &mut block.colour[start..start + SIDE],
            )
        };
    }
    any
}

struct Seen {
    u: __m256i,
    v: __m256i,
    pixel: __m256i,
    /// Mask of voxels with a measured pixel and at most the truncation behind its surface.
    near: __m256,
    distance: __m256,
}

/// # Safety
/// `sight.pixels` has `width * height` entries.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn look(sight: &Sight<'_>, c: &Constants, [x, y, z]: [f32; 3]) -> Option<Seen> {
    const NEAREST: i32 = _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC;
    let zero = _mm256_setzero_ps();
    let px = _mm256_add_ps(_mm256_set1_ps(x), c.step[0]);
    let py = _mm256_add_ps(_mm256_set1_ps(y), c.step[1]);
    let pz = _mm256_add_ps(_mm256_set1_ps(z), c.step[2]);
    let over_z = _mm256_div_ps(_mm256_set1_ps(1.0), pz);
    let u = _mm256_add_ps(_mm256_mul_ps(_mm256_mul_ps(px, over_z), c.fx), c.cx);
    let v = _mm256_add_ps(_mm256_mul_ps(_mm256_mul_ps(py, over_z), c.fy), c.cy);
    let (u, v) = (_mm256_round_ps::<NEAREST>(u), _mm256_round_ps::<NEAREST>(v));
    let in_u = _mm256_and_ps(
        _mm256_cmp_ps::<_CMP_GE_OQ>(u, zero),
        _mm256_cmp_ps::<_CMP_LE_OQ>(u, c.last_u),
    );
    let in_v = _mm256_and_ps(
        _mm256_cmp_ps::<_CMP_GE_OQ>(v, zero),
        _mm256_cmp_ps::<_CMP_LE_OQ>(v, c.last_v),
    );
    let ahead = _mm256_cmp_ps::<_CMP_GE_OQ>(pz, _mm256_set1_ps(NEAR));
    let inside = _mm256_and_ps(_mm256_and_ps(in_u, in_v), ahead);
    if _mm256_movemask_ps(inside) == 0 {
        return None;
    }
    let (u, v) = (_mm256_cvtps_epi32(u), _mm256_cvtps_epi32(v));
    let at = _mm256_add_epi32(_mm256_mullo_epi32(v, c.width), u);
    // SAFETY: lanes outside of the image are masked out, and the others are below `width * height`.
    let pixel = unsafe {
        _mm256_mask_i32gather_epi32::<4>(
            _mm256_setzero_si256(),
            sight.pixels.as_ptr().cast(),
            at,
            _mm256_castps_si256(inside),
        )
    };
    let depth = _mm256_and_si256(pixel, _mm256_set1_epi32(0xffff));
    let metres = _mm256_mul_ps(_mm256_cvtepi32_ps(depth), _mm256_set1_ps(1.0 / PER_METRE));
    let distance = _mm256_sub_ps(metres, pz);
    // Masked lanes have a pixel of zero.
    let measured = _mm256_cmpgt_epi32(depth, _mm256_setzero_si256());
    let near = _mm256_cmp_ps::<_CMP_GE_OQ>(distance, c.minus_truncation);
    let near = _mm256_and_ps(near, _mm256_castsi256_ps(measured));
    (_mm256_movemask_ps(near) != 0).then_some(Seen {
        u,
        v,
        pixel,
        near,
        distance,
    })
}

/// Which voxels of a row are updated, and with what.
struct Lanes {
    /// Near a surface.
    band: __m256,
    /// Near a surface, or seen through.
    learns: __m256,
    seen: __m256i,
    known: __m256,
    old: __m256,
}

#[inline]
#[target_feature(enable = "avx2")]
fn sort(c: &Constants, s: &Seen, block: &mut Block, start: usize) -> Option<Lanes> {
    let (weights, distances) = (
        &block.weight[start..start + SIDE],
        &block.distance[start..start + SIDE],
    );
    // SAFETY: each window holds the 16 bytes read; the loads need no alignment.
    let (known, old) = unsafe {
        (
            _mm_loadu_si128(weights.as_ptr().cast()),
            _mm_loadu_si128(distances.as_ptr().cast()),
        )
    };
    let known = _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(known));
    let old = _mm256_cvtepi32_ps(_mm256_cvtepi16_epi32(old));
    let zero = _mm256_setzero_si256();
    let seen = _mm256_and_si256(_mm256_srli_epi32::<16>(s.pixel), _mm256_set1_epi32(0xff));
    let is_seen = _mm256_castsi256_ps(_mm256_cmpgt_epi32(seen, zero));
    let before_end = _mm256_cmp_ps::<_CMP_LE_OQ>(s.distance, c.truncation);
    let band = _mm256_and_ps(_mm256_and_ps(s.near, before_end), is_seen);
    let gap = _mm256_srli_epi32::<24>(s.pixel);
    let has_gap = _mm256_cmpgt_epi32(_mm256_set1_epi32(NO_GAP as i32), gap);
    let gap = _mm256_mul_ps(_mm256_cvtepi32_ps(gap), _mm256_set1_ps(GAP));
    let surely = _mm256_sub_ps(s.distance, gap);
    let inside = _mm256_and_ps(
        _mm256_cmp_ps::<_CMP_GT_OQ>(known, _mm256_setzero_ps()),
        _mm256_cmp_ps::<_CMP_LT_OQ>(old, _mm256_setzero_ps()),
    );
    let through = _mm256_and_ps(
        _mm256_cmp_ps::<_CMP_GT_OQ>(surely, c.truncation),
        _mm256_and_ps(_mm256_castsi256_ps(has_gap), s.near),
    );
    let learns = _mm256_or_ps(band, _mm256_and_ps(through, inside));
    let full = _mm256_set1_ps(FULL);
    let empty = _mm256_and_ps(
        _mm256_and_ps(
            through,
            _mm256_cmp_ps::<_CMP_EQ_OQ>(known, _mm256_setzero_ps()),
        ),
        _mm256_cmp_ps::<_CMP_LT_OQ>(old, full),
    );
    let old = _mm256_blendv_ps(old, full, empty);
    if _mm256_movemask_ps(empty) != 0 {
        store_distances(old, block, start);
    }
    (_mm256_movemask_ps(learns) != 0).then_some(Lanes {
        band,
        learns,
        seen,
        known,
        old,
    })
}

#[inline]
#[target_feature(enable = "avx2")]
fn store_distances(distances: __m256, block: &mut Block, start: usize) {
    let new = _mm256_cvtps_epi32(distances);
    let window = &mut block.distance[start..start + SIDE];
    let (low, high) = (
        _mm256_castsi256_si128(new),
        _mm256_extracti128_si256::<1>(new),
    );
    // SAFETY: the window holds the 16 bytes written; the store needs no alignment.
    unsafe { _mm_storeu_si128(window.as_mut_ptr().cast(), _mm_packs_epi32(low, high)) };
}

struct Learnt {
    mix: __m256,
    /// Voxels that changed from inside a surface to free.
    freed: __m256,
}

#[inline]
#[target_feature(enable = "avx2")]
fn average(c: &Constants, s: &Seen, lanes: &Lanes, block: &mut Block, start: usize) -> Learnt {
    const NEAREST: i32 = _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC;
    let one = _mm256_set1_ps(1.0);
    let behind = _mm256_add_ps(s.distance, c.truncation);
    let behind = _mm256_mul_ps(behind, c.fall);
    let behind = _mm256_min_ps(behind, one);
    let weight = _mm256_mul_ps(_mm256_cvtepi32_ps(lanes.seen), behind);
    let weight = _mm256_max_ps(_mm256_round_ps::<NEAREST>(weight), one);
    let weight = _mm256_blendv_ps(c.clear, weight, lanes.band);
    let most = _mm256_mul_ps(_mm256_set1_ps(SEEN_THROUGH), c.clear);
    let before = _mm256_min_ps(lanes.known, most);
    let before = _mm256_blendv_ps(before, lanes.known, lanes.band);
    let target = _mm256_mul_ps(s.distance, c.scale);
    let target = _mm256_blendv_ps(_mm256_set1_ps(FULL), target, lanes.band);
    let total = _mm256_add_ps(before, weight);
    let sum = _mm256_add_ps(
        _mm256_mul_ps(lanes.old, before),
        _mm256_mul_ps(target, weight),
    );
    let mean = _mm256_round_ps::<NEAREST>(_mm256_div_ps(sum, total));
    let outside = _mm256_cmp_ps::<_CMP_GE_OQ>(mean, _mm256_setzero_ps());
    let freed = _mm256_andnot_ps(lanes.band, _mm256_and_ps(outside, lanes.learns));
    let mean = _mm256_blendv_ps(mean, _mm256_set1_ps(FULL), freed);
    store_distances(
        _mm256_blendv_ps(lanes.old, mean, lanes.learns),
        block,
        start,
    );
    let capped = _mm256_min_ps(total, _mm256_set1_ps(MOST_WEIGHT));
    let capped = _mm256_blendv_ps(capped, c.clear, freed);
    let new = _mm256_cvttps_epi32(_mm256_blendv_ps(lanes.known, capped, lanes.learns));
    let (low, high) = (
        _mm256_castsi256_si128(new),
        _mm256_extracti128_si256::<1>(new),
    );
    let window = &mut block.weight[start..start + SIDE];
    // SAFETY: the window holds the 16 bytes written; the store needs no alignment.
    unsafe { _mm_storeu_si128(window.as_mut_ptr().cast(), _mm_packus_epi32(low, high)) };
    let mix = _mm256_max_ps(_mm256_div_ps(weight, total), _mm256_set1_ps(LEAST_MIX));
    Learnt { mix, freed }
}

/// Updates colours and counts of a row.
///
/// # Safety
/// `sight.colours` has one entry for every `COLOUR_PX` pixels.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn paint(sight: &Sight<'_>, s: &Seen, lanes: &Lanes, learnt: &Learnt, colours: &mut [u32]) {
    let window = &mut colours[..SIDE];
    // SAFETY: the window holds the 32 bytes read; the load needs no alignment.
    let old = unsafe { _mm256_loadu_si256(window.as_ptr().cast()) };
    let magnitude = _mm256_andnot_ps(_mm256_set1_ps(-0.0), s.distance);
    let close = _mm256_cmp_ps::<_CMP_LE_OQ>(magnitude, _mm256_set1_ps(sight.rule.coloured));
    let coloured = _mm256_and_ps(lanes.band, close);
    let mut paint = _mm256_and_si256(old, _mm256_set1_epi32(0xff_ffff));
    if _mm256_movemask_ps(coloured) != 0 {
        let row = _mm256_mullo_epi32(
            _mm256_srli_epi32::<2>(s.v),
            _mm256_set1_epi32(sight.colour_width as i32),
        );
        let at = _mm256_add_epi32(row, _mm256_srli_epi32::<2>(s.u));
        // SAFETY: coloured lanes are inside of the image, and a fourth of both coordinates inside of the colours.
        let new = unsafe {
            _mm256_mask_i32gather_epi32::<4>(
                _mm256_setzero_si256(),
                sight.colours.as_ptr().cast(),
                at,
                _mm256_castps_si256(coloured),
            )
        };
        let bare = _mm256_cmpeq_epi32(paint, _mm256_setzero_si256());
        let mix = _mm256_blendv_ps(learnt.mix, _mm256_set1_ps(1.0), _mm256_castsi256_ps(bare));
        let mixed = mixed(paint, new, mix);
        paint = _mm256_blendv_epi8(paint, mixed, _mm256_castps_si256(coloured));
    }
    let (count, one) = (_mm256_srli_epi32::<24>(old), _mm256_set1_epi32(1));
    let up = _mm256_min_epi32(_mm256_add_epi32(count, one), _mm256_set1_epi32(255));
    let down = _mm256_max_epi32(_mm256_sub_epi32(count, one), one);
    let count = _mm256_blendv_epi8(down, up, _mm256_castps_si256(lanes.band));
    let count = _mm256_andnot_si256(_mm256_castps_si256(learnt.freed), count);
    let new = _mm256_or_si256(paint, _mm256_slli_epi32::<24>(count));
    let new = _mm256_blendv_epi8(old, new, _mm256_castps_si256(lanes.learns));
    // SAFETY: the window holds the 32 bytes written; the store needs no alignment.
    unsafe { _mm256_storeu_si256(window.as_mut_ptr().cast(), new) };
}

const _: () = assert!(COLOUR_PX == 4, "coordinates are shifted by two bits");

#[inline]
#[target_feature(enable = "avx2")]
fn mixed(old: __m256i, new: __m256i, mix: __m256) -> __m256i {
    let low = _mm256_set1_epi32(255);
    let channel = |a: __m256i, b: __m256i| {
        let a = _mm256_cvtepi32_ps(_mm256_and_si256(a, low));
        let b = _mm256_cvtepi32_ps(_mm256_and_si256(b, low));
        let way = _mm256_mul_ps(_mm256_sub_ps(b, a), mix);
        _mm256_cvtps_epi32(_mm256_add_ps(a, way))
    };
    let red = channel(old, new);
    let green = channel(_mm256_srli_epi32::<8>(old), _mm256_srli_epi32::<8>(new));
    let blue = channel(_mm256_srli_epi32::<16>(old), _mm256_srli_epi32::<16>(new));
    _mm256_or_si256(
        red,
        _mm256_or_si256(_mm256_slli_epi32::<8>(green), _mm256_slli_epi32::<16>(blue)),
    )
}
