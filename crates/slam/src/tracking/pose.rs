//! Pose optimisation from matches.

use crate::association::{Matches, measurement};
use crate::evidence::Scatter;
use stillpoint_estimation::{
    Intrinsics, KnownPlace, KnownTurn, PoseObservation, PoseOptions, optimise_pose_in,
};
use stillpoint_geometry::{Mat6, Se3};
use stillpoint_map::KeyframeData;

#[derive(Clone, Copy, Default)]
pub(super) struct PosePrior {
    /// Rotation, and optionally translation, from sensors.
    pub(super) turn: Option<KnownTurn>,
    /// Position from the motion model.
    pub(super) place: Option<KnownPlace>,
}

#[derive(Clone, Copy)]
pub(super) struct Precision {
    /// Inverse covariance, for a left perturbation of `camera_from_world`.
    pub(super) information: Mat6,
    /// Scatter of the inliers; `None` for a flow vote.
    pub(super) scatter: Option<Scatter>,
}

/// Optimises poses from matches, reusing buffers.
#[derive(Default)]
pub(super) struct PoseSolver {
    features: Vec<usize>,
    observations: Vec<PoseObservation>,
    inliers: Vec<bool>,
}

impl PoseSolver {
    /// Optimises the pose `camera_from_world` from all matches and removes outliers.
    pub(super) fn solve(
        &mut self,
        data: &KeyframeData,
        initial: &Se3,
        matches: Matches,
        prior: PosePrior,
    ) -> (Matches, Se3) {
        let (matches, pose, _) = self.solve_with_precision(data, initial, matches, prior);
        (matches, pose)
    }

    /// Likewise, with the precision of the pose.
    pub(super) fn solve_with_precision(
        &mut self,
        data: &KeyframeData,
        initial: &Se3,
        mut matches: Matches,
        prior: PosePrior,
    ) -> (Matches, Se3, Precision) {
        let _span = tracing::info_span!("pose").entered();
        self.features.clear();
        self.observations.clear();
        for (i, target) in matches.targets.iter().enumerate() {
            if let Some(t) = target {
                self.features.push(i);
                self.observations.push(PoseObservation {
                    point: t.position,
                    measurement: measurement(data, i),
                });
            }
        }
        let camera = Intrinsics::from(&data.camera);
        let options = PoseOptions {
            turn: prior.turn,
            place: prior.place,
            ..PoseOptions::default()
        };
        let memory = std::mem::take(&mut self.inliers);
        let estimate = optimise_pose_in(memory, &camera, initial, &self.observations, &options);
        for (feature, inlier) in self.features.iter().zip(&estimate.inliers) {
            if !inlier {
                matches.clear(*feature);
            }
        }
        self.inliers = estimate.inliers;
        let precision = Precision {
            information: estimate.information,
            scatter: Some(Scatter {
                variance: estimate.pixel_variance,
                count: estimate.inlier_count as u32,
            }),
        };
        (matches, estimate.camera_from_world, precision)
    }
}
