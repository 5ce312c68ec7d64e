//! Per-pixel data for updating the voxels along a ray: depth, weight, and the extent of certain free space.

use crate::observation::{Observation, PER_METRE};
use stillpoint_geometry::{Camera, Vec3};
use stillpoint_imaging::Simd;

/// Unit of a pixel's free space gap, m.
pub(crate) const GAP: f32 = 0.008;
/// Marks unknown free space.
pub(crate) const NO_GAP: u32 = 255;
/// Maximum weight of a surface observation.
pub(crate) const BEST: f32 = 255.0;
/// Depth up to which observations have that weight, m.
const BEST_DEPTH: f32 = 0.8;
/// Minimum weight of a surface observation.
const LEAST: f32 = 4.0;
pub(crate) const TILE: usize = 16;

/// An observation in the layout that the voxel kernels use.
#[derive(Default)]
pub(crate) struct Pixels {
    /// Bits 0 to 15: depth in units of the observation. 16 to 23: weight, 0 for no surface. 24 to 31: difference to the nearest of the 3x3
    /// pixels around, in steps of [`GAP`], or [`NO_GAP`].
    pub(crate) pixels: Vec<u32>,
    /// Maximum depth of each tile, m; row by row, `tiles_across` in a row.
    pub(crate) farthest: Vec<f32>,
    pub(crate) tiles_across: usize,
    /// Minimum and maximum depth of the surfaces; `None` without any, m.
    pub(crate) range: Option<[f32; 2]>,
    /// Row buffers: minimum depth around each pixel, and its orientation factor.
    nearest: Vec<u16>,
    facing: Vec<f32>,
}

/// Standard deviation of a depth, m: Nguyen, Izadi, Lovell, 3DIMPVT 2012.
#[inline(always)]
fn sigma(z: f32) -> f32 {
    let d = z - 0.4;
    0.0012 + 0.0019 * d * d
}

/// The weight of a depth, by its variance.
pub(crate) fn weight_at(z: f32) -> f32 {
    let ratio = sigma(BEST_DEPTH) / sigma(z.max(BEST_DEPTH));
    (BEST * ratio * ratio).max(LEAST)
}

pub(crate) struct Row<'a> {
    /// Depths of the row above, the row, and the row below.
    pub(crate) depths: [&'a [u16]; 3],
    /// fx, fy, cx, and y - cy.
    pub(crate) camera: [f32; 4],
    pub(crate) limit: u16,
    pub(crate) trust: f32,
}

pub(crate) struct RowOut<'a> {
    pub(crate) pixels: &'a mut [u32],
    pub(crate) nearest: &'a mut [u16],
    pub(crate) facing: &'a mut [f32],
    pub(crate) farthest: &'a mut [f32],
}

impl Pixels {
    /// Converts an observation. Surfaces are limited to `max_depth`, m.
    pub(crate) fn fill(&mut self, o: &Observation, camera: &Camera, max_depth: f32, simd: Simd) {
        let (w, h) = (o.width, o.height);
        let across = w.div_ceil(TILE);
        self.tiles_across = across;
        self.farthest.clear();
        self.farthest.resize(across * h.div_ceil(TILE), 0.0);
        self.pixels.resize(w * h, 0);
        self.facing.resize(w, 0.0);
        self.nearest.resize(w, 0);
        let (mut least, mut most) = (u16::MAX, 0);
        let depths = |y: usize| &o.depth[y * w..(y + 1) * w];
        for y in 0..h {
            let row = Row {
                depths: [
                    depths(y.saturating_sub(1)),
                    depths(y),
                    depths((y + 1).min(h - 1)),
                ],
                camera: [
                    camera.fx as f32,
                    camera.fy as f32,
                    camera.cx as f32,
                    y as f32 - camera.cy as f32,
                ],
                limit: (max_depth * PER_METRE) as u16,
                trust: 1.0 / f32::from(o.doubt.max(1)),
            };
            let mut out = RowOut {
                pixels: &mut self.pixels[y * w..(y + 1) * w],
                nearest: &mut self.nearest,
                facing: &mut self.facing,
                farthest: &mut self.farthest[y / TILE * across..][..across],
            };
            let range = fill_row(&row, &mut out, simd);
            (least, most) = (least.min(range[0]), most.max(range[1]));
        }
        let metres = |z: u16| f32::from(z) / PER_METRE;
        self.range = (most > 0).then(|| [metres(least), metres(most)]);
    }
}

