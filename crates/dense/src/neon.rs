//! The NEON kernel, bit-identical to its scalar twin. The only unsafe code of the crate on 64-bit Arm.
//!
//! Rows of pixels need none: their portable code consists of branchless loops, which the compiler vectorises.
#![allow(unsafe_code)]

use std::arch::aarch64::*;

use crate::block::{Block, FULL, SIDE};
use crate::observation::{COLOUR_PX, PER_METRE};
use crate::pixels::{GAP, NO_GAP};
use crate::voxels::{LEAST_MIX, MOST_WEIGHT, NEAR, Placed, SEEN_THROUGH, Sight};
use stillpoint_imaging::Simd;

/// Voxels at a time: half a row.
const LANES: usize = 4;
const _: () = assert!(SIDE == 2 * LANES);

/// Panics on a machine without NEON. Called at every entry; free where the target implies NEON.
#[inline]
fn check() {
    assert!(Simd::Neon.has_neon(), "NEON kernel called without NEON");
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
    // SAFETY: `check` verified that the machine has NEON; the images have the size that the kernel assumes.
    unsafe { update_kernel(sight, placed, block) }
}

struct Constants {
    camera: [f32; 4],
    last_u: float32x4_t,
    last_v: float32x4_t,
    truncation: float32x4_t,
    minus_truncation: float32x4_t,
    clear: float32x4_t,
    fall: f32,
    scale: f32,
    /// Offsets from a row's first voxel to those of its halves, along each axis.
    steps: [[float32x4_t; 3]; 2],
}

#[inline]
#[target_feature(enable = "neon")]
fn constants(sight: &Sight<'_>, placed: &Placed) -> Constants {
    let numbers: [[f32; LANES]; 2] = [[0.0, 1.0, 2.0, 3.0], [4.0, 5.0, 6.0, 7.0]];
    Constants {
        camera: sight.camera,
        last_u: vdupq_n_f32((sight.width - 1) as f32),
        last_v: vdupq_n_f32((sight.height - 1) as f32),
        truncation: vdupq_n_f32(sight.rule.truncation),
        minus_truncation: vdupq_n_f32(-sight.rule.truncation),
        clear: vdupq_n_f32(placed.clear_weight),
        fall: sight.rule.fall,
        scale: sight.rule.scale,
        steps: numbers.map(|numbers| {
            // SAFETY: the array holds the 16 bytes read.
            let lanes = unsafe { vld1q_f32(numbers.as_ptr()) };
            placed.steps[0].map(|step| vmulq_n_f32(lanes, step))
        }),
    }
}

/// # Safety
/// `sight.pixels` has `width * height` entries and `sight.colours` one for every `COLOUR_PX` pixels of these.
#[target_feature(enable = "neon")]
unsafe fn update_kernel(sight: &Sight<'_>, placed: &Placed, block: &mut Block) -> bool {
    let c = constants(sight, placed);
    let mut any = false;
    for row in 0..SIDE * SIDE {
        let first = placed.row(row % SIDE, row / SIDE);
        for (half, steps) in c.steps.iter().enumerate() {
            let start = SIDE * row + LANES * half;
            // SAFETY: guaranteed by the caller.
            let Some(seen) = (unsafe { look(sight, &c, first, steps) }) else {
                continue;
            };
            let Some(lanes) = sort(&c, &seen, block, start) else {
                continue;
            };
            any = true;
            let learnt = average(&c, &seen, &lanes, block, start);
            let colours = &mut block.colour[start..start + LANES];
            // SAFETY: guaranteed by the caller.
            unsafe { paint(sight, &seen, &lanes, &learnt, colours) };
        }
    }
    any
}

#[inline]
#[target_feature(enable = "neon")]
fn any(mask: uint32x4_t) -> bool {
    vget_lane_u64::<0>(vreinterpret_u64_u16(vmovn_u32(mask))) != 0
}

