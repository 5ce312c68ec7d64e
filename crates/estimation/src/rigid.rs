//! The rigid motion between two cameras with known 3D points, among wrong correspondences.
//!
//! Verifies loop candidates, so it is conservative.

mod fit;

use crate::extent::{height, spread};
use crate::pose::transform;
use crate::sampling::{Rng, ransac_iterations};
use crate::{Intrinsics, Measurement};
use fit::Fit;
use stillpoint_geometry::{Mat3, Mat6, Se3, Vec3, align_umeyama};

/// A point seen by both cameras.
#[derive(Clone, Copy, Debug)]
pub struct RigidPair {
    /// Its position in the coordinates of camera A, m: measured there, or that of a landmark.
    pub point_a: Vec3,
    /// Its position in the coordinates of camera B, m.
    pub point_b: Vec3,
    /// Measurement in A.
    pub measurement_a: Measurement,
    /// Measurement in B.
    pub measurement_b: Measurement,
}

/// Effort and gates of the search for a rigid motion.
#[derive(Clone, Copy, Debug)]
pub struct RigidOptions {
    /// Probability of drawing at least one sample without outliers, 0 to 1.
    pub confidence: f64,
    /// Minimum number of samples.
    pub min_iterations: usize,
    /// Maximum number of samples. The default finds a tenth of inliers with 98 %.
    pub max_iterations: usize,
    /// Factor on the squared chi-square gates (95 %) of the measurements. 2 if the points are single measurements
    /// themselves, since residuals then have the noise of both ends.
    pub gate_scale: f64,
    /// Minimum number of inliers.
    pub min_inliers: usize,
    /// Minimum height of the triangle of a sample, and minimum spread of the inliers across their best-fitting line, m.
    pub min_extent_m: f64,
}

impl Default for RigidOptions {
    fn default() -> Self {
        Self {
            confidence: 0.999,
            min_iterations: 20,
            max_iterations: 4000,
            gate_scale: 2.0,
            min_inliers: 20,
            min_extent_m: 0.05,
        }
    }
}

/// An estimated rigid motion.
#[derive(Clone, Debug)]
pub struct RigidEstimate {
    /// Maps coordinates of camera A to those of camera B.
    pub b_from_a: Se3,
    /// Per pair: within the gates in both images.
    pub inliers: Vec<bool>,
    /// Number of inliers.
    pub inlier_count: usize,
    /// Samples drawn.
    pub iterations: usize,
    /// Inverse covariance of the motion, for a left perturbation `[translation; rotation]` of `b_from_a`.
    pub information: Mat6,
    /// Factor of the variance over that stated by the measurements, at least 1; `information` is divided by it. About 4
    /// if the points are single measurements, whose errors both images share.
    pub variance_factor: f64,
}

/// Result of the search for a rigid motion.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)] // There is one per candidate, and none is kept.
pub enum RigidOutcome {
    /// A motion was found.
    Found(RigidEstimate),
    /// Fewer finite pairs in front of both cameras than the required number of inliers.
    TooFewPairs {
        /// Number of usable pairs.
        usable: usize,
    },
    /// No motion has enough inliers.
    NoConsensus {
        /// Maximum number of inliers of a motion.
        inliers: usize,
        /// Samples drawn.
        iterations: usize,
    },
    /// The inliers are nearly collinear or coincident and do not determine a motion.
    Degenerate {
        /// Number of inliers.
        inliers: usize,
    },
}

impl RigidOutcome {
    /// The motion, if one was found.
    #[must_use]
    pub fn found(&self) -> Option<&RigidEstimate> {
        match self {
            Self::Found(estimate) => Some(estimate),
            _ => None,
        }
    }
}

/// Estimates the motion `b_from_a` with most inliers: pairs whose point of A falls within the gate of B's measurement
/// and vice versa. Samples of three pairs are aligned (Umeyama 1991); each new best one is refined at once on all pairs
/// near it (LO-RANSAC: Chum, Matas, Kittler, DAGM 2003); the winner minimises the residuals in both images
/// (algorithm.md, equations L5 to L7).
#[must_use]
pub fn find_rigid(
    camera: &Intrinsics,
    pairs: &[RigidPair],
    options: &RigidOptions,
    rng: Rng,
) -> RigidOutcome {
    let usable: Vec<usize> = (0..pairs.len()).filter(|&i| is_usable(&pairs[i])).collect();
    if usable.len() < options.min_inliers.max(3) {
        return RigidOutcome::TooFewPairs {
            usable: usable.len(),
        };
    }
    let mut search = Search {
        fit: Fit {
            camera,
            pairs: usable.iter().map(|&i| pairs[i]).collect(),
            gate_scale: options.gate_scale,
        },
        options,
        best: None,
        best_score: 0.0,
    };
    let iterations = search.sample(rng);
    search.conclude(iterations, pairs.len(), &usable)
}

