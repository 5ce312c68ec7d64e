//! RANSAC shared by fundamental matrix and homography.

use crate::sampling::{Rng, ransac_iterations};
use stillpoint_geometry::Mat3;

/// Undistorted pixels of the same point in the first and second image, px.
pub type PixelPair = ([f64; 2], [f64; 2]);

/// Effort and gate of the search for a two-view relation.
#[derive(Clone, Copy, Debug)]
pub struct TwoViewOptions {
    /// Maximum residual of an inlier, px. For pixels with standard deviation sigma, 1.96 sigma passes 95 % of the good
    /// pairs of a fundamental matrix (chi-square, 1 degree of freedom) and 2.45 sigma those of a homography (2
    /// degrees).
    pub threshold_px: f64,
    /// Probability of drawing at least one sample without outliers, 0 to 1. High, because not every clean sample of
    /// noisy pairs leads to the best relation.
    pub confidence: f64,
    /// Minimum number of samples.
    pub min_iterations: usize,
    /// Maximum number of samples.
    pub max_iterations: usize,
}

impl Default for TwoViewOptions {
    fn default() -> Self {
        Self {
            threshold_px: 1.0,
            confidence: 0.999,
            min_iterations: 10,
            max_iterations: 500,
        }
    }
}

impl TwoViewOptions {
    /// For a homography that is compared with a fundamental matrix: only one that explains more than half of the pairs
    /// can win, which 107 samples find with 99.9 %. In a non-planar scene all of them are drawn.
    #[must_use]
    pub fn for_homography() -> Self {
        Self {
            max_iterations: 107,
            ..Self::default()
        }
    }
}

/// Number of pairs per block: four numbers of double precision fill a vector register of 256 bits.
pub(crate) const LANES: usize = 4;

#[derive(Clone, Copy)]
pub(crate) struct Block {
    pub(crate) x1: [f64; LANES],
    pub(crate) y1: [f64; LANES],
    pub(crate) x2: [f64; LANES],
    pub(crate) y2: [f64; LANES],
}

/// Standard deviations by which a sample's relation may cost more than the best one on the first pairs. Measured on
/// 1000 simulated scenes: the results were the same as without this limit.
const SAMPLE_MARGIN: f64 = 2.0;

/// Blocks between checks for early exit. Chosen: 32 pairs, so that a check costs little beside them.
pub(crate) const BLOCKS_PER_LOOK: usize = 8;

/// The finite pairs, normalised to order one (Hartley, "In defense of the eight-point algorithm", PAMI 1997). Both
/// images share the scale, so that residuals keep their meaning.
pub(crate) struct Pairs {
    pub(crate) blocks: Vec<Block>,
    index: Vec<usize>,
    centre: [[f64; 2]; 2],
    /// 1 / px.
    pub(crate) scale: f64,
}

impl Pairs {
    /// In random order, so that the first pairs are representative. `None` if fewer than `least` pairs are finite or
    /// all are equal.
    pub(crate) fn new(pairs: &[PixelPair], least: usize, rng: &mut Rng) -> Option<Self> {
        let finite = |p: &PixelPair| (p.0[0] + p.0[1]).is_finite() && (p.1[0] + p.1[1]).is_finite();
        let mut index: Vec<usize> = (0..pairs.len()).filter(|&i| finite(&pairs[i])).collect();
        if index.len() < least {
            return None;
        }
        for last in (1..index.len()).rev() {
            index.swap(last, rng.below(last + 1));
        }
        let count = index.len() as f64;
        let mut centre = [[0.0; 2]; 2];
        for &i in &index {
            for (c, p) in centre.iter_mut().zip([pairs[i].0, pairs[i].1]) {
                c[0] += p[0] / count;
                c[1] += p[1] / count;
            }
        }
        let mut spread = 0.0;
        for &i in &index {
            for (c, p) in centre.iter().zip([pairs[i].0, pairs[i].1]) {
                let (dx, dy) = (p[0] - c[0], p[1] - c[1]);
                spread += dx * dx + dy * dy;
            }
        }
        // Root mean square distance sqrt(2) from the centre, over both images.
        let scale = (4.0 * count / spread).sqrt();
        if !(scale.is_finite() && scale > 0.0) {
            return None;
        }
        let normalise = |p: [f64; 2], c: [f64; 2]| [(p[0] - c[0]) * scale, (p[1] - c[1]) * scale];
        let blocks = index
            .chunks(LANES)
            .map(|chunk| {
                // NaN never agrees with a hypothesis, so unused lanes cost all of them the same.
                let mut block = Block::filled(f64::NAN);
                for (lane, &i) in chunk.iter().enumerate() {
                    [block.x1[lane], block.y1[lane]] = normalise(pairs[i].0, centre[0]);
                    [block.x2[lane], block.y2[lane]] = normalise(pairs[i].1, centre[1]);
                }
                block
            })
            .collect();
        Some(Self {
            blocks,
            index,
            centre,
            scale,
        })
    }