/// The entries of a table at `at` where `mask` is set, 0 elsewhere.
///
/// # Safety
/// `table` has at least one entry, and one at each index whose mask is set.
#[inline]
#[target_feature(enable = "neon")]
unsafe fn gather(table: &[u32], at: uint32x4_t, mask: uint32x4_t) -> uint32x4_t {
    // Masked lanes read the first entry: four loads are cheaper than a mispredicted branch.
    let at = vandq_u32(at, mask);
    let entry = |i: u32| table.as_ptr().wrapping_add(i as usize);
    // SAFETY: the caller guarantees that all these entries exist.
    let found = unsafe {
        let found = vdupq_n_u32(*entry(vgetq_lane_u32::<0>(at)));
        let found = vld1q_lane_u32::<1>(entry(vgetq_lane_u32::<1>(at)), found);
        let found = vld1q_lane_u32::<2>(entry(vgetq_lane_u32::<2>(at)), found);
        vld1q_lane_u32::<3>(entry(vgetq_lane_u32::<3>(at)), found)
    };
    vandq_u32(found, mask)
}

struct Seen {
    u: uint32x4_t,
    v: uint32x4_t,
    pixel: uint32x4_t,
    /// Mask of voxels with a measured pixel and at most the truncation behind its surface.
    near: uint32x4_t,
    distance: float32x4_t,
}

/// # Safety
/// `sight.pixels` has `width * height` entries.
#[inline]
#[target_feature(enable = "neon")]
unsafe fn look(
    sight: &Sight<'_>,
    c: &Constants,
    first: [f32; 3],
    steps: &[float32x4_t; 3],
) -> Option<Seen> {
    let zero = vdupq_n_f32(0.0);
    let [fx, fy, cx, cy] = c.camera;
    let px = vaddq_f32(vdupq_n_f32(first[0]), steps[0]);
    let py = vaddq_f32(vdupq_n_f32(first[1]), steps[1]);
    let pz = vaddq_f32(vdupq_n_f32(first[2]), steps[2]);
    let over_z = vdivq_f32(vdupq_n_f32(1.0), pz);
    let u = vaddq_f32(vmulq_n_f32(vmulq_f32(px, over_z), fx), vdupq_n_f32(cx));
    let v = vaddq_f32(vmulq_n_f32(vmulq_f32(py, over_z), fy), vdupq_n_f32(cy));
    let (u, v) = (vrndnq_f32(u), vrndnq_f32(v));
    let in_u = vandq_u32(vcgeq_f32(u, zero), vcleq_f32(u, c.last_u));
    let in_v = vandq_u32(vcgeq_f32(v, zero), vcleq_f32(v, c.last_v));
    let ahead = vcgeq_f32(pz, vdupq_n_f32(NEAR));
    let inside = vandq_u32(vandq_u32(in_u, in_v), ahead);
    if !any(inside) {
        return None;
    }
    let (u, v) = (vcvtq_u32_f32(u), vcvtq_u32_f32(v));
    let at = vmlaq_n_u32(u, v, sight.width as u32);
    // SAFETY: some lane is inside of the image, so that it has a pixel; lanes inside are below `width * height`.
    let pixel = unsafe { gather(sight.pixels, at, inside) };
    let depth = vandq_u32(pixel, vdupq_n_u32(0xffff));
    let metres = vmulq_n_f32(vcvtq_f32_u32(depth), 1.0 / PER_METRE);
    let distance = vsubq_f32(metres, pz);
    // Masked lanes have a pixel of zero.
    let measured = vtstq_u32(depth, depth);
    let near = vandq_u32(vcgeq_f32(distance, c.minus_truncation), measured);
    any(near).then_some(Seen {
        u,
        v,
        pixel,
        near,
        distance,
    })
}

struct Lanes {
    /// Near a surface.
    band: uint32x4_t,
    /// Near a surface, or seen through.
    learns: uint32x4_t,
    seen: uint32x4_t,
    known: float32x4_t,
    old: float32x4_t,
}

