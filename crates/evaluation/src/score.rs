//! All errors of one estimate in one call.

use crate::ate::{Ate, absolute_error};
use crate::error::EvaluationError;
use crate::rpe::{Delta, Rpe, relative_error};
use crate::{DEFAULT_MAX_DT, Statistics, TimedPose, associate};
use stillpoint_geometry::Vec3;

/// Options of the comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvalOptions {
    /// Maximum difference between the stamps of a pair, s.
    pub max_dt: f64,
    /// Align with scale: Sim(3) instead of SE(3).
    pub with_scale: bool,
    /// Interval of the relative error.
    pub delta: Delta,
}

impl Default for EvalOptions {
    fn default() -> Self {
        Self {
            max_dt: DEFAULT_MAX_DT,
            with_scale: false,
            delta: Delta::default(),
        }
    }
}

/// Absolute and relative error of an estimate.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// Number of poses with ground truth, which the errors cover.
    pub pairs: usize,
    /// Poses of the ground truth.
    pub reference_poses: usize,
    /// Poses of the estimate.
    pub estimate_poses: usize,
    /// Absolute error.
    pub ate: Ate,
    /// Relative error; `None` if the estimate is shorter than the delta.
    pub rpe: Option<Rpe>,
}

/// Drift of an estimate of a camera at rest. Nothing is aligned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift {
    /// Distance from the first pose, m.
    pub drift: Statistics,
    /// Distance from the mean position, m.
    pub spread: Statistics,
    /// Angle to the first pose, degrees.
    pub rotation_deg: Statistics,
}

/// Result of a comparison.
#[derive(Clone, Debug, PartialEq)]
pub enum Score {
    /// The camera moves: absolute and relative error.
    Moving(Evaluation),
    /// The camera is at rest in the ground truth, so alignment is not defined: drift from the first pose, over all poses of the estimate.
    Fixed(Drift),
}

/// A camera within this distance of its first position is at rest, m: below the noise of any measured ground truth.
const FIXED_EXTENT: f64 = 1e-4;

/// Largest distance of a position from the first one, m.
fn extent(poses: &[TimedPose]) -> f64 {
    let at = |p: &TimedPose| p.world_from_camera.translation;
    poses.first().map_or(0.0, |f| {
        poses
            .iter()
            .map(|p| (at(p) - at(f)).norm())
            .fold(0.0, f64::max)
    })
}

/// Whether the camera is at rest in the ground truth (within 0.1 mm), so that no alignment is defined.
#[must_use]
pub fn is_fixed(reference: &[TimedPose]) -> bool {
    extent(reference) < FIXED_EXTENT
}

/// Compares an estimate with the ground truth: errors of a moving camera, drift of one at rest.
///
/// # Errors
/// As [`evaluate`], without [`EvaluationError::FixedReference`].
pub fn score(
    reference: &[TimedPose],
    estimate: &[TimedPose],
    options: &EvalOptions,
) -> Result<Score, EvaluationError> {
    match evaluate(reference, estimate, options) {
        Ok(e) => Ok(Score::Moving(e)),
        Err(EvaluationError::FixedReference { .. }) => drift(estimate).map(Score::Fixed),
        Err(e) => Err(e),
    }
}

/// Absolute and relative error of an estimate.
///
/// # Errors
/// Any [`EvaluationError`]; [`EvaluationError::FixedReference`] if the camera is at rest in the part of the ground truth that the estimate
/// covers.
pub fn evaluate(
    reference: &[TimedPose],
    estimate: &[TimedPose],
    options: &EvalOptions,
) -> Result<Evaluation, EvaluationError> {
    check("ground truth", reference)?;
    check("estimate", estimate)?;
    let max_dt = options.max_dt;
    let pairs = associate(reference, estimate, max_dt);
    if pairs.is_empty() {
        let range = |p: &[TimedPose]| (p[0].stamp, p[p.len() - 1].stamp);
        return Err(EvaluationError::NoOverlap {
            reference: range(reference),
            estimate: range(estimate),
            max_dt,
        });
    }
    if pairs.len() < 3 {
        let pairs = pairs.len();
        return Err(EvaluationError::TooFewPairs { pairs, max_dt });
    }
    let covered: Vec<TimedPose> = pairs.iter().map(|p| reference[p.0]).collect();
    if is_fixed(&covered) {
        return Err(EvaluationError::FixedReference {
            extent: extent(&covered),
        });
    }
    let ate = absolute_error(reference, estimate, &pairs, options.with_scale)?;
    let rpe = relative_error(
        reference,
        estimate,
        &pairs,
        (options.delta, max_dt, ate.alignment.scale),
    );
    Ok(Evaluation {
        pairs: pairs.len(),
        reference_poses: reference.len(),
        estimate_poses: estimate.len(),
        ate,
        rpe,
    })
}

/// Drift of an estimate of a camera at rest: distances from its first pose and from its mean position.
///
/// # Errors
/// [`EvaluationError::Empty`], [`EvaluationError::Broken`].
pub fn drift(estimate: &[TimedPose]) -> Result<Drift, EvaluationError> {
    check("estimate", estimate)?;
    let first = estimate[0].world_from_camera;
    let n = estimate.len() as f64;
    let mean = estimate
        .iter()
        .fold(Vec3::zeros(), |a, p| a + p.world_from_camera.translation)
        / n;
    let statistics = |error: &dyn Fn(&TimedPose) -> f64| {
        Statistics::of(&estimate.iter().map(error).collect::<Vec<_>>()).unwrap_or_default()
    };
    Ok(Drift {
        drift: statistics(&|p| (p.world_from_camera.translation - first.translation).norm()),
        spread: statistics(&|p| (p.world_from_camera.translation - mean).norm()),
        rotation_deg: statistics(&|p| {
            let between = first.inverse() * p.world_from_camera;
            stillpoint_geometry::so3::angle(&between.rotation).to_degrees()
        }),
    })
}

fn check(which: &'static str, poses: &[TimedPose]) -> Result<(), EvaluationError> {
    if poses.is_empty() {
        return Err(EvaluationError::Empty { which });
    }
    let broken = |i: &usize| {
        let p = &poses[*i];
        let ascends = *i == 0 || p.stamp > poses[*i - 1].stamp;
        !(p.stamp.is_finite() && p.world_from_camera.is_finite() && ascends)
    };
    match (0..poses.len()).find(broken) {
        Some(index) => Err(EvaluationError::Broken { which, index }),
        None => Ok(()),
    }
}