impl Pixels {
    /// Length of the certainly free space along the ray of a point in camera coordinates, m; `None` outside of the image or if unknown.
    pub(crate) fn free_to(&self, camera: &Camera, width: usize, p: &Vec3) -> Option<f64> {
        let px = camera.project(p);
        if p.z <= 0.0 || !camera.contains(px) {
            return None;
        }
        let (x, y) = (
            (px.x + 0.5).max(0.0) as usize,
            (px.y + 0.5).max(0.0) as usize,
        );
        let pixel = *self.pixels.get(y * width + x.min(width - 1))?;
        let (depth, gap) = (pixel & 0xffff, pixel >> 24);
        let free = f64::from(depth) / f64::from(PER_METRE) - f64::from(gap) * f64::from(GAP);
        (depth > 0 && gap != NO_GAP).then_some(free)
    }
}

/// Converts a row of pixels; returns the minimum and maximum depth of its surfaces.
fn fill_row(row: &Row<'_>, out: &mut RowOut<'_>, simd: Simd) -> [u16; 2] {
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::fill_row(row, out);
    }
    let _ = simd;
    fill_row_scalar(row, out)
}

/// Portable code, which the compiler vectorises.
#[inline(always)]
pub(crate) fn fill_row_scalar(row: &Row<'_>, out: &mut RowOut<'_>) -> [u16; 2] {
    nearest(row, out.nearest);
    facing(row, out.facing);
    let here = row.depths[1];
    let w = here.len();
    for (tile, depths) in out.farthest.iter_mut().zip(here.chunks(TILE)) {
        let most = depths.iter().fold(0, |m: u16, z| m.max(*z));
        *tile = tile.max(f32::from(most) / PER_METRE);
    }
    let (pixels, nearest, facing) = (&mut out.pixels[..w], &out.nearest[..w], &out.facing[..w]);
    let best = sigma(BEST_DEPTH) * sigma(BEST_DEPTH) * BEST;
    for i in 0..w {
        let z = here[i];
        let s = sigma((f32::from(z) * (1.0 / PER_METRE)).max(BEST_DEPTH));
        let weight = (best / (s * s)).max(LEAST) * facing[i] * row.trust;
        let weight = ((weight + 0.5) as i32).max(1) as u32;
        let weight = if z <= row.limit { weight } else { 0 };
        let pixel = u32::from(z) | weight << 16 | gap(z, nearest[i]) << 24;
        pixels[i] = if z == 0 { 0 } else { pixel };
    }
    let mut range = [u16::MAX, 0];
    for z in here {
        let counts = (*z > 0) & (*z <= row.limit);
        range[0] = range[0].min(if counts { *z } else { u16::MAX });
        range[1] = range[1].max(if counts { *z } else { 0 });
    }
    range
}

const STEP: u32 = (GAP * PER_METRE) as u32;
const _: () = assert!(STEP == 40, "the division by it is written out");

/// The gap between a pixel and the nearest around it, rounded up to be conservative.
#[inline(always)]
fn gap(z: u16, nearest: u16) -> u32 {
    let difference = u32::from(z.wrapping_sub(nearest));
    // Division by 40.
    let steps = ((difference + STEP - 1) * 52_429) >> 21;
    if nearest == 0 {
        NO_GAP
    } else {
        steps.min(NO_GAP)
    }
}

/// The minimum of the 3x3 depths around each pixel; 0 if any is missing.
#[inline(always)]
fn nearest(row: &Row<'_>, out: &mut [u16]) {
    let w = out.len();
    let [a, b, c] = row.depths.map(|d| &d[..w]);
    let down = |x: usize| a[x].min(b[x]).min(c[x]);
    for x in [0, w - 1] {
        let beside = down(x.saturating_sub(1)).min(down((x + 1).min(w - 1)));
        out[x] = down(x).min(beside);
    }
    if w < 3 {
        return;
    }
    // Slices of equal length remove bounds checks, so that the loop vectorises.
    let n = w - 2;
    let [a, b, c] = row.depths.map(|d| [&d[..n], &d[1..][..n], &d[2..][..n]]);
    for (i, out) in out[1..][..n].iter_mut().enumerate() {
        let across = |d: &[&[u16]; 3]| d[0][i].min(d[1][i]).min(d[2][i]);
        *out = across(&a).min(across(&b)).min(across(&c));
    }
}

/// Distance to both sides over which the slope of a surface is measured, px.
const REACH: usize = 2;

