//! The pose from matches.

use super::matching::Matches;
use stillpoint_estimation::{Intrinsics, Measurement, PoseObservation, PoseOptions, optimise_pose};
use stillpoint_geometry::{Camera, Mat6, Se3};
use stillpoint_map::KeyframeData;

/// What a feature measured, for estimation.
pub(crate) fn measurement(data: &KeyframeData, feature: usize) -> Measurement {
    let depth = data
        .depth(feature)
        .map(|z| (z, f64::from(data.depth_sigmas[feature])));
    Measurement::new(
        data.position(feature),
        f64::from(data.sigma_px[feature]),
        depth,
    )
}

/// What a feature would have measured with another camera at the same place, for problems in which several keyframes take part:
/// those of a map that was loaded may have been calibrated in another way.
pub(crate) fn measurement_in(data: &KeyframeData, feature: usize, camera: &Camera) -> Measurement {
    let own = &data.camera;
    let m = measurement(data, feature);
    // Almost always. What goes there and back would not come back to the same bits.
    if own == camera {
        return m;
    }
    // Both of one size on the sensor, in pixels of each.
    let scale = camera.fx / own.fx;
    Measurement {
        pixel: camera.project(&own.ray(m.pixel)),
        pixel_weight: m.pixel_weight / (scale * scale),
        ..m
    }
}

/// Optimises the pose `camera_from_world` from all matches and takes out those that do not agree with it.
pub(super) fn solve(data: &KeyframeData, initial: &Se3, matches: Matches) -> (Matches, Se3) {
    let (matches, pose, _) = solve_with_information(data, initial, matches);
    (matches, pose)
}

/// The same, with the information of the pose: the inverse of its covariance, for a left perturbation of `camera_from_world`.
pub(super) fn solve_with_information(
    data: &KeyframeData,
    initial: &Se3,
    mut matches: Matches,
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
    let estimate = optimise_pose(&camera, initial, &observations, &PoseOptions::default());
    for (feature, inlier) in features.iter().zip(&estimate.inliers) {
        if !inlier {
            matches.clear(*feature);
        }
    }
    (matches, estimate.camera_from_world, estimate.information)
}
