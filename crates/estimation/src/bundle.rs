//! Bundle adjustment.

use crate::pose::transform;
use crate::reduced::Plan;
use crate::schur::{self, Step, System};
use crate::{Intrinsics, Measurement};
use stillpoint_geometry::{Se3, Vec3, robust};

/// A point seen by a camera.
#[derive(Clone, Copy, Debug)]
pub struct BundleObservation {
    /// Index of the pose.
    pub pose: u32,
    /// Index of the point.
    pub point: u32,
    /// The measurement.
    pub measurement: Measurement,
}

/// Poses, points and their observations.
#[derive(Clone, Debug)]
pub struct BundleProblem {
    /// The camera.
    pub camera: Intrinsics,
    /// Poses `camera_from_world`; changed in place.
    pub poses: Vec<Se3>,
    /// Number of free poses, from the first on; the others fix the gauge.
    pub free_poses: usize,
    /// World positions, m; changed in place.
    pub points: Vec<Vec3>,
    /// Observations, sorted by point.
    pub observations: Vec<BundleObservation>,
}

/// Effort of bundle adjustment.
#[derive(Clone, Copy, Debug)]
pub struct BundleOptions {
    /// Iterations with the Huber kernel, before outliers are removed.
    pub robust_iterations: usize,
    /// Iterations after that.
    pub final_iterations: usize,
    /// Stops a phase when the cost falls by less than this share.
    pub min_relative_gain: f64,
    /// Maximum total work, in products of two 6x6 blocks (432 floating-point operations): one per observation each time
    /// the system is built, half of one per pair of observations of a point each time it is solved, plus the products
    /// of its factorisation or the maximum of conjugate gradients. No step that would exceed it is started.
    pub max_work: u64,
}

impl Default for BundleOptions {
    fn default() -> Self {
        // Five iterations, outlier removal, ten more: as in ORB-SLAM2 (Mur-Artal, Tardos 2017).
        Self {
            robust_iterations: 5,
            final_iterations: 10,
            min_relative_gain: 1e-4,
            max_work: u64::MAX,
        }
    }
}

/// Why bundle adjustment ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BundleStop {
    /// No step gains more than the minimum gain.
    Converged,
    /// The iterations of the last phase were used up.
    IterationLimit,
    /// The next step would exceed `max_work`.
    WorkLimit,
}

/// Result of bundle adjustment; poses and points are in the problem.
#[derive(Clone, Debug)]
pub struct BundleReport {
    /// Per observation: beyond its 95 % gate (or behind the camera) at the end.
    pub outliers: Vec<bool>,
    /// Iterations of both phases.
    pub iterations: usize,
    /// Robust cost before the first iteration.
    pub initial_cost: f64,
    /// Cost of the inliers at the end.
    pub final_cost: f64,
    /// Why it ended.
    pub stop: BundleStop,
    /// Work used, in units of [`BundleOptions::max_work`].
    pub work: u64,
    /// 6x6 blocks stored for the reduced pose system, with fill-in if factored: 288 bytes each.
    pub blocks: usize,
}

/// Minimises the sum of robust squared residuals over free poses and all points (Levenberg-Marquardt with Schur
/// complement, Triggs et al., "Bundle adjustment: a modern synthesis", 1999, section 6).
///
/// Two phases: with the Huber kernel, then without outliers until convergence, still with the kernel. Up to 100 free
/// poses the reduced system is dense; larger ones are sparse 6x6 blocks, solved by factorisation or conjugate
/// gradients, whichever is cheaper (decision 11); thousands of poses and 100 000 points are practical.
///
/// # Panics
/// If an index of an observation is out of range or observations are not sorted by point.
#[must_use]
pub fn adjust_bundle(problem: &mut BundleProblem, options: &BundleOptions) -> BundleReport {
    assert!(
        problem.observations.is_sorted_by_key(|o| o.point),
        "observations must be sorted by point"
    );
    let mut active = vec![true; problem.observations.len()];
    let initial_cost = cost(problem, &problem.poses, &problem.points, &active);
    let mut effort = Effort::default();
    minimise(
        problem,
        &active,
        options.robust_iterations,
        options,
        &mut effort,
    );
    classify(problem, &mut active);
    let stop = minimise(
        problem,
        &active,
        options.final_iterations,
        options,
        &mut effort,
    );
    classify(problem, &mut active);
    BundleReport {
        iterations: effort.iterations,
        initial_cost,
        final_cost: cost(problem, &problem.poses, &problem.points, &active),
        outliers: active.iter().map(|a| !a).collect(),
        stop,
        work: effort.work,
        blocks: effort.blocks,
    }
}

