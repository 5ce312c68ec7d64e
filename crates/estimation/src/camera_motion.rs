//! The camera's motion between two frames, by a weighted vote of points that may move themselves.
//!
//! Answers: which rigid motion do the points obey that are likely to stand still. A person close to the camera may own most
//! of the image; prior weights and a prior motion keep such a crowd from winning.

use crate::p3p::p3p;
use crate::pose::transform;
use crate::pose_graph::CHI2_95_6;
use crate::sampling::{Rng, ransac_iterations};
use crate::turn::{KnownTurn, ray};
use crate::votes::Votes;
use crate::{Intrinsics, Measurement, PoseObservation, PoseOptions, optimise_pose};
use stillpoint_geometry::{Mat6, Se3, Vec3, align_umeyama, so3};

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
    fn factor(&self, b_from_a: &Se3, strength: f64) -> f64 {
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
    /// Largest number of samples.
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
/// winner by [`optimise_pose`].
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
    let mut search = Search::new(camera, pairs, prior, options)?;
    if let Some(prior) = prior {
        // The prior goes first: samples then compete with a motion that is likely right, and most are dropped early.
        let raw = search.score(&prior.b_from_a, 0.0);
        search.propose(&prior.b_from_a, raw);
    }
    let iterations = search.sample(rng);
    search.conclude(iterations)
}

struct Search<'a> {
    camera: &'a Intrinsics,
    pairs: &'a [MotionPair],
    prior: Option<&'a MotionPrior>,
    options: &'a MotionOptions,
    votes: Votes,
    /// Running sums of the weights, for drawing by weight.
    cumulative: Vec<f64>,
    best: Option<Se3>,
    /// Vote of `best`, prior included.
    best_score: f64,
    /// Best vote of a sample before its refinement. Samples compete with each other as they are: noise makes them all
    /// look worse than a refined motion, also those that would end up better.
    best_raw: f64,
}

impl<'a> Search<'a> {
    fn new(
        camera: &'a Intrinsics,
        pairs: &'a [MotionPair],
        prior: Option<&'a MotionPrior>,
        options: &'a MotionOptions,
    ) -> Option<Self> {
        let mut total = 0.0;
        let cumulative: Vec<f64> = pairs
            .iter()
            .map(|p| {
                total += believed(p);
                total
            })
            .collect();
        let voters = pairs.iter().filter(|p| believed(p) > 0.0).count();
        if voters < options.min_inliers.max(3) || !total.is_finite() {
            return None;
        }
        Some(Self {
            camera,
            pairs,
            prior,
            options,
            votes: Votes::new(camera, pairs, options),
            cumulative,
            best: None,
            best_score: 0.0,
            best_raw: 0.0,
        })
    }

    fn total(&self) -> f64 {
        self.cumulative.last().copied().unwrap_or(0.0)
    }

    /// The vote on a motion, 0 when it cannot exceed `limit`.
    fn score(&self, b_from_a: &Se3, limit: f64) -> f64 {
        if self.options.turn.is_some_and(|t| !t.allows(b_from_a)) {
            return 0.0;
        }
        let factor = self
            .prior
            .map_or(1.0, |p| p.factor(b_from_a, self.options.prior_strength));
        factor * self.votes.count(b_from_a, limit / factor)
    }

    /// Refines a motion, whose vote is `raw`, in two steps, first with open gates, and keeps it if it is the best so far.
    fn propose(&mut self, start: &Se3, raw: f64) {
        if raw > self.best_score {
            (self.best, self.best_score) = (Some(*start), raw);
        }
        let mut pose = *start;
        // Open first, since a motion from three noisy points misses many pairs that agree with the true one.
        for opening in [9.0, 1.0] {
            let Some(refined) = self.refine(&pose, opening) else {
                return;
            };
            pose = refined;
            let score = self.score(&pose, self.best_score);
            if score > self.best_score {
                (self.best, self.best_score) = (Some(pose), score);
            }
        }
    }

