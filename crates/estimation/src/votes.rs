//! The kernel of the weighted vote on a camera motion.

use crate::Intrinsics;
use crate::camera_motion::{MotionOptions, MotionPair, believed};
use crate::two_view::{BLOCKS_PER_LOOK, LANES};
use stillpoint_geometry::Se3;

/// [`LANES`] pairs: points (m), pixels relative to the principal point (px), inverse depths (1/m), edges, and weights of
/// the squared residuals divided by the gate.
#[derive(Clone, Copy, Debug, Default)]
struct Block {
    x: [f64; LANES],
    y: [f64; LANES],
    z: [f64; LANES],
    u: [f64; LANES],
    v: [f64; LANES],
    d: [f64; LANES],
    edge: [[f64; LANES]; 2],
    pixel: [f64; LANES],
    depth: [f64; LANES],
    vote: [f64; LANES],
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Votes {
    blocks: Vec<Block>,
    /// Remaining votes before each check.
    remaining: Vec<f64>,
    focal: [f64; 2],
    peak: f64,
}

impl Votes {
    /// Replaces the pairs by those with nonzero weight.
    pub(crate) fn rebuild(
        &mut self,
        camera: &Intrinsics,
        pairs: &[MotionPair],
        options: &MotionOptions,
    ) {
        self.focal = [camera.fx, camera.fy];
        self.peak = options.peak;
        self.blocks.clear();
        let voters = pairs.iter().filter(|p| believed(p) > 0.0);
        for (n, p) in voters.enumerate() {
            let i = n % LANES;
            if i == 0 {
                self.blocks.push(Block::default());
            }
            let Some(b) = self.blocks.last_mut() else {
                continue;
            };
            let m = &p.measurement;
            let gate = 1.0 / (m.gate() * options.gate_scale);
            [b.x[i], b.y[i], b.z[i]] = [p.point.x, p.point.y, p.point.z];
            [b.u[i], b.v[i]] = [m.pixel.x - camera.cx, m.pixel.y - camera.cy];
            b.d[i] = m.inverse_depth;
            [b.edge[0][i], b.edge[1][i]] = [m.edge.x, m.edge.y];
            b.pixel[i] = m.pixel_weight * gate;
            b.depth[i] = m.inverse_depth_weight * gate;
            b.vote[i] = p.weight;
        }
        let mut rest = 0.0;
        let groups = self.blocks.chunks(BLOCKS_PER_LOOK);
        self.remaining.clear();
        self.remaining.resize(groups.len(), 0.0);
        for (after, group) in self.remaining.iter_mut().zip(groups).rev() {
            *after = rest;
            rest += group.iter().flat_map(|b| b.vote).sum::<f64>();
        }
    }

    /// The sum over pairs of weight times `(1 - r) / (1 + peak r)` with `r = chi2 / gate`, where positive; 0 once it
    /// cannot exceed `limit`, which is exact.
    pub(crate) fn count(&self, b_from_a: &Se3, limit: f64) -> f64 {
        let motion = BlockMotion::new(b_from_a);
        let (mut sums, mut total) = ([0.0; LANES], 0.0);
        for (group, remaining) in self.blocks.chunks(BLOCKS_PER_LOOK).zip(&self.remaining) {
            for block in group {
                let ratios = self.ratios(&motion, block);
                for ((sum, ratio), vote) in sums.iter_mut().zip(ratios).zip(block.vote) {
                    let agreement = (1.0 - ratio) / (1.0 + self.peak * ratio);
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
        let motion = BlockMotion::new(b_from_a);
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
    fn ratios(&self, m: &BlockMotion, b: &Block) -> [f64; LANES] {
        let ([fx, fy], r, t) = (self.focal, &m.r, &m.t);
        std::array::from_fn(|i| {
            let (x, y, z) = (b.x[i], b.y[i], b.z[i]);
            let pz = r[6] * x + r[7] * y + r[8] * z + t[2];
            let iz = 1.0 / pz;
            let eu = b.u[i] - fx * (r[0] * x + r[1] * y + r[2] * z + t[0]) * iz;
            let ev = b.v[i] - fy * (r[3] * x + r[4] * y + r[5] * z + t[1]) * iz;
            let (ex, ey) = (b.edge[0][i], b.edge[1][i]);
            let along = ex * eu + ey * ev;
            let (eu, ev) = (eu - ex * along, ev - ey * along);
            let ed = b.d[i] - iz;
            let ratio = b.pixel[i] * (eu * eu + ev * ev) + b.depth[i] * (ed * ed);
            if pz > 1e-3 { ratio } else { f64::INFINITY }
        })
    }
}

struct BlockMotion {
    r: [f64; 9],
    t: [f64; 3],
}

impl BlockMotion {
    fn new(pose: &Se3) -> Self {
        let (r, t) = (pose.rotation_matrix(), pose.translation);
        Self {
            r: std::array::from_fn(|i| r[(i / 3, i % 3)]),
            t: [t.x, t.y, t.z],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Purpose, rng};
    use crate::{Measurement, MotionPair};
    use proptest::prelude::*;
    use stillpoint_geometry::{Vec2, Vec3, Vec6};

    const CAMERA: Intrinsics = Intrinsics {
        fx: 520.0,
        fy: 515.0,
        cx: 320.0,
        cy: 240.0,
    };

    proptest! {
        /// Compared with [`Measurement::chi2`]; early exit only happens for losing motions.
        #[test]
        fn vote_equals_the_weighted_chi2_sum(count in 0usize..90, seed in any::<u64>(), share in 0.0..1.5f64, scale in 0.5..3.0f64, peak in 0.0..80.0f64) {
            let random = &mut rng(seed, 0, Purpose(1000));
            let pairs: Vec<MotionPair> = (0..count)
                .map(|_| {
                    let z = 4.0 * random.unit() - 0.5;
                    let (x, y) = (random.unit() - 0.5, random.unit() - 0.5);
                    let pixel = Vec2::new(320.0 + 520.0 * x + 8.0 * random.unit(), 240.0 + 515.0 * y);
                    let depth = (z > 0.2 && random.unit() < 0.5).then_some((z * 1.01, 0.02));
                    MotionPair {
                        point: Vec3::new(x * z, y * z, z),
                        measurement: Measurement::new(pixel, 2.0, depth).on_edge(Vec2::new(0.9 * random.unit(), -0.4)),
                        weight: 2.0 * random.unit() - 0.3,
                    }
                })
                .collect();
            let pose = Se3::exp(&Vec6::new(0.01, 0.0, -0.02, 0.002, 0.001, 0.0));
            let (mut vote, mut weight) = (0.0, 0.0);
            for p in pairs.iter().filter(|p| p.weight > 0.0) {
                let m = &p.measurement;
                let ratio = m.chi2(&CAMERA, &pose.transform(&p.point)) / (m.gate() * scale);
                vote += p.weight * (1.0 - ratio).max(0.0) / (1.0 + peak * ratio);
                weight += if ratio <= 1.0 { p.weight } else { 0.0 };
            }
            let options = MotionOptions { gate_scale: scale, peak, ..MotionOptions::default() };
            let mut votes = Votes::default();
            votes.rebuild(&CAMERA, &pairs, &options);
            let all = votes.count(&pose, -1.0);
            prop_assert!((all - vote).abs() < 1e-9 * (1.0 + vote), "{all} {vote}");
            prop_assert!((votes.inlier_weight(&pose) - weight).abs() < 1e-9);
            let limited = votes.count(&pose, share * all);
            prop_assert_eq!(limited, if all > share * all { all } else { 0.0 });
        }
    }
}