#[inline]
#[target_feature(enable = "neon")]
fn sort(c: &Constants, s: &Seen, block: &mut Block, start: usize) -> Option<Lanes> {
    let (weights, distances) = (
        &block.weight[start..start + LANES],
        &block.distance[start..start + LANES],
    );
    // SAFETY: each window holds the 8 bytes read.
    let (known, old) = unsafe { (vld1_u16(weights.as_ptr()), vld1_s16(distances.as_ptr())) };
    let known = vcvtq_f32_u32(vmovl_u16(known));
    let old = vcvtq_f32_s32(vmovl_s16(old));
    let zero = vdupq_n_f32(0.0);
    let seen = vandq_u32(vshrq_n_u32::<16>(s.pixel), vdupq_n_u32(0xff));
    let before_end = vcleq_f32(s.distance, c.truncation);
    let band = vandq_u32(vandq_u32(s.near, before_end), vtstq_u32(seen, seen));
    let gap = vshrq_n_u32::<24>(s.pixel);
    let has_gap = vcltq_u32(gap, vdupq_n_u32(NO_GAP));
    let surely = vsubq_f32(s.distance, vmulq_n_f32(vcvtq_f32_u32(gap), GAP));
    let inside = vandq_u32(vcgtq_f32(known, zero), vcltq_f32(old, zero));
    let through = vandq_u32(vcgtq_f32(surely, c.truncation), vandq_u32(has_gap, s.near));
    let learns = vorrq_u32(band, vandq_u32(through, inside));
    let full = vdupq_n_f32(FULL);
    let empty = vandq_u32(
        vandq_u32(through, vceqq_f32(known, zero)),
        vcltq_f32(old, full),
    );
    let old = vbslq_f32(empty, full, old);
    if any(empty) {
        store_distances(old, block, start);
    }
    any(learns).then_some(Lanes {
        band,
        learns,
        seen,
        known,
        old,
    })
}

#[inline]
#[target_feature(enable = "neon")]
fn store_distances(distances: float32x4_t, block: &mut Block, start: usize) {
    let new = vqmovn_s32(vcvtq_s32_f32(distances));
    let window = &mut block.distance[start..start + LANES];
    // SAFETY: the window holds the 8 bytes written.
    unsafe { vst1_s16(window.as_mut_ptr(), new) };
}

struct Learnt {
    mix: float32x4_t,
    /// Voxels that changed from inside a surface to free.
    freed: uint32x4_t,
}

#[inline]
#[target_feature(enable = "neon")]
fn average(c: &Constants, s: &Seen, lanes: &Lanes, block: &mut Block, start: usize) -> Learnt {
    let one = vdupq_n_f32(1.0);
    let behind = vmulq_n_f32(vaddq_f32(s.distance, c.truncation), c.fall);
    let weight = vmulq_f32(vcvtq_f32_u32(lanes.seen), vminnmq_f32(behind, one));
    let weight = vmaxnmq_f32(vrndnq_f32(weight), one);
    let weight = vbslq_f32(lanes.band, weight, c.clear);
    let before = vminnmq_f32(lanes.known, vmulq_n_f32(c.clear, SEEN_THROUGH));
    let before = vbslq_f32(lanes.band, lanes.known, before);
    let target = vmulq_n_f32(s.distance, c.scale);
    let target = vbslq_f32(lanes.band, target, vdupq_n_f32(FULL));
    let total = vaddq_f32(before, weight);
    let sum = vaddq_f32(vmulq_f32(lanes.old, before), vmulq_f32(target, weight));
    let mean = vrndnq_f32(vdivq_f32(sum, total));
    let outside = vcgeq_f32(mean, vdupq_n_f32(0.0));
    let freed = vbicq_u32(vandq_u32(outside, lanes.learns), lanes.band);
    let mean = vbslq_f32(freed, vdupq_n_f32(FULL), mean);
    store_distances(vbslq_f32(lanes.learns, mean, lanes.old), block, start);
    let capped = vminnmq_f32(total, vdupq_n_f32(MOST_WEIGHT));
    let capped = vbslq_f32(freed, c.clear, capped);
    // The conversion truncates.
    let new = vqmovn_u32(vcvtq_u32_f32(vbslq_f32(lanes.learns, capped, lanes.known)));
    let window = &mut block.weight[start..start + LANES];
    // SAFETY: the window holds the 8 bytes written.
    unsafe { vst1_u16(window.as_mut_ptr(), new) };
    let mix = vmaxnmq_f32(vdivq_f32(weight, total), vdupq_n_f32(LEAST_MIX));
    Learnt { mix, freed }
}