    /// A short optimisation on at most [`REFINE_PAIRS`] pairs that agree when the squared gates are opened by a factor.
    fn refine(&self, pose: &Se3, opening: f64) -> Option<Se3> {
        let observations = self.weighted(pose, opening * self.options.gate_scale);
        let stride = observations.len().div_ceil(REFINE_PAIRS).max(1);
        let chosen: Vec<_> = observations.into_iter().step_by(stride).collect();
        if chosen.len() < 4 {
            return None;
        }
        let options = PoseOptions {
            rounds: 1,
            plain_rounds: 0,
            iterations: 2,
            gate_scale: self.options.gate_scale,
            turn: self.options.turn,
        };
        Some(optimise_pose(self.camera, pose, &chosen, &options).camera_from_world)
    }

    /// Observations of the pairs with a weight whose squared residual is within `scale` gates.
    fn agreeing(&self, pose: &Se3, scale: f64) -> Vec<PoseObservation> {
        let (r, t) = (pose.rotation_matrix(), pose.translation);
        let mut found = Vec::with_capacity(self.pairs.len());
        for p in self.pairs.iter().filter(|p| believed(p) > 0.0) {
            let m = &p.measurement;
            if m.chi2(self.camera, &transform(&r, &t, &p.point)) <= m.gate() * scale {
                found.push(PoseObservation {
                    point: p.point,
                    measurement: *m,
                });
            }
        }
        found
    }

    /// The same, each with as much weight as its vote falls with its squared residual at `pose`: minimising their squares raises the vote.
    fn weighted(&self, pose: &Se3, scale: f64) -> Vec<PoseObservation> {
        let mut found = self.agreeing(pose, scale);
        if self.options.peak > 0.0 {
            let (r, t) = (pose.rotation_matrix(), pose.translation);
            for o in &mut found {
                let m = &mut o.measurement;
                let chi2 = m.chi2(self.camera, &transform(&r, &t, &o.point));
                let share = chi2 / (m.gate() * self.options.gate_scale);
                let fall = 1.0 / (1.0 + self.options.peak * share);
                let weight = fall * fall;
                m.pixel_weight *= weight;
                m.inverse_depth_weight *= weight;
            }
        }
        found
    }

    /// Draws samples until a better motion has become improbable; returns how many.
    fn sample(&mut self, mut rng: Rng) -> usize {
        let o = self.options;
        let range = (o.min_iterations.max(1), o.max_iterations.max(1));
        let needed = |share: f64| ransac_iterations(o.confidence, share, 3, range);
        let mut iterations = 0;
        let mut limit = needed(self.share());
        while iterations < limit {
            iterations += 1;
            let Some(chosen) = self.draw(&mut rng) else {
                continue;
            };
            for pose in self.solve(&chosen) {
                let least = self.best_raw.max(RAW_SHARE * self.best_score);
                let raw = self.score(&pose, least);
                if raw > least {
                    self.best_raw = raw;
                    self.propose(&pose, raw);
                    limit = needed(self.share());
                }
            }
        }
        iterations
    }

    /// The weight that agrees with the best motion: as samples are drawn by weight, also the probability of a good draw.
    fn share(&self) -> f64 {
        // Within wide gates almost everything may agree with almost anything; what agrees exactly does not.
        let agreeing = |pose: Se3| match self.options.peak > 0.0 {
            true => self.votes.count(&pose, 0.0),
            false => self.votes.inlier_weight(&pose),
        };
        self.best.map_or(0.0, agreeing) / self.total()
    }

    /// Three different pairs, by weight; `None` when a few pairs hold nearly all weight and keep being drawn.
    fn draw(&self, rng: &mut Rng) -> Option<[usize; 3]> {
        let mut chosen = [usize::MAX; 3];
        for k in 0..3 {
            let mut tries = 0;
            while chosen[k] == usize::MAX {
                let at = rng.unit() * self.total();
                let i = self.cumulative.partition_point(|c| *c <= at);
                if i < self.pairs.len() && !chosen[..k].contains(&i) {
                    chosen[k] = i;
                }
                tries += 1;
                if tries > 16 {
                    return None;
                }
            }
        }
        Some(chosen)
    }

