//! The camera's motion between two frames, by a weighted vote of points that may move themselves.
//!
//! Answers: which rigid motion do the points obey that are likely to stand still. A person close to the camera may own most
//! of the image; prior weights and a prior motion keep such a crowd from winning.

use crate::motion_search::MotionFinder;
use crate::pose_graph::CHI2_95_6;
use crate::sampling::Rng;
use crate::turn::KnownTurn;
use crate::{Intrinsics, KnownPlace, Measurement};
use stillpoint_geometry::{Mat6, Se3, Vec3, so3};

/// A point of frame A and what frame B measured of it.
#[derive(Clone, Copy, Debug)]
pub struct MotionPair {
    /// Position in the camera coordinates of frame A, m.
    pub point: Vec3,
    /// What frame B measured. Its variances should include what the error of `point` adds to the prediction.
    pub measurement: Measurement,
    /// Prior belief that the point stands still, 0 or more: its share among the samples, and its vote. Points of weight 0
    /// are judged, but have no say.
    pub weight: f64,
}

/// What is believed of the motion before looking, for example that the velocity stayed the same.
#[derive(Clone, Copy, Debug)]
pub struct MotionPrior {
    /// The expected motion.
    pub b_from_a: Se3,
    /// Standard deviation of each translation coordinate, m.
    pub sigma_m: f64,
    /// Standard deviation of each rotation coordinate, rad.
    pub sigma_rad: f64,
}

impl MotionPrior {
    /// The part of a vote that is lost by being this far from the prior: 0 at the prior, `strength` beyond the 95 % gate.
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
    /// Probability of drawing at least one sample without outliers, 0 to 1. High, because depths are noisy: two motions that
    /// differ little have one between them that shares both crowds, and a single good sample may end there.
    pub confidence: f64,
    /// Least number of samples.
    pub min_iterations: usize,
    /// Maximum number of samples; with 0 only the prior is refined.
    pub max_iterations: usize,
    /// Factor on the squared chi-square gates (95 %) of the measurements.
    pub gate_scale: f64,
    /// How much more a pair near the middle of its gate counts than one near its border, 0 or more: with the share `r` of the squared
    /// gate that its residual takes up, a vote is `(1 - r) / (1 + peak r)`. Within wide gates two crowds may both agree with a motion
    /// between theirs; a high peak lets the motion win that one of them agrees with exactly.
    pub peak: f64,
    /// Share of its votes that a motion far from the prior loses, 0 to below 1.
    pub prior_strength: f64,
    /// Least number of inliers with a weight.
    pub min_inliers: usize,
    /// The rotation of the motion, and its translation, where they are known: others have no votes.
    pub turn: Option<KnownTurn>,
    /// Where the motion brings a point, as far as that is known from elsewhere: the motion that won is optimised with it.
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

/// The motion that won.
#[derive(Clone, Debug)]
pub struct CameraMotion {
    /// The motion: maps camera coordinates of frame A to those of frame B.
    pub b_from_a: Se3,
    /// Per pair, whatever its weight: within the gate.
    pub inliers: Vec<bool>,
    /// Number of inliers.
    pub count: usize,
    /// Share of the total weight that the inliers hold, 0 to 1.
    pub weight_share: f64,
    /// Samples drawn; the prior is not among them.
    pub iterations: usize,
    /// The inverse covariance of the motion, for a left perturbation `[translation; rotation]`, as far as the measurements'
    /// variances tell.
    pub information: Mat6,
}

/// Finds the motion `b_from_a` with the largest weighted vote. Each pair votes with its weight, falling from one to zero
/// at its chi-square gate. The prior is the first hypothesis; then come samples of three pairs, drawn by weight, solved by
/// aligning the two triangles when all have depth in B (Umeyama 1991), else by P3P. New best ones are refined at once, the
/// winner by [`optimise_pose`](crate::optimise_pose).
///
/// `None` when fewer than `min_inliers` pairs with a weight agree on any motion.
#[must_use]
pub fn find_camera_motion(
    camera: &Intrinsics,
    pairs: &[MotionPair],
    prior: Option<&MotionPrior>,
    options: &MotionOptions,
    rng: Rng,
) -> Option<CameraMotion> {
    MotionFinder::default().find(camera, pairs, prior, options, rng)
}

/// The weight of a pair, 0 for what is not a positive number or a pair that is not finite.
pub(crate) fn believed(p: &MotionPair) -> f64 {
    let m = &p.measurement;
    let sum = p.point.sum() + m.pixel.sum() + m.inverse_depth + m.pixel_weight;
    if p.weight > 0.0 && (sum + m.inverse_depth_weight + p.weight).is_finite() {
        p.weight
    } else {
        0.0
    }
}
