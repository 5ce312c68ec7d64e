//! Camera motion between two frames, by a weighted vote of points that may move.
//!
//! A person close to the camera may fill most of the image; weights and a prior motion keep such points from winning.

use crate::pose_graph::CHI2_95_6;
use crate::turn::KnownTurn;
use crate::{KnownPlace, Measurement};
use stillpoint_geometry::{Mat6, Se3, Vec3, so3};

/// A point of frame A and its measurement in frame B.
#[derive(Clone, Copy, Debug)]
pub struct MotionPair {
    /// Position in the camera coordinates of frame A, m.
    pub point: Vec3,
    /// Measurement in frame B. Its variances should include the error of `point`.
    pub measurement: Measurement,
    /// Prior weight of the point being static, 0 or more: its share among the samples, and its vote. Points of weight 0
    /// are classified, but do not vote.
    pub weight: f64,
}

/// Prior on the motion, for example from constant velocity.
#[derive(Clone, Copy, Debug)]
pub struct MotionPrior {
    /// Expected motion.
    pub b_from_a: Se3,
    /// Standard deviation of each translation coordinate, m.
    pub sigma_m: f64,
    /// Standard deviation of each rotation coordinate, rad.
    pub sigma_rad: f64,
}

impl MotionPrior {
    /// Factor on a vote, from 1 at the prior to `1 - strength` at the 95 % gate and beyond.
    pub(crate) fn factor(&self, b_from_a: &Se3, strength: f64) -> f64 {
        let t = (b_from_a.translation - self.b_from_a.translation) / self.sigma_m;
        let r = so3::log(&(b_from_a.rotation * self.b_from_a.rotation.inverse())) / self.sigma_rad;
        let chi2 = t.norm_squared() + r.norm_squared();
        if chi2 < CHI2_95_6 {
            1.0 - strength * chi2 / CHI2_95_6
        } else {
            1.0 - strength
        }
    }
}

/// Effort and gates of the search for the camera's motion.
#[derive(Clone, Copy, Debug)]
pub struct MotionOptions {
    /// Probability of drawing at least one sample without outliers, 0 to 1. High, because depths are noisy: between two
    /// similar motions lies one that fits both groups partly, where the search may end.
    pub confidence: f64,
    /// Minimum number of samples.
    pub min_iterations: usize,
    /// Maximum number of samples; with 0 only the prior is refined.
    pub max_iterations: usize,
    /// Factor on the squared chi-square gates (95 %) of the measurements.
    pub gate_scale: f64,
    /// Preference for small residuals, 0 or more: with the residual at the share `r` of the squared gate, a vote is
    /// `(1 - r) / (1 + peak r)`. Within wide gates two groups may both fit a motion between theirs; with a high peak the
    /// motion wins that fits one of them exactly.
    pub peak: f64,
    /// Share of its votes that a motion far from the prior loses, 0 to below 1.
    pub prior_strength: f64,
    /// Minimum number of inliers with nonzero weight.
    pub min_inliers: usize,
    /// Known rotation and optionally translation; motions beyond its gate get no votes.
    pub turn: Option<KnownTurn>,
    /// Known position of a point, used in the final optimisation.
    pub place: Option<KnownPlace>,
}

impl Default for MotionOptions {
    fn default() -> Self {
        Self {
            confidence: 0.999,
            min_iterations: 8,
            max_iterations: 200,
            gate_scale: 1.0,
            peak: 0.0,
            prior_strength: 0.3,
            min_inliers: 8,
            turn: None,
            place: None,
        }
    }
}

/// The winning motion.
#[derive(Clone, Debug)]
pub struct CameraMotion {
    /// Maps camera coordinates of frame A to those of frame B.
    pub b_from_a: Se3,
    /// Per pair, regardless of weight: within the gate.
    pub inliers: Vec<bool>,
    /// Number of inliers.
    pub count: usize,
    /// Inliers' share of the total weight, 0 to 1.
    pub weight_share: f64,
    /// Samples drawn, excluding the prior.
    pub iterations: usize,
    /// Inverse covariance, for a left perturbation `[translation; rotation]`, from the measurements' variances.
    pub information: Mat6,
}

/// The weight of a pair; 0 if not positive, or if the pair is not finite.
pub(crate) fn believed(p: &MotionPair) -> f64 {
    let m = &p.measurement;
    let sum = p.point.sum() + (m.pixel + m.edge).sum() + m.inverse_depth + m.pixel_weight;
    if p.weight > 0.0 && (sum + m.inverse_depth_weight + p.weight).is_finite() {
        p.weight
    } else {
        0.0
    }
}
