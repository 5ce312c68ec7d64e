//! The kernel that updates the voxels of one block with one frame.

use crate::block::{Block, FULL, SIDE};
use crate::observation::{COLOUR_PX, PER_METRE};
use crate::pixels::{GAP, NO_GAP};
use stillpoint_imaging::Simd;

pub(crate) struct Sight<'a> {
    /// As in [`crate::pixels::Pixels`].
    pub(crate) pixels: &'a [u32],
    pub(crate) colours: &'a [u32],
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) colour_width: usize,
    /// fx, fy, cx, cy.
    pub(crate) camera: [f32; 4],
    pub(crate) rule: Rule,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Rule {
    /// m.
    pub(crate) truncation: f32,
    /// Stored distance units per metre.
    pub(crate) scale: f32,
    /// Slope of the weight behind a surface, per metre: from 1 at one voxel behind it to 0 at the truncation.
    pub(crate) fall: f32,
    /// Distance from a surface within which voxels take its colour, m.
    pub(crate) coloured: f32,
}

/// Minimum share of a new colour in the running mean.
pub(crate) const LEAST_MIX: f32 = 1.0 / 16.0;
/// Maximum weight of a voxel: 64 best frames, so that it still adapts.
pub(crate) const MOST_WEIGHT: f32 = 64.0 * 255.0;
/// Maximum weight of a voxel when it is seen through, in frames: however certain it was, it is removed after 12.
pub(crate) const SEEN_THROUGH: f32 = 16.0;
/// Minimum depth of a voxel before the camera, m.
pub(crate) const NEAR: f32 = 0.05;

impl Rule {
    pub(crate) fn new(voxel: f64, truncation: f64) -> Self {
        Self {
            truncation: truncation as f32,
            scale: FULL / truncation as f32,
            fall: (1.0 / (truncation - voxel)) as f32,
            coloured: (2.0 * voxel) as f32,
        }
    }
}

/// The pose of a block relative to the camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    /// Its first voxel in camera coordinates, m.
    pub(crate) first: [f32; 3],
    /// From a voxel to the next one along x, y and z.
    pub(crate) steps: [[f32; 3]; 3],
    /// Weight of a seen-through observation.
    pub(crate) clear_weight: f32,
}

impl Placed {
    #[inline(always)]
    pub(crate) fn row(&self, y: usize, z: usize) -> [f32; 3] {
        let (y, z) = (y as f32, z as f32);
        std::array::from_fn(|i| self.first[i] + self.steps[1][i] * y + self.steps[2][i] * z)
    }
}

/// Updates a block; returns whether any voxel was near a surface, or was inside of one and is seen through.
pub(crate) fn update(sight: &Sight<'_>, placed: &Placed, block: &mut Block, simd: Simd) -> bool {
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::update(sight, placed, block);
    }
    #[cfg(target_arch = "aarch64")]
    if simd.has_neon() {
        return crate::neon::update(sight, placed, block);
    }
    let _ = simd;
    update_scalar(sight, placed, block)
}

/// Twin of the vector kernel.
pub(crate) fn update_scalar(sight: &Sight<'_>, placed: &Placed, block: &mut Block) -> bool {
    let mut any = false;
    for z in 0..SIDE {
        for y in 0..SIDE {
            let row = placed.row(y, z);
            for x in 0..SIDE {
                let k = x as f32;
                let p: [f32; 3] = std::array::from_fn(|i| row[i] + placed.steps[0][i] * k);
                let index = (z * SIDE + y) * SIDE + x;
                any |= learn(sight, placed.clear_weight, p, index, block);
            }
        }
    }
    any
}

/// Updates one voxel, at `p` in camera coordinates. Projective distance and running mean: Curless, Levoy, SIGGRAPH 1996; Newcombe et al.,
/// ISMAR 2011. The weight behind the surface: Bylow et al., RSS 2013.
#[inline(always)]
fn learn(sight: &Sight<'_>, clear: f32, p: [f32; 3], index: usize, block: &mut Block) -> bool {
    let rule = &sight.rule;
    let [fx, fy, cx, cy] = sight.camera;
    let over_z = 1.0 / p[2];
    let u = ((p[0] * over_z) * fx + cx).round_ties_even();
    let v = ((p[1] * over_z) * fy + cy).round_ties_even();
    let (last_u, last_v) = ((sight.width - 1) as f32, (sight.height - 1) as f32);
    let in_image = p[2] >= NEAR && u >= 0.0 && v >= 0.0 && u <= last_u && v <= last_v;
    if !in_image {
        return false;
    }
    let (u, v) = (u as usize, v as usize);
    let pixel = sight.pixels[v * sight.width + u];
    let depth = (pixel & 0xffff) as f32 * (1.0 / PER_METRE);
    let distance = depth - p[2];
    let known = f32::from(block.weight[index]);
    let gap = pixel >> 24;
    let seen = pixel >> 16 & 0xff;
    let t = rule.truncation;
    let measured = pixel & 0xffff > 0;
    let is_band = seen > 0 && distance >= -t && distance <= t;
    let old = f32::from(block.distance[index]);
    // Seeing through does not affect voxels outside of a surface.
    let inside = known > 0.0 && old < 0.0;
    let through = measured && distance - gap as f32 * GAP > t && gap != NO_GAP;
    let clears = through && inside;
    if through && known == 0.0 {
        block.distance[index] = FULL as i16;
    }
    if !measured || !(is_band || clears) {
        return false;
    }
    let behind = ((distance + t) * rule.fall).min(1.0);
    let (before, weight, target) = if is_band {
        let weight = (seen as f32 * behind).round_ties_even().max(1.0);
        (known, weight, distance * rule.scale)
    } else {
        (known.min(SEEN_THROUGH * clear), clear, FULL)
    };
    let total = before + weight;
    let mean = ((old * before + target * weight) / total).round_ties_even();
    // A voxel that is no longer inside becomes free.
    let freed = !is_band && mean >= 0.0;
    block.distance[index] = if freed { FULL } else { mean } as i16;
    block.weight[index] = if freed { clear } else { total.min(MOST_WEIGHT) } as u16;
    let colour = block.colour[index];
    let mix = (weight / total).max(LEAST_MIX);
    let coloured = is_band && distance.abs() <= rule.coloured;
    let new = sight.colours[v / COLOUR_PX * sight.colour_width + u / COLOUR_PX];
    block.colour[index] = mixed(colour, new, mix, coloured) | counted(colour, is_band, freed) << 24;
    true
}

#[inline(always)]
fn mixed(old: u32, new: u32, mix: f32, coloured: bool) -> u32 {
    if !coloured {
        return old & 0xff_ffff;
    }
    // The first colour is taken unchanged.
    let mix = if old & 0xff_ffff == 0 { 1.0 } else { mix };
    let channel = |shift: u32| {
        let (a, b) = ((old >> shift & 255) as f32, (new >> shift & 255) as f32);
        ((a + (b - a) * mix).round_ties_even() as u32) << shift
    };
    channel(0) | channel(8) | channel(16)
}

#[inline(always)]
fn counted(colour: u32, is_band: bool, freed: bool) -> u32 {
    let count = colour >> 24;
    if freed {
        0
    } else if is_band {
        (count + 1).min(255)
    } else {
        count.saturating_sub(1).max(1)
    }
}
