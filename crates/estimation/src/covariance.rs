//! Covariance of optimised poses.

use crate::PoseEstimate;
use stillpoint_geometry::Mat6;

/// Smallest pivot of the information, scaled to a unit diagonal, with which it is inverted. Below it, some direction
/// has an uncertainty ten thousand times (the root) that given by its diagonal entry, and the result would be
/// rounding error: half of the digits of double precision.
const MIN_PIVOT: f64 = 1e-8;

impl PoseEstimate {
    /// Covariance of the pose: the inverse of [`PoseEstimate::information`], by [`pose_covariance`].
    #[must_use]
    pub fn covariance(&self) -> Option<Mat6> {
        pose_covariance(&self.information)
    }
}

/// Inverts the information `J^T W J` of a pose: with `W` the inverse covariance of the measurements, the covariance of
/// the least-squares estimate to first order (Hartley, Zisserman, section 5.2). Order and coordinates stay those of the
/// information: for `[translation; rotation]` in m and rad the blocks are m^2, m rad and rad^2.
///
/// After gating it is somewhat too small, since the most influential 5 % of good measurements are removed as well:
/// errors have 1.14 (with depth) to 1.19 times (without) this variance, and a normalised squared error is 6.9 on
/// average, not 6.
///
/// `None` if a direction is unconstrained (the matrix is singular) or the matrix is not finite.
#[must_use]
pub fn pose_covariance(information: &Mat6) -> Option<Mat6> {
    // A unit diagonal makes pivots of metres and radians comparable.
    let scale = information.diagonal().map(|d| 1.0 / d.sqrt());
    if !scale.iter().all(|s| s.is_finite()) {
        return None;
    }
    let scaled = Mat6::from_fn(|r, c| {
        let mean = 0.5 * (information[(r, c)] + information[(c, r)]);
        mean * (scale[r] * scale[c])
    });
    let cholesky = scaled.cholesky()?;
    let pivots = cholesky.l_dirty().diagonal();
    // The comparison fails for NaN as well.
    if !pivots.iter().all(|p| p * p > MIN_PIVOT) {
        return None;
    }
    let inverse = cholesky.inverse();
    let covariance = Mat6::from_fn(|r, c| {
        let mean = 0.5 * (inverse[(r, c)] + inverse[(c, r)]);
        mean * (scale[r] * scale[c])
    });
    covariance
        .iter()
        .all(|v| v.is_finite())
        .then_some(covariance)
}