/// Updates colours and counts.
///
/// # Safety
/// `sight.colours` has one entry for every `COLOUR_PX` pixels.
#[inline]
#[target_feature(enable = "neon")]
unsafe fn paint(sight: &Sight<'_>, s: &Seen, lanes: &Lanes, learnt: &Learnt, colours: &mut [u32]) {
    let window = &mut colours[..LANES];
    // SAFETY: the window holds the 16 bytes read.
    let old = unsafe { vld1q_u32(window.as_ptr()) };
    let close = vcleq_f32(vabsq_f32(s.distance), vdupq_n_f32(sight.rule.coloured));
    let coloured = vandq_u32(lanes.band, close);
    let mut paint = vandq_u32(old, vdupq_n_u32(0xff_ffff));
    if any(coloured) {
        let (u, v) = (vshrq_n_u32::<2>(s.u), vshrq_n_u32::<2>(s.v));
        let at = vmlaq_n_u32(u, v, sight.colour_width as u32);
        // SAFETY: coloured lanes are inside of the image, and a fourth of both coordinates inside of the colours; there is such a lane.
        let new = unsafe { gather(sight.colours, at, coloured) };
        let bare = vceqzq_u32(paint);
        let mix = vbslq_f32(bare, vdupq_n_f32(1.0), learnt.mix);
        paint = vbslq_u32(coloured, mixed(paint, new, mix), paint);
    }
    let (count, one) = (vshrq_n_u32::<24>(old), vdupq_n_u32(1));
    let up = vminq_u32(vaddq_u32(count, one), vdupq_n_u32(255));
    let down = vmaxq_u32(vqsubq_u32(count, one), one);
    let count = vbicq_u32(vbslq_u32(lanes.band, up, down), learnt.freed);
    let new = vorrq_u32(paint, vshlq_n_u32::<24>(count));
    let new = vbslq_u32(lanes.learns, new, old);
    // SAFETY: the window holds the 16 bytes written.
    unsafe { vst1q_u32(window.as_mut_ptr(), new) };
}

const _: () = assert!(COLOUR_PX == 4, "coordinates are shifted by two bits");

#[inline]
#[target_feature(enable = "neon")]
fn mixed(old: uint32x4_t, new: uint32x4_t, mix: float32x4_t) -> uint32x4_t {
    let low = vdupq_n_u32(255);
    let channel = |a: uint32x4_t, b: uint32x4_t| {
        let a = vcvtq_f32_u32(vandq_u32(a, low));
        let b = vcvtq_f32_u32(vandq_u32(b, low));
        let way = vmulq_f32(vsubq_f32(b, a), mix);
        // The conversion rounds halves to even.
        vcvtnq_u32_f32(vaddq_f32(a, way))
    };
    let red = channel(old, new);
    let green = channel(vshrq_n_u32::<8>(old), vshrq_n_u32::<8>(new));
    let blue = channel(vshrq_n_u32::<16>(old), vshrq_n_u32::<16>(new));
    vorrq_u32(
        red,
        vorrq_u32(vshlq_n_u32::<8>(green), vshlq_n_u32::<16>(blue)),
    )
}