    pub(crate) fn count(&self) -> usize {
        self.index.len()
    }

    pub(crate) fn get(&self, i: usize) -> PixelPair {
        let (b, lane) = (&self.blocks[i / LANES], i % LANES);
        ([b.x1[lane], b.y1[lane]], [b.x2[lane], b.y2[lane]])
    }

    /// The matrix that normalises homogeneous pixels of an image (0 or 1).
    pub(crate) fn normaliser(&self, image: usize) -> Mat3 {
        let ([cx, cy], s) = (self.centre[image], self.scale);
        Mat3::new(s, 0.0, -s * cx, 0.0, s, -s * cy, 0.0, 0.0, 1.0)
    }

    /// The inverse of [`Self::normaliser`].
    pub(crate) fn denormaliser(&self, image: usize) -> Mat3 {
        let ([cx, cy], s) = (self.centre[image], 1.0 / self.scale);
        Mat3::new(s, 0.0, cx, 0.0, s, cy, 0.0, 0.0, 1.0)
    }

    /// Sum of `min(residual^2, gate)` over pairs, including unused lanes (MSAC: Torr, Zisserman, "MLESAC", CVIU 2000).
    /// Infinite once it reaches `limit`, which is exact as the sum only grows, or once the first pairs cost `margin`
    /// standard deviations more than their share of `limit`, where a better relation is improbable (in the spirit of
    /// Chum, Matas, "Optimal randomized RANSAC", PAMI 2008). An infinite margin disables the latter.
    #[inline]
    pub(crate) fn truncated_cost(
        &self,
        gate: f64,
        (limit, margin): (f64, f64),
        squared: impl Fn(&Block) -> [f64; LANES],
    ) -> f64 {
        let mut sums = [0.0; LANES];
        let (mut total, mut seen) = (0.0, 0.0);
        let share = limit / self.blocks.len() as f64;
        // A term between 0 and the gate has a standard deviation of at most half the gate; a block has LANES of them.
        let spread = margin * 0.5 * gate * (LANES as f64).sqrt();
        for group in self.blocks.chunks(BLOCKS_PER_LOOK) {
            for block in group {
                let r = squared(block);
                for (s, r) in sums.iter_mut().zip(r) {
                    *s += if r < gate { r } else { gate };
                }
            }
            seen += group.len() as f64;
            total = (sums[0] + sums[1]) + (sums[2] + sums[3]);
            if total >= limit || total > share * seen + spread * f64::sqrt(seen) {
                return f64::INFINITY;
            }
        }
        total
    }

    /// Flags of the input's pairs whose squared residual is below the gate, and their number.
    pub(crate) fn inliers(
        &self,
        input: usize,
        gate: f64,
        squared: impl Fn(&Block) -> [f64; LANES],
    ) -> (Vec<bool>, usize) {
        let (mut flags, mut count) = (vec![false; input], 0);
        for (block, index) in self.blocks.iter().zip(self.index.chunks(LANES)) {
            for (r, &i) in squared(block).iter().zip(index) {
                flags[i] = *r < gate;
                count += usize::from(flags[i]);
            }
        }
        (flags, count)
    }

