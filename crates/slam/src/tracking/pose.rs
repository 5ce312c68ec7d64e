//! The pose from matches.

use crate::association::{Matches, measurement};
use stillpoint_estimation::{Intrinsics, KnownTurn, PoseObservation, PoseOptions, optimise_pose};
use stillpoint_geometry::{Mat6, Se3};
use stillpoint_map::KeyframeData;

/// Optimises the pose `camera_from_world` from all matches and takes out those that do not agree with it.
pub(super) fn solve(data: &KeyframeData, initial: &Se3, matches: Matches) -> (Matches, Se3) {
    let (matches, pose, _) = solve_with_information(data, initial, matches, None);
    (matches, pose)
}

/// The same, with the rotation of `camera_from_world` where it is known from elsewhere, and with the information of the pose: the inverse of its covariance, for a left perturbation of `camera_from_world`.
pub(super) fn solve_with_information(
    data: &KeyframeData,
    initial: &Se3,
    mut matches: Matches,
    turn: Option<KnownTurn>,
) -> (Matches, Se3, Mat6) {
    let _span = tracing::info_span!("pose").entered();
    let mut features = Vec::with_capacity(matches.count);
    let mut observations = Vec::with_capacity(matches.count);
    for (i, target) in matches.targets.iter().enumerate() {
        if let Some(t) = target {
            features.push(i);
            observations.push(PoseObservation {
                point: t.position,
                measurement: measurement(data, i),
            });
        }
    }
    let camera = Intrinsics::from(&data.camera);
    let options = PoseOptions {
        turn,
        ..PoseOptions::default()
    };
    let estimate = optimise_pose(&camera, initial, &observations, &options);
    for (feature, inlier) in features.iter().zip(&estimate.inliers) {
        if !inlier {
            matches.clear(*feature);
        }
    }
    (matches, estimate.camera_from_world, estimate.information)
}
