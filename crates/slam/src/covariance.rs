//! Covariance of poses: within the local map, between two poses, and relative to the origin of the map.
//!
//! Used by no stage. The constants were fitted jointly to 13 inputs; `lab covariance` measures the fit.

mod log;
mod map;

pub use log::{CovarianceLog, PoseCovariance};
pub use map::MapCovariance;

use crate::evidence::Scatter;
use stillpoint_estimation::pose_covariance;
use stillpoint_geometry::{Mat6, Se3};

/// Variance of a keypoint's position, as a share of the variance that it states (0.25 px^2 across an edge at the finest
/// level). That is 0.113 px^2; decision 56 measured 0.01 to 0.25 px^2. Fitted to errors in simulated rooms.
const KEYPOINT: f64 = 0.45;
/// Number of keypoints whose errors a match contains, by definition: one in the frame, one in the map. Variances of
/// independent errors add (equation 38 of docs/algorithm.md).
const SIDES: f64 = 2.0;
/// Number of independent causes of larger residuals in a frame (lens, shutter, blur, people, map errors), regardless of
/// the number of matches. Fitted to errors measured on 13 inputs (decision 53).
const CAUSES: f64 = 2.0;
/// Time after which pose errors have a correlation of 1/e, s: measured 0.2 to 0.5 on fr1_xyz, tartanair_office and in
/// simulated rooms; frame-to-frame errors alone give 0.14, 0.23 and 0.33 in simulated `rpy`, `xyz` and `walking_xyz`.
const LASTS_S: f64 = 0.3;

/// Covariance of a pose in the map around it, as a twist `[translation; rotation]` (m^2, m rad, rad^2) in the axes of
/// `information`; `None` if a direction is unconstrained. Without a scatter, as for poses from sensors, it is the
/// inverse of the information.
///
/// With N matches of residual variance s, the inverse of the information is multiplied by 2 k + max(0, s - k) N / c,
/// where k is the variance of a keypoint and c the number of causes: the design effect of measurements in clusters
/// (Kish, "Survey Sampling", 1965, section 5.4).
#[must_use]
pub fn covariance_in_map(information: &Mat6, scatter: Option<&Scatter>) -> Option<Mat6> {
    let factor = scatter.map_or(1.0, |s| {
        let shared = (s.variance - KEYPOINT).max(0.0);
        SIDES * KEYPOINT + shared * f64::from(s.count) / CAUSES
    });
    pose_covariance(information).map(|c| c * factor)
}

/// Covariance of the motion between two poses `seconds` apart, in the axes of the later one, from the covariance of
/// each in its map. Shared errors cancel.
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

/// Transforms a covariance to other coordinates by the adjoint.
pub(crate) fn moved(covariance: &Mat6, to_from: &Se3) -> Mat6 {
    let by = to_from.adjoint();
    by * covariance * by.transpose()
}

#[cfg(test)]
mod tests;