/// Finite, and in front of both cameras.
fn is_usable(p: &RigidPair) -> bool {
    (p.point_a + p.point_b).iter().all(|v| v.is_finite())
        && p.measurement_a.is_sound()
        && p.measurement_b.is_sound()
        && p.point_a.z > 1e-3
        && p.point_b.z > 1e-3
}

struct Search<'a> {
    fit: Fit<'a>,
    options: &'a RigidOptions,
    best: Option<Se3>,
    best_score: f64,
}

impl Search<'_> {
    /// Draws samples until a better motion has become improbable; returns their number.
    fn sample(&mut self, mut rng: Rng) -> usize {
        let o = self.options;
        let range = (o.min_iterations.max(1), o.max_iterations.max(1));
        let (mut iterations, mut limit) = (0, range.1);
        while iterations < limit {
            iterations += 1;
            let Some(chosen) = rng.distinct::<3>(self.fit.pairs.len()) else {
                break;
            };
            let Some(start) = self.solve(chosen) else {
                continue;
            };
            let score = self.fit.score(&start);
            if score <= self.best_score {
                continue;
            }
            (self.best, self.best_score) = (Some(start), score);
            self.improve(start);
            let share = self.best.map_or(0.0, |best| {
                let count = self.fit.inliers(&best).iter().filter(|i| **i).count();
                count as f64 / self.fit.pairs.len() as f64
            });
            limit = ransac_iterations(o.confidence, share, 3, range);
        }
        iterations
    }

    /// The motion of three pairs; `None` if they are nearly collinear or differ in shape.
    fn solve(&self, chosen: [usize; 3]) -> Option<Se3> {
        let sample = chosen.map(|i| &self.fit.pairs[i]);
        let (a, b) = (sample.map(|p| p.point_a), sample.map(|p| p.point_b));
        if height(&a).min(height(&b)) < self.options.min_extent_m {
            return None;
        }
        // Sides must agree within their noise.
        let sigma = sample.map(|p| self.fit.sigma_m(p));
        for (i, k) in [(0, 1), (0, 2), (1, 2)] {
            let differs = ((a[i] - a[k]).norm() - (b[i] - b[k]).norm()).abs();
            if differs > 3.0 * (sigma[i] + sigma[k]) {
                return None;
            }
        }
        let aligned = align_umeyama(&a, &b, false).ok()?.target_from_source;
        aligned.is_finite().then_some(aligned)
    }

    /// Refines a motion on the pairs near it, with closing gates, and keeps the best.
    fn improve(&mut self, start: Se3) {
        let mut pose = start;
        for opening in [9.0, 3.0, 1.0] {
            let active = self.fit.agreeing(&pose, opening);
            let Some(refined) = self.fit.minimise(&pose, &active, 3) else {
                return;
            };
            pose = refined;
            let score = self.fit.score(&pose);
            if score > self.best_score {
                (self.best, self.best_score) = (Some(pose), score);
            }
        }
    }

    fn conclude(self, iterations: usize, count: usize, usable: &[usize]) -> RigidOutcome {
        let Some(mut pose) = self.best else {
            return RigidOutcome::NoConsensus {
                inliers: 0,
                iterations,
            };
        };
        let mut active = self.fit.agreeing(&pose, 2.0);
        // Alternates between motion and inliers; the limit ends cycles.
        for _ in 0..5 {
            if let Some(refined) = self.fit.minimise(&pose, &active, 10) {
                pose = refined;
            }
            let now = self.fit.inliers(&pose);
            if now == active {
                break;
            }
            active = now;
        }
        active = self.fit.inliers(&pose);
        let inlier_count = active.iter().filter(|a| **a).count();
        if inlier_count < self.options.min_inliers.max(3) || !pose.is_finite() {
            return RigidOutcome::NoConsensus {
                inliers: inlier_count,
                iterations,
            };
        }
        let agreeing = self.fit.pairs.iter().zip(&active).filter(|(_, a)| **a);
        let points: Vec<Vec3> = agreeing.map(|(p, _)| p.point_b).collect();
        if spread(&points) < self.options.min_extent_m {
            return RigidOutcome::Degenerate {
                inliers: inlier_count,
            };
        }
        let Some((information, variance_factor)) = self.fit.information(&pose, &active) else {
            return RigidOutcome::Degenerate {
                inliers: inlier_count,
            };
        };
        let mut inliers = vec![false; count];
        for (i, a) in usable.iter().zip(&active) {
            inliers[*i] = *a;
        }
        RigidOutcome::Found(RigidEstimate {
            b_from_a: pose.normalized(),
            inliers,
            inlier_count,
            iterations,
            information,
            variance_factor,
        })
    }
}

/// The points of a pair in the other camera, under the rotation and translation of `b_from_a`: that of A in B, and that
/// of B in A.
fn both_ways((r, t): &(Mat3, Vec3), p: &RigidPair) -> (Vec3, Vec3) {
    (transform(r, t, &p.point_a), r.tr_mul(&(p.point_b - t)))
}