/// How much each pixel's surface faces the camera, from 0.25 to 1; 0.25 at depth steps, where a camera mixes foreground and background.
///
/// The cosine between the surface normal and the ray: with depth z, slopes p and q of depth per pixel, the normal is `(-fx p, -fy q, z +
/// (u - cx) p + (v - cy) q)`, and the cosine `z / (|ray| |normal|)`.
#[inline(always)]
fn facing(row: &Row<'_>, out: &mut [f32]) {
    let w = out.len();
    let [above, here, below] = row.depths.map(|d| &d[..w]);
    let [fx, fy, cx, v] = row.camera;
    let (over_fx, over_fy) = (1.0 / fx, 1.0 / fy);
    out[..REACH.min(w)].fill(0.25);
    out[w.saturating_sub(REACH)..].fill(0.25);
    if w <= 2 * REACH {
        return;
    }
    let n = w - 2 * REACH;
    let (left, right) = (&here[..n], &here[2 * REACH..]);
    let (above, mid, below) = (
        &above[REACH..][..n],
        &here[REACH..][..n],
        &below[REACH..][..n],
    );
    let out = &mut out[REACH..][..n];
    for i in 0..n {
        let z = f32::from(mid[i]);
        let (l, r) = (f32::from(left[i]), f32::from(right[i]));
        let (a, b) = (f32::from(above[i]), f32::from(below[i]));
        let p = (r - l) * (0.5 / REACH as f32);
        let q = (b - a) * 0.5;
        let u = (i + REACH) as f32 - cx;
        let (nx, ny, nz) = (fx * p, fy * q, z + u * p + v * q);
        let (rx, ry) = (u * over_fx, v * over_fy);
        let square = (nx * nx + ny * ny + nz * nz) * (rx * rx + ry * ry + 1.0);
        let cosine = z / square.max(1.0).sqrt();
        // A missing depth is 0, and so counts as a step.
        let step = 0.03 * z + 0.02 * PER_METRE;
        let smooth = ((l + r - 2.0 * z).abs() < step) & ((a + b - 2.0 * z).abs() < step);
        let cosine = cosine.clamp(0.25, 1.0);
        out[i] = if smooth { cosine } else { 0.25 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(depth: impl Fn(usize, usize) -> f32) -> (Observation, Pixels) {
        let (w, h) = (64, 48);
        let camera = Camera::pinhole(w as u32, h as u32, [60.0, 60.0, 31.5, 23.5]);
        let of = |i: usize| crate::observation::units(depth(i % w, i / w));
        let o = Observation {
            width: w,
            height: h,
            depth: (0..w * h).map(of).collect(),
            depth_stamp: 0.0,
            doubt: 1,
            ..Observation::default()
        };
        let mut pixels = Pixels::default();
        pixels.fill(&o, &camera, 4.0, Simd::detect());
        let mut scalar = Pixels::default();
        scalar.fill(&o, &camera, 4.0, Simd::Scalar);
        assert_eq!(pixels.pixels, scalar.pixels);
        (o, pixels)
    }

    fn weight(p: &Pixels, x: usize, y: usize) -> u32 {
        p.pixels[y * 64 + x] >> 16 & 255
    }

    #[test]
    fn near_frontal_surfaces_weigh_most() {
        let flat = |z: f32| weight(&seen(|_, _| z).1, 32, 24);
        assert!(flat(0.7) > 250 && flat(0.7) > 4 * flat(2.0) && flat(2.0) > 2 * flat(3.5));
        assert_eq!(flat(5.0), 0);
        // A wall that recedes by 1.7 m per m, seen at 60 degrees.
        let slope = |x: usize| 1.0 / (1.0 - 1.732 * (x as f32 - 31.5) / 60.0);
        let oblique = weight(&seen(|x, _| if x < 52 { slope(x) } else { 0.0 }).1, 32, 24);
        let expected = 0.5 * weight_at(1.0);
        assert!((oblique as f32 / expected - 1.0).abs() < 0.1, "{oblique}");
    }

    #[test]
    fn free_space_gaps_are_rounded_up() {
        for d in 0..=30_000_u16 {
            let steps = u32::from(d).div_ceil(40).min(NO_GAP);
            assert_eq!(gap(30_001, 30_001 - d), steps);
        }
        assert_eq!(gap(500, 0), NO_GAP);
    }

    #[test]
    fn free_space_ends_at_the_nearest_neighbour() {
        let (_, p) = seen(|x, y| match (x, y) {
            (30, 20) => 1.0,
            (50, 30) => 0.0,
            _ => 1.5,
        });
        let gap = |x: usize, y: usize| p.pixels[y * 64 + x] >> 24;
        assert_eq!((gap(10, 10), gap(31, 21), gap(32, 21)), (0, 63, 0));
        assert_eq!((gap(49, 30), gap(48, 30)), (NO_GAP, 0));
        assert_eq!(p.range, Some([1.0, 1.5]));
        assert_eq!(p.farthest[0], 1.5);
    }
}