    /// Number of pairs whose squared residual is below the gate.
    pub(crate) fn count_inliers(
        &self,
        gate: f64,
        squared: impl Fn(&Block) -> [f64; LANES],
    ) -> usize {
        self.blocks
            .iter()
            .map(|b| squared(b).iter().filter(|r| **r < gate).count())
            .sum()
    }
}

impl Block {
    fn filled(v: f64) -> Self {
        let v = [v; LANES];
        Self {
            x1: v,
            y1: v,
            x2: v,
            y2: v,
        }
    }
}

/// A two-view relation determined by samples of `SIZE` pairs.
pub(crate) trait Relation<const SIZE: usize> {
    /// All relations that fit a sample.
    fn minimal(sample: &[PixelPair; SIZE]) -> Vec<Mat3>;
    /// The relation that best fits the inliers of `start`.
    fn refit(pairs: &Pairs, start: &Mat3, gate: f64) -> Option<Mat3>;
    /// Squared residuals, in normalised units.
    fn squared(m: &[f64; 9], block: &Block) -> [f64; LANES];
}

/// The winner of a search, in normalised coordinates.
pub(crate) struct Winner {
    pub(crate) matrix: Mat3,
    pub(crate) iterations: usize,
}

/// Row by row.
#[inline]
pub(crate) fn rows(m: &Mat3) -> [f64; 9] {
    std::array::from_fn(|i| m[(i / 3, i % 3)])
}

/// RANSAC with local refinement of each new best sample (LO-RANSAC: Chum, Matas, Kittler, DAGM 2003): noisy samples
/// find too few inliers, and without refinement the estimated number of samples would be far too high.
pub(crate) fn search<R: Relation<SIZE>, const SIZE: usize>(
    pairs: &Pairs,
    options: &TwoViewOptions,
    mut rng: Rng,
) -> Option<Winner> {
    let gate = gate(pairs, options);
    let range = (options.min_iterations.max(1), options.max_iterations.max(1));
    let cost = |m: &Mat3, limit: f64, margin: f64| {
        let m = rows(m);
        pairs.truncated_cost(gate, (limit, margin), |b| R::squared(&m, b))
    };
    let (mut best, mut best_cost) = (None, f64::INFINITY);
    let (mut iterations, mut needed) = (0, range.1);
    while iterations < needed {
        iterations += 1;
        let chosen = rng.distinct::<SIZE>(pairs.count())?;
        for mut hypothesis in R::minimal(&chosen.map(|i| pairs.get(i))) {
            let mut c = cost(&hypothesis, best_cost, SAMPLE_MARGIN);
            if c >= best_cost {
                continue;
            }
            for _ in 0..2 {
                let Some(refined) = R::refit(pairs, &hypothesis, gate) else {
                    break;
                };
                let d = cost(&refined, c, f64::INFINITY);
                if d >= c {
                    break;
                }
                (hypothesis, c) = (refined, d);
            }
            (best, best_cost) = (Some(hypothesis), c);
            let m = rows(&hypothesis);
            let share =
                pairs.count_inliers(gate, |b| R::squared(&m, b)) as f64 / pairs.count() as f64;
            needed = ransac_iterations(options.confidence, share, SIZE, range);
        }
    }
    let mut matrix = best?;
    for _ in 0..8 {
        let Some(refined) = R::refit(pairs, &matrix, gate) else {
            break;
        };
        let c = cost(&refined, best_cost, f64::INFINITY);
        if c >= best_cost {
            break;
        }
        let settled = best_cost - c < 1e-6 * best_cost;
        (matrix, best_cost) = (refined, c);
        if settled {
            break;
        }
    }
    Some(Winner { matrix, iterations })
}

/// The threshold, squared and in normalised units.
pub(crate) fn gate(pairs: &Pairs, options: &TwoViewOptions) -> f64 {
    let t = options.threshold_px * pairs.scale;
    t * t
}
