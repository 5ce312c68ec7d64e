//! RANSAC search for the camera's motion.

use crate::absolute_pose::FINAL_OPENING;
use crate::camera_motion::believed;
use crate::p3p::p3p_into;
use crate::pose::transform;
use crate::sampling::{Rng, ransac_iterations};
use crate::turn::ray;
use crate::votes::Votes;
use crate::{
    CameraMotion, Intrinsics, MotionOptions, MotionPair, MotionPrior, PoseObservation, PoseOptions,
    optimise_pose_in,
};
use stillpoint_geometry::{Mat6, Se3, Vec3, align_umeyama};

/// [`find_camera_motion`] with reusable buffers.
#[derive(Clone, Debug, Default)]
pub struct MotionFinder {
    votes: Votes,
    /// Running sums of the weights, for drawing by weight.
    cumulative: Vec<f64>,
    candidates: Vec<Se3>,
    agreeing: Vec<PoseObservation>,
    active: Vec<bool>,
    /// For [`CameraMotion::inliers`].
    inliers: Vec<bool>,
}

impl MotionFinder {
    /// As [`find_camera_motion`].
    #[must_use]
    pub fn find(
        &mut self,
        camera: &Intrinsics,
        pairs: &[MotionPair],
        prior: Option<&MotionPrior>,
        options: &MotionOptions,
        rng: Rng,
    ) -> Option<CameraMotion> {
        self.cumulative.clear();
        let mut total = 0.0;
        self.cumulative.extend(pairs.iter().map(|p| {
            total += believed(p);
            total
        }));
        let voters = pairs.iter().filter(|p| believed(p) > 0.0).count();
        if voters < options.min_inliers.max(3) || !total.is_finite() {
            return None;
        }
        self.votes.rebuild(camera, pairs, options);
        let mut search = Search {
            camera,
            pairs,
            prior,
            options,
            memory: self,
            best: None,
            best_score: 0.0,
            best_raw: 0.0,
        };
        if let Some(prior) = prior {
            // The prior first: most samples are then rejected early against a likely motion.
            let raw = search.score(&prior.b_from_a, 0.0);
            search.propose(&prior.b_from_a, raw);
        }
        let iterations = search.sample(rng);
        search.conclude(iterations)
    }

    /// Recycles an inlier list.
    pub fn reuse(&mut self, inliers: Vec<bool>) {
        self.inliers = inliers;
    }
}

/// Finds the motion `b_from_a` with the largest weighted vote. A pair's vote falls from its weight to zero at its
/// chi-square gate. The first hypothesis is the prior; then samples of three pairs, drawn by weight, are solved by
/// aligning the two triangles if all have depth in B (Umeyama 1991), else by P3P. New best ones are refined at once,
/// the winner by [`optimise_pose`](crate::optimise_pose).
///
/// `None` if no motion has `min_inliers` inliers with nonzero weight.
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

struct Search<'a> {
    camera: &'a Intrinsics,
    pairs: &'a [MotionPair],
    prior: Option<&'a MotionPrior>,
    options: &'a MotionOptions,
    memory: &'a mut MotionFinder,
    best: Option<Se3>,
    /// Vote of `best`, prior included.
    best_score: f64,
    /// Best vote of a sample before refinement. Samples compete unrefined: noise makes them all worse than a refined
    /// motion, even those that would end up better.
    best_raw: f64,
}

