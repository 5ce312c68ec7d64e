//! Least-squares alignment of point sets (Umeyama, "Least-squares estimation of transformation parameters between two
//! point patterns", PAMI 1991).

use crate::{Mat3, Se3, Vec3};

/// Why two point sets cannot be aligned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlignmentError {
    /// Fewer than three pairs, or sets of different length.
    TooFewPairs,
    /// All points of a set coincide, or a number is not finite: the rotation is undetermined.
    Degenerate,
}

impl std::fmt::Display for AlignmentError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::TooFewPairs => "alignment needs at least three pairs of points",
            Self::Degenerate => "alignment needs points that are finite and not all the same",
        })
    }
}

impl std::error::Error for AlignmentError {}

/// The similarity `target ~ scale * rotation * source + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alignment {
    /// Rigid part `target_from_source`.
    pub target_from_source: Se3,
    /// Scale factor; 1 when not estimated.
    pub scale: f64,
}

impl Alignment {
    /// Maps a source point to the target frame.
    #[must_use]
    pub fn apply(&self, p: &Vec3) -> Vec3 {
        self.target_from_source.rotation * p * self.scale + self.target_from_source.translation
    }

    /// Maps a target point to the source frame.
    #[must_use]
    pub fn invert(&self, p: &Vec3) -> Vec3 {
        let turned = p - self.target_from_source.translation;
        self.target_from_source.rotation.inverse() * turned / self.scale
    }
}

/// Aligns `source[i]` to `target[i]`; the scale is estimated when `with_scale`, else 1.
///
/// # Errors
/// [`AlignmentError::TooFewPairs`] below three pairs or for unequal lengths, [`AlignmentError::Degenerate`] when a set
/// has no extent or contains a number that is not finite.
pub fn align_umeyama(
    source: &[Vec3],
    target: &[Vec3],
    with_scale: bool,
) -> Result<Alignment, AlignmentError> {
    let n = source.len();
    if n < 3 || n != target.len() {
        return Err(AlignmentError::TooFewPairs);
    }
    let count = n as f64;
    let mean = |v: &[Vec3]| v.iter().fold(Vec3::zeros(), |a, p| a + p) / count;
    let (ms, mt) = (mean(source), mean(target));
    let mut covariance = Mat3::zeros();
    for (s, t) in source.iter().zip(target) {
        covariance += (t - mt) * (s - ms).transpose();
    }
    covariance /= count;
    let source_variance = variance(source, &ms);
    let extent = covariance.norm();
    if !(extent.is_finite()
        && extent > 0.0
        && source_variance > rounding(source)
        && variance(target, &mt) > rounding(target))
    {
        return Err(AlignmentError::Degenerate);
    }
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Err(AlignmentError::Degenerate);
    };
    let mut sign = Mat3::identity();
    if u.determinant() * v_t.determinant() < 0.0 {
        // nalgebra sorts singular values in descending order: the last one is the smallest.
        sign[(2, 2)] = -1.0;
    }
    let rotation = u * sign * v_t;
    let scale = if with_scale {
        (Mat3::from_diagonal(&svd.singular_values) * sign).trace() / source_variance
    } else {
        1.0
    };
    let translation = mt - rotation * ms * scale;
    Ok(Alignment {
        target_from_source: Se3::from_matrix(&rotation, translation),
        scale,
    })
}

fn variance(points: &[Vec3], mean: &Vec3) -> f64 {
    let sum: f64 = points.iter().map(|p| (p - mean).norm_squared()).sum();
    sum / points.len() as f64
}

/// Upper bound of the variance that rounding of the mean causes for coincident points.
fn rounding(points: &[Vec3]) -> f64 {
    let size = points.iter().fold(0.0, |a, p| f64::max(a, p.amax()));
    let error = 4.0 * f64::EPSILON * points.len() as f64 * size;
    error * error
}
