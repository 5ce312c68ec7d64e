//! The absolute trajectory error.

use crate::error::EvaluationError;
use crate::{Statistics, TimedPose};
use stillpoint_geometry::{Alignment, Vec3, align_umeyama};

/// One pose of the estimate against its ground truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairError {
    /// Stamp of the estimate, s.
    pub stamp: f64,
    /// Position of the ground truth, m.
    pub reference: Vec3,
    /// Position of the estimate after alignment, m.
    pub estimate: Vec3,
    /// Distance between the two, m.
    pub error: f64,
}

/// The absolute trajectory error: distances between positions after the best alignment.
#[derive(Clone, Debug, PartialEq)]
pub struct Ate {
    /// Statistics of the distances, m.
    pub statistics: Statistics,
    /// Maps the estimate onto the ground truth.
    pub alignment: Alignment,
    /// Each pair, in order of time.
    pub pairs: Vec<PairError>,
}

/// Absolute error over the given pairs of indices `(reference, estimate)`, after alignment by SE(3), or Sim(3) if `with_scale`.
///
/// # Errors
/// [`EvaluationError::TooFewPairs`] (with `max_dt` NaN), [`EvaluationError::FixedReference`], [`EvaluationError::FixedEstimate`].
pub fn absolute_error(
    reference: &[TimedPose],
    estimate: &[TimedPose],
    pairs: &[(usize, usize)],
    with_scale: bool,
) -> Result<Ate, EvaluationError> {
    let position = |p: &TimedPose| p.world_from_camera.translation;
    let target: Vec<Vec3> = pairs.iter().map(|p| position(&reference[p.0])).collect();
    let source: Vec<Vec3> = pairs.iter().map(|p| position(&estimate[p.1])).collect();
    if pairs.len() < 3 {
        return Err(EvaluationError::TooFewPairs {
            pairs: pairs.len(),
            max_dt: f64::NAN,
        });
    }
    let extent = |points: &[Vec3]| {
        points
            .iter()
            .map(|p| (p - points[0]).norm())
            .fold(0.0, f64::max)
    };
    if extent(&target) == 0.0 {
        return Err(EvaluationError::FixedReference { extent: 0.0 });
    }
    let alignment =
        align_umeyama(&source, &target, with_scale).map_err(|_| EvaluationError::FixedEstimate)?;
    let pairs: Vec<PairError> = pairs
        .iter()
        .zip(source.iter().zip(&target))
        .map(|(&(_, e), (s, &reference))| {
            let aligned = alignment.apply(s);
            PairError {
                stamp: estimate[e].stamp,
                reference,
                estimate: aligned,
                error: (aligned - reference).norm(),
            }
        })
        .collect();
    let errors: Vec<f64> = pairs.iter().map(|p| p.error).collect();
    Ok(Ate {
        statistics: Statistics::of(&errors).unwrap_or_default(),
        alignment,
        pairs,
    })
}
