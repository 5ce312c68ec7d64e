//! How uncertain poses are: in the map around them, from one to another, and from where the map began.
//!
//! Answers: which covariance a pose has, by what its matches tell and by how badly they fit; what of it two poses have in common; what the map adds. Measures
//! nothing and decides nothing: no stage asks for it. The numbers of this module were fitted to 13 inputs together (`lab covariance` measures how well).

mod log;
mod map;

pub use log::{CovarianceLog, PoseCovariance};
pub use map::MapCovariance;

use crate::evidence::Scatter;
use stillpoint_estimation::pose_covariance;
use stillpoint_geometry::{Mat6, Se3};

/// Variance of a pixel coordinate of a keypoint, by what matching states for its level (1 px^2 at the finest): half a pixel. Residuals have 0.15 to 0.28 in
/// simulated rooms and 0.17 to 0.19 before cameras that stand still; 0.5 to 0.8 where a real one moves.
const KEYPOINT: f64 = 0.25;
/// Both err by it: the keypoints of the frame, and those that the map was made from.
const SIDES: f64 = 2.0;
/// Residuals that are larger have causes that a whole image shares: lens, shutter, blur, who walks, what the map has wrong. Of these no more than so many are
/// independent of each other in a frame, a number, however many matches there are.
const CAUSES: f64 = 2.0;
/// So long errors of poses last, s: until their correlation is 1/e (on fr1_xyz, tartanair_office and in simulated rooms 0.2 to 0.5).
const LASTS_S: f64 = 0.25;

/// Covariance of a pose in the map around it, as a twist `[translation; rotation]` (m^2, m rad, rad^2) in the coordinates of its information; none when that leaves a
/// direction open. Without a scatter, as of what sensors tell, it is what was stated.
///
/// Of N matches with residuals of variance s, by what was stated, the inverse of the information counts 2 k + (s - k) N / c times, with k the variance of
/// a keypoint and c the number of causes that they share: a factor by which variances of means grow where measurements come in clusters (Kish, "Survey Sampling", 1965, section 5.4).
#[must_use]
pub fn covariance_in_map(information: &Mat6, scatter: Option<&Scatter>) -> Option<Mat6> {
    let factor = scatter.map_or(1.0, |s| {
        let shared = (s.variance - KEYPOINT).max(0.0);
        SIDES * KEYPOINT + shared * f64::from(s.count) / CAUSES
    });
    pose_covariance(information).map(|c| c * factor)
}

/// Covariance of the motion between two poses that are so many seconds apart, in the axes of the later one, by that of each in the map around it. Errors that last are in both and cancel.
#[must_use]
pub fn covariance_of_motion(
    earlier: &Mat6,
    later: &Mat6,
    earlier_from_later: &Se3,
    seconds: f64,
) -> Mat6 {
    let apart = 1.0 - libm::exp(-seconds.abs() / LASTS_S);
    (moved(earlier, &earlier_from_later.inverse()) + later) * apart
}

/// A covariance in other coordinates.
pub(crate) fn moved(covariance: &Mat6, to_from: &Se3) -> Mat6 {
    let by = to_from.adjoint();
    by * covariance * by.transpose()
}

#[cfg(test)]
mod tests;
