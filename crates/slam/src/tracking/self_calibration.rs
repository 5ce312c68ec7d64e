//! Estimates when the parts of a frame are exposed: the readout of a rolling shutter and the age of the depth image.
//!
//! Both leave a trace in the residuals of every frame in which the camera moves: pixels are off in proportion to their
//! row and speed, depths in proportion to their rate. Each frame adds its normal equations in the two unknowns, with the
//! pose eliminated (it could explain part of the trace), to those of all frames before.

use super::frame::{Observer, point_velocity};
use super::matching::Matches;
use super::pose::measurement;
use crate::sensor::Timing;
use nalgebra::{Matrix2, Matrix6x2, SMatrix, Vector2};
use stillpoint_estimation::{Intrinsics, linearise};
use stillpoint_geometry::{Se3, Vec6};
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::KeyframeData;

/// Standard deviations of what is not known before the first frame, s.
const PRIOR_SIGMA: [f64; 2] = [0.02, 0.02];
/// Residuals of neighbouring features and frames are not independent; one in this many counts.
const CORRELATION: f64 = 20.0;
/// Step of the numeric derivative of depths by the delay, s.
const STEP: f64 = 0.02;
/// Slower than this (px/s of a point at 1 m, roughly m/s and rad/s) nothing can be learned.
const MIN_SPEED: f64 = 0.05;

/// Running estimate of a camera's timing.
#[derive(Clone, Debug)]
pub(super) struct SelfCalibration {
    information: Matrix2<f64>,
    vector: Vector2<f64>,
    timing: Timing,
}

impl SelfCalibration {
    pub(super) fn new(start: Timing) -> Self {
        let information = Matrix2::from_diagonal(&Vector2::new(
            1.0 / (PRIOR_SIGMA[0] * PRIOR_SIGMA[0]),
            1.0 / (PRIOR_SIGMA[1] * PRIOR_SIGMA[1]),
        ));
        Self {
            information,
            vector: information * Vector2::new(start.readout, start.depth_delay),
            timing: start,
        }
    }

    /// The present estimate.
    pub(super) fn timing(&self) -> &Timing {
        &self.timing
    }

    /// Learns from the inliers of a tracked frame, which was measured with the present estimate.
    pub(super) fn learn(
        &mut self,
        observer: &Observer,
        frame: &RgbdFrame,
        data: &KeyframeData,
        matches: &Matches,
        camera_from_world: &Se3,
        velocity: &Vec6,
    ) {
        if velocity.norm() < MIN_SPEED {
            return;
        }
        let later = Timing {
            depth_delay: self.timing.depth_delay + STEP,
            ..self.timing
        };
        let reader = observer.depth_reader(frame, Some(velocity), &self.timing);
        let later_reader = observer.depth_reader(frame, Some(velocity), &later);
        let camera = Intrinsics::from(&data.camera);
        let mut pose = SMatrix::<f64, 6, 6>::zeros();
        let mut cross = Matrix6x2::zeros();
        let mut own = Matrix2::zeros();
        let (mut pose_b, mut own_b) = (Vec6::zeros(), Vector2::zeros());
        for (i, target) in matches.targets.iter().enumerate() {
            let Some(target) = target.filter(|t| t.landmark.is_some()) else {
                continue;
            };
            let p = camera_from_world.transform(&target.position);
            if p.z < 0.1 {
                continue;
            }
            let m = measurement(data, i);
            let l = linearise(&camera, &m, &p);
            let rate = point_velocity(velocity, &p);
            let share = observer.row_share(data.keypoints[i].y);
            // The measurement's derivative by the readout is its image velocity times its row's share; by the delay only
            // the depth changes.
            let by_readout = l
                .by_point
                .map(|j| -share * (j[0] * rate.x + j[1] * rate.y + j[2] * rate.z));
            let by_delay = if m.has_depth() {
                let depths = (
                    observer.depth_with(&reader, i),
                    observer.depth_with(&later_reader, i),
                );
                let (Some(now), Some(then)) = depths else {
                    continue;
                };
                -(then - now) / (STEP * now * now)
            } else {
                0.0
            };
            let w = [m.pixel_weight, m.pixel_weight, m.inverse_depth_weight];
            for k in 0..3 {
                let g = Vector2::new(by_readout[k], if k == 2 { by_delay } else { 0.0 });
                let j = Vec6::from_row_slice(&l.by_pose[k]);
                // The residual with another timing and pose is `e + g dt - j dx`.
                pose += j * j.transpose() * w[k];
                cross -= j * g.transpose() * w[k];
                own += g * g.transpose() * w[k];
                pose_b += j * (l.residual[k] * w[k]);
                own_b -= g * (l.residual[k] * w[k]);
            }
        }
        let Some(factor) = pose.cholesky() else {
            return;
        };
        let reduced = (own - cross.transpose() * factor.solve(&cross)) / CORRELATION;
        let reduced_b = (own_b - cross.transpose() * factor.solve(&pose_b)) / CORRELATION;
        let present = Vector2::new(self.timing.readout, self.timing.depth_delay);
        self.information += reduced;
        self.vector += reduced_b + reduced * present;
        if let Some(x) = self.information.cholesky().map(|c| c.solve(&self.vector)) {
            self.timing = Timing {
                readout: x.x.clamp(0.0, 0.05),
                depth_delay: x.y.clamp(-0.05, 0.05),
            };
        }
    }
}