    /// The motions that three pairs allow.
    fn solve(&self, chosen: &[usize; 3]) -> Vec<Se3> {
        let sample = chosen.map(|i| &self.pairs[i]);
        let points = sample.map(|p| p.point);
        let rays = sample.map(|p| ray(self.camera, p));
        if !sample.iter().all(|p| p.measurement.has_depth()) {
            return p3p(points, rays);
        }
        let seen: [Vec3; 3] =
            std::array::from_fn(|i| rays[i] / sample[i].measurement.inverse_depth);
        if !self.rigid(&sample, &points, &seen) {
            return Vec::new();
        }
        if let Some(turn) = &self.options.turn {
            return vec![turn.with_shift(&points, &seen)];
        }
        align_umeyama(&points, &seen, false)
            .map(|a| a.target_from_source)
            .into_iter()
            .collect()
    }

    /// Whether the sides of two triangles agree within their noise: what does not cannot be one rigid body.
    fn rigid(&self, sample: &[&MotionPair; 3], points: &[Vec3; 3], seen: &[Vec3; 3]) -> bool {
        let sigma = |i: usize| {
            let (m, z) = (&sample[i].measurement, seen[i].z);
            let pixel = z / (self.camera.fx * m.pixel_weight.sqrt());
            z * z / m.inverse_depth_weight.sqrt() + pixel
        };
        [(0, 1), (0, 2), (1, 2)].into_iter().all(|(i, k)| {
            let (a, b) = (points[i] - points[k], seen[i] - seen[k]);
            let tolerance = 3.0 * (sigma(i) + sigma(k)) * self.options.gate_scale.sqrt();
            (a.norm() - b.norm()).abs() <= tolerance
        })
    }

    fn conclude(self, iterations: usize) -> Option<CameraMotion> {
        let scale = self.options.gate_scale;
        // Opened gates: the best motion is still rough, and the optimisation tests all that it is given again.
        let options = PoseOptions {
            rounds: 2,
            plain_rounds: 1,
            iterations: 2,
            gate_scale: scale,
            turn: self.options.turn,
        };
        let rounds = if self.options.peak > 0.0 { 3 } else { 1 };
        let (mut b_from_a, mut information) = (self.best?, Mat6::zeros());
        for _ in 0..rounds {
            let observations = self.weighted(&b_from_a, FINAL_OPENING * scale);
            let estimate = optimise_pose(self.camera, &b_from_a, &observations, &options);
            (b_from_a, information) = (estimate.camera_from_world, estimate.information);
        }
        let (r, t) = (b_from_a.rotation_matrix(), b_from_a.translation);
        let (mut inliers, mut weight, mut count, mut voters) = (Vec::new(), 0.0, 0, 0);
        for p in self.pairs {
            let m = &p.measurement;
            let chi2 = m.chi2(self.camera, &transform(&r, &t, &p.point));
            let inlier = chi2 <= m.gate() * scale;
            inliers.push(inlier);
            if inlier {
                weight += believed(p);
                voters += usize::from(believed(p) > 0.0);
                count += 1;
            }
        }
        (voters >= self.options.min_inliers.max(3) && b_from_a.is_finite()).then(|| CameraMotion {
            b_from_a,
            inliers,
            count,
            weight_share: weight / self.total(),
            iterations,
            information,
        })
    }
}

/// Share of the best vote that a sample needs before it is worth refining.
const RAW_SHARE: f64 = 0.25;

/// Factor on the squared gates within which pairs take part in the last optimisation.
const FINAL_OPENING: f64 = 4.0;

/// Pairs that a refinement between samples looks at, at most: enough for its accuracy, few enough to be quick.
const REFINE_PAIRS: usize = 36;

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
