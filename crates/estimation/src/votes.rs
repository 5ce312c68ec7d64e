//! The kernel of the weighted vote on a camera motion.

use crate::Intrinsics;
use crate::camera_motion::{MotionPair, believed};
use stillpoint_geometry::Se3;

/// Pairs that go through the kernel together.
const LANES: usize = 4;

/// Blocks between two looks at whether a motion can still win.
const BLOCKS_PER_LOOK: usize = 8;

/// [`LANES`] pairs: points (m), pixels relative to the principal point (px), inverse depths (1/m), and weights of the squared
/// residuals divided by the gate.
#[derive(Clone, Copy, Default)]
struct Block {
    x: [f64; LANES],
    y: [f64; LANES],
    z: [f64; LANES],
    u: [f64; LANES],
    v: [f64; LANES],
    d: [f64; LANES],
    pixel: [f64; LANES],
    depth: [f64; LANES],
    vote: [f64; LANES],
}

/// The pairs in the order and layout in which they vote.
pub(crate) struct Votes {
    blocks: Vec<Block>,
    /// Votes that are still to come before each look.
    remaining: Vec<f64>,
    focal: [f64; 2],
}

impl Votes {
    pub(crate) fn new(camera: &Intrinsics, pairs: &[MotionPair], gate_scale: f64) -> Self {
        let voters: Vec<&MotionPair> = pairs.iter().filter(|p| believed(p) > 0.0).collect();
        let blocks: Vec<Block> = voters
            .chunks(LANES)
            .map(|chunk| {
                let mut b = Block::default();
                for (i, p) in chunk.iter().enumerate() {
                    let m = &p.measurement;
                    let gate = 1.0 / (m.gate() * gate_scale);
                    [b.x[i], b.y[i], b.z[i]] = [p.point.x, p.point.y, p.point.z];
                    [b.u[i], b.v[i]] = [m.pixel.x - camera.cx, m.pixel.y - camera.cy];
                    b.d[i] = m.inverse_depth;
                    b.pixel[i] = m.pixel_weight * gate;
                    b.depth[i] = m.inverse_depth_weight * gate;
                    b.vote[i] = p.weight;
                }
                b
            })
            .collect();
        let mut rest = 0.0;
        let groups = blocks.chunks(BLOCKS_PER_LOOK);
        let mut remaining = vec![0.0; groups.len()];
        for (after, group) in remaining.iter_mut().zip(groups).rev() {
            *after = rest;
            rest += group.iter().flat_map(|b| b.vote).sum::<f64>();
        }
        Self {
            blocks,
            remaining,
            focal: [camera.fx, camera.fy],
        }
    }

    /// The sum over pairs of weight times `1 - chi2 / gate`, where positive; 0 as soon as it cannot exceed `limit`, which
    /// changes no decision.
    pub(crate) fn count(&self, b_from_a: &Se3, limit: f64) -> f64 {
        let motion = Motion::new(b_from_a);
        let (mut sums, mut total) = ([0.0; LANES], 0.0);
        for (group, remaining) in self.blocks.chunks(BLOCKS_PER_LOOK).zip(&self.remaining) {
            for block in group {
                let ratios = self.ratios(&motion, block);
                for ((sum, ratio), vote) in sums.iter_mut().zip(ratios).zip(block.vote) {
                    let agreement = 1.0 - ratio;
                    *sum += if agreement > 0.0 {
                        vote * agreement
                    } else {
                        0.0
                    };
                }
            }
            total = (sums[0] + sums[1]) + (sums[2] + sums[3]);
            if total + remaining <= limit {
                return 0.0;
            }
        }
        total
    }

    /// The weight of the pairs within their gates.
    pub(crate) fn inlier_weight(&self, b_from_a: &Se3) -> f64 {
        let motion = Motion::new(b_from_a);
        let mut weight = 0.0;
        for block in &self.blocks {
            for (ratio, vote) in self.ratios(&motion, block).into_iter().zip(block.vote) {
                weight += if ratio <= 1.0 { vote } else { 0.0 };
            }
        }
        weight
    }

    /// Squared residuals divided by their gates; infinite behind the camera.
    #[inline]
    fn ratios(&self, m: &Motion, b: &Block) -> [f64; LANES] {
        let ([fx, fy], r, t) = (self.focal, &m.r, &m.t);
        std::array::from_fn(|i| {
            let (x, y, z) = (b.x[i], b.y[i], b.z[i]);
            let pz = r[6] * x + r[7] * y + r[8] * z + t[2];
            let iz = 1.0 / pz;
            let eu = b.u[i] - fx * (r[0] * x + r[1] * y + r[2] * z + t[0]) * iz;
            let ev = b.v[i] - fy * (r[3] * x + r[4] * y + r[5] * z + t[1]) * iz;
            let ed = b.d[i] - iz;
            let ratio = b.pixel[i] * (eu * eu + ev * ev) + b.depth[i] * (ed * ed);
            if pz > 1e-3 { ratio } else { f64::INFINITY }
        })
    }
}

struct Motion {
    r: [f64; 9],
    t: [f64; 3],
}

impl Motion {
    fn new(pose: &Se3) -> Self {
        let (r, t) = (pose.rotation_matrix(), pose.translation);
        Self {
            r: std::array::from_fn(|i| r[(i / 3, i % 3)]),
            t: [t.x, t.y, t.z],
        }
    }
}