/// Work spent, and the buffers of the last system.
#[derive(Default)]
struct Effort {
    iterations: usize,
    work: u64,
    blocks: usize,
    system: System,
}

impl Effort {
    /// Adds work, unless it exceeds the limit.
    fn take(&mut self, work: u64, limit: u64) -> bool {
        let sum = self.work.saturating_add(work);
        let fits = sum <= limit;
        if fits {
            self.work = sum;
        }
        fits
    }
}

fn minimise(
    problem: &mut BundleProblem,
    active: &[bool],
    iterations: usize,
    options: &BundleOptions,
    effort: &mut Effort,
) -> BundleStop {
    // The block structure depends only on the active observations.
    let plan = Plan::new(problem, active);
    effort.blocks = plan.blocks(problem.free_poses);
    let mut lambda = 1e-5;
    let mut before = cost(problem, &problem.poses, &problem.points, active);
    let mut stop = BundleStop::IterationLimit;
    'iterations: for _ in 0..iterations {
        // Not built unless there is work left to solve it.
        let build = problem.observations.len() as u64;
        if !effort.take(build.saturating_add(plan.work), options.max_work) {
            stop = BundleStop::WorkLimit;
            break;
        }
        effort.iterations += 1;
        schur::build(problem, active, &mut effort.system);
        let mut accepted = false;
        // A rejected step is retried with more damping on the same system.
        for trial in 0..6 {
            if trial > 0 && !effort.take(plan.work, options.max_work) {
                stop = BundleStop::WorkLimit;
                break 'iterations;
            }
            let Some(step) = effort.system.solve(&plan, lambda) else {
                lambda = f64::max(lambda * 10.0, 1e-4);
                continue;
            };
            let (poses, points) = apply(problem, &step);
            let after = cost(problem, &poses, &points, active);
            if after <= before {
                (problem.poses, problem.points) = (poses, points);
                lambda = f64::max(lambda * 0.1, 1e-9);
                let gain = before - after;
                before = after;
                accepted = gain > options.min_relative_gain * after;
                break;
            }
            lambda = f64::max(lambda * 10.0, 1e-4);
        }
        if !accepted {
            stop = BundleStop::Converged;
            break;
        }
    }
    for pose in &mut problem.poses[..problem.free_poses] {
        // Removes accumulated rounding.
        *pose = pose.normalized();
    }
    stop
}

fn apply(problem: &BundleProblem, step: &Step) -> (Vec<Se3>, Vec<Vec3>) {
    let mut poses = problem.poses.clone();
    for (pose, s) in poses.iter_mut().zip(&step.poses) {
        *pose = Se3::exp(s) * *pose;
    }
    let points = problem
        .points
        .iter()
        .zip(&step.points)
        .map(|(p, s)| p + s)
        .collect();
    (poses, points)
}

fn cost(problem: &BundleProblem, poses: &[Se3], points: &[Vec3], active: &[bool]) -> f64 {
    let frames: Vec<_> = poses
        .iter()
        .map(|p| (p.rotation_matrix(), p.translation))
        .collect();
    let mut sum = 0.0;
    for (o, _) in problem.observations.iter().zip(active).filter(|(_, a)| **a) {
        let (r, t) = &frames[o.pose as usize];
        let p = transform(r, t, &points[o.point as usize]);
        let gate = o.measurement.gate();
        let chi2 = o.measurement.chi2(&problem.camera, &p);
        // A point behind the camera has a large cost, so that such steps are rejected.
        sum += robust::huber_cost(if chi2.is_finite() { chi2 } else { 1e6 }, gate);
    }
    sum
}

fn classify(problem: &BundleProblem, active: &mut [bool]) {
    for (o, a) in problem.observations.iter().zip(active) {
        let p = problem.poses[o.pose as usize].transform(&problem.points[o.point as usize]);
        *a = o.measurement.chi2(&problem.camera, &p) <= o.measurement.gate();
    }
}