impl Search<'_> {
    fn total(&self) -> f64 {
        self.memory.cumulative.last().copied().unwrap_or(0.0)
    }

    /// The vote for a motion; 0 if it cannot exceed `limit`.
    fn score(&self, b_from_a: &Se3, limit: f64) -> f64 {
        if self.options.turn.is_some_and(|t| !t.allows(b_from_a)) {
            return 0.0;
        }
        let factor = self
            .prior
            .map_or(1.0, |p| p.factor(b_from_a, self.options.prior_strength));
        factor * self.memory.votes.count(b_from_a, limit / factor)
    }

    /// Refines a motion with vote `raw` in two steps, first with open gates, and keeps it if it is the best yet.
    fn propose(&mut self, start: &Se3, raw: f64) {
        if raw > self.best_score {
            (self.best, self.best_score) = (Some(*start), raw);
        }
        let mut pose = *start;
        // Open first, since a motion from three noisy points misses many inliers of the true one.
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
    fn refine(&mut self, pose: &Se3, opening: f64) -> Option<Se3> {
        self.gather(pose, opening * self.options.gate_scale);
        let stride = self.memory.agreeing.len().div_ceil(REFINE_PAIRS).max(1);
        let mut place = 0;
        self.memory.agreeing.retain(|_| {
            place += 1;
            (place - 1) % stride == 0
        });
        if self.memory.agreeing.len() < 4 {
            return None;
        }
        let options = PoseOptions {
            rounds: 1,
            plain_rounds: 0,
            iterations: 2,
            gate_scale: self.options.gate_scale,
            turn: self.options.turn,
            place: None,
        };
        Some(self.optimise(pose, &options).0)
    }

    /// Optimises the pose on the gathered observations; returns it with its information.
    fn optimise(&mut self, pose: &Se3, options: &PoseOptions) -> (Se3, Mat6) {
        let memory = std::mem::take(&mut self.memory.active);
        let gathered = &self.memory.agreeing;
        let estimate = optimise_pose_in(memory, self.camera, pose, gathered, options);
        self.memory.active = estimate.inliers;
        (estimate.camera_from_world, estimate.information)
    }

    /// Gathers observations of the weighted pairs with squared residuals within `scale` gates, weighted by the slope of
    /// their vote at `pose`, so that minimising squares raises the vote.
    fn gather(&mut self, pose: &Se3, scale: f64) {
        let (r, t) = (pose.rotation_matrix(), pose.translation);
        let o = self.options;
        let found = &mut self.memory.agreeing;
        found.clear();
        for p in self.pairs.iter().filter(|p| believed(p) > 0.0) {
            let mut m = p.measurement;
            let (chi2, gate) = (m.chi2(self.camera, &transform(&r, &t, &p.point)), m.gate());
            let agrees = chi2 <= gate * scale;
            if !agrees {
                continue;
            }
            if o.peak > 0.0 {
                let share = chi2 / (gate * o.gate_scale);
                let fall = 1.0 / (1.0 + o.peak * share);
                let weight = fall * fall;
                m.pixel_weight *= weight;
                m.inverse_depth_weight *= weight;
            }
            found.push(PoseObservation {
                point: p.point,
                measurement: m,
            });
        }
    }

    /// Draws samples until a better motion has become improbable; returns their number.
    fn sample(&mut self, mut rng: Rng) -> usize {
        let o = self.options;
        if o.max_iterations == 0 {
            return 0;
        }
        let range = (o.min_iterations.max(1), o.max_iterations);
        let needed = |share: f64| ransac_iterations(o.confidence, share, 3, range);
        let mut iterations = 0;
        let mut limit = needed(self.share());
        while iterations < limit {
            iterations += 1;
            let Some(chosen) = self.draw(&mut rng) else {
                continue;
            };
            self.solve(&chosen);
            for k in 0..self.memory.candidates.len() {
                let pose = self.memory.candidates[k];
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

    /// Weight share that agrees with the best motion, which is also the probability of a good draw.
    fn share(&self) -> f64 {
        // Within wide gates almost everything may agree; the peaked vote is selective.
        let agreeing = |pose: Se3| match self.options.peak > 0.0 {
            true => self.memory.votes.count(&pose, 0.0),
            false => self.memory.votes.inlier_weight(&pose),
        };
        self.best.map_or(0.0, agreeing) / self.total()
    }

    /// Three different pairs, by weight; `None` if a few pairs hold nearly all weight and are drawn repeatedly.
    fn draw(&self, rng: &mut Rng) -> Option<[usize; 3]> {
        let mut chosen = [usize::MAX; 3];
        for k in 0..3 {
            let mut tries = 0;
            while chosen[k] == usize::MAX {
                let at = rng.unit() * self.total();
                let i = self.memory.cumulative.partition_point(|c| *c <= at);
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

    fn solve(&mut self, chosen: &[usize; 3]) {
        let found = &mut self.memory.candidates;
        found.clear();
        let sample = chosen.map(|i| &self.pairs[i]);
        let points = sample.map(|p| p.point);
        let rays = sample.map(|p| ray(self.camera, p));
        if !sample.iter().all(|p| p.measurement.has_depth()) {
            return p3p_into(points, rays, found);
        }
        let seen: [Vec3; 3] =
            std::array::from_fn(|i| rays[i] / sample[i].measurement.inverse_depth);
        if !rigid(self.camera, self.options, (&sample, &points), &seen) {
            return;
        }
        found.extend(match &self.options.turn {
            Some(turn) => Some(turn.with_shift(&points, &seen)),
            None => align_umeyama(&points, &seen, false)
                .ok()
                .map(|a| a.target_from_source),
        });
    }

    fn conclude(mut self, iterations: usize) -> Option<CameraMotion> {
        let scale = self.options.gate_scale;
        // Open gates: the best motion is still rough, and the optimisation applies the gates again.
        let options = PoseOptions {
            rounds: 2,
            plain_rounds: 1,
            iterations: 2,
            gate_scale: scale,
            turn: self.options.turn,
            place: self.options.place,
        };
        let rounds = if self.options.peak > 0.0 { 3 } else { 1 };
        let (mut b_from_a, mut information) = (self.best?, Mat6::zeros());
        for _ in 0..rounds {
            self.gather(&b_from_a, FINAL_OPENING * scale);
            (b_from_a, information) = self.optimise(&b_from_a, &options);
        }
        let (r, t) = (b_from_a.rotation_matrix(), b_from_a.translation);
        let mut inliers = std::mem::take(&mut self.memory.inliers);
        inliers.clear();
        let (mut weight, mut count, mut voters) = (0.0, 0, 0);
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

/// Whether the side lengths of the triangles in both frames agree within their noise; otherwise the pairs are not one
/// rigid body.
fn rigid(
    camera: &Intrinsics,
    options: &MotionOptions,
    (sample, points): (&[&MotionPair; 3], &[Vec3; 3]),
    seen: &[Vec3; 3],
) -> bool {
    let sigma = |i: usize| {
        let (m, z) = (&sample[i].measurement, seen[i].z);
        let pixel = z / (camera.fx * m.pixel_weight.sqrt());
        z * z / m.inverse_depth_weight.sqrt() + pixel
    };
    [(0, 1), (0, 2), (1, 2)].into_iter().all(|(i, k)| {
        let (a, b) = (points[i] - points[k], seen[i] - seen[k]);
        let tolerance = 3.0 * (sigma(i) + sigma(k)) * options.gate_scale.sqrt();
        (a.norm() - b.norm()).abs() <= tolerance
    })
}

/// Share of the best vote that a sample needs to be refined. Chosen: three noisy pairs give a rough motion, and
/// refining may raise its vote by a factor of four.
const RAW_SHARE: f64 = 0.25;

/// Maximum number of pairs in a refinement between samples: enough for its accuracy, few enough to be quick. Chosen:
/// twelve times a sample.
const REFINE_PAIRS: usize = 36;
