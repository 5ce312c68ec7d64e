//! Estimates the readout of a rolling shutter: how long after its first row an image's last row is exposed.
//!
//! It leaves a trace in the residuals of every frame in which the camera moves: pixels are off in proportion to their
//! speed and to their row. Each frame adds its normal equations in the one unknown, with the pose eliminated (it could
//! explain part of the trace), to those of all frames before. The delay of the depth image is not estimated: its trace
//! is weak, and on simulated images the same method overestimates it by 6 to 18 ms.

use super::frame::Observer;
use super::shutter::{Shutter, point_velocity};
use crate::association::{Matches, measurement};
use crate::sensor::Timing;
use stillpoint_estimation::{Intrinsics, linearise};
use stillpoint_geometry::{Mat6, Se3, Vec6};
use stillpoint_map::KeyframeData;

/// Standard deviation of the readout before the first frame, s: rolling shutters take up to a frame's 33 ms.
const PRIOR_SIGMA: f64 = 0.02;
/// Residuals of neighbouring features and frames are not independent; one in this many counts.
const CORRELATION: f64 = 20.0;
/// Slower than this (norm of the twist per second, m/s and rad/s) nothing can be learned.
const MIN_SPEED: f64 = 0.05;
/// The longest readout that is believed, s.
const MAX_READOUT: f64 = 0.05;

/// Running estimate of a camera's readout.
#[derive(Clone, Debug)]
pub(super) struct SelfCalibration {
    information: f64,
    vector: f64,
    timing: Timing,
}

impl SelfCalibration {
    pub(super) fn new(start: Timing) -> Self {
        let information = 1.0 / (PRIOR_SIGMA * PRIOR_SIGMA);
        Self {
            information,
            vector: information * start.readout,
            timing: start,
        }
    }

    /// The estimate for frames whose stamps run backwards.
    pub(super) fn mirrored(&self) -> Self {
        Self {
            vector: -self.vector,
            timing: Timing {
                readout: -self.timing.readout,
                depth_delay: -self.timing.depth_delay,
            },
            ..self.clone()
        }
    }

    /// The present estimate.
    pub(super) fn timing(&self) -> &Timing {
        &self.timing
    }

    /// Standard deviation of the estimated readout, s.
    pub(super) fn sigma(&self) -> f64 {
        1.0 / self.information.sqrt()
    }

    /// Learns from the inliers of a tracked frame, which was measured with the present estimate while the camera moved
    /// by `velocity` (twist per second).
    pub(super) fn learn(
        &mut self,
        observer: &Observer,
        data: &KeyframeData,
        matches: &Matches,
        camera_from_world: &Se3,
        velocity: &Vec6,
    ) {
        if velocity.norm() < MIN_SPEED {
            return;
        }
        let camera = Intrinsics::from(&data.camera);
        // The residual with another readout and pose is `e + g dt - j dx`; sums of its normal equations.
        let (mut jj, mut jg, mut je) = (Mat6::zeros(), Vec6::zeros(), Vec6::zeros());
        let (mut gg, mut ge) = (0.0, 0.0);
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
            let share = Shutter::row_share(&observer.camera, f64::from(data.keypoints[i].y));
            let w = [m.pixel_weight, m.pixel_weight, m.inverse_depth_weight];
            for (k, w) in w.into_iter().enumerate() {
                // A measurement changes by the readout as it moves, in proportion to its row's share.
                let by_point = &l.by_point[k];
                let motion = by_point[0] * rate.x + by_point[1] * rate.y + by_point[2] * rate.z;
                let g = -share * motion;
                let j = Vec6::from_row_slice(&l.by_pose[k]);
                jj += j * j.transpose() * w;
                jg += j * (g * w);
                je += j * (l.residual[k] * w);
                gg += g * g * w;
                ge += g * l.residual[k] * w;
            }
        }
        let Some(factor) = jj.cholesky() else {
            return;
        };
        // The Schur complement: what another pose would explain as well teaches nothing about the readout.
        let reduced = (gg - jg.dot(&factor.solve(&jg))) / CORRELATION;
        let step = (jg.dot(&factor.solve(&je)) - ge) / CORRELATION;
        self.information += reduced;
        // The residuals were taken with the present estimate, so the step counts from there.
        self.vector += step + reduced * self.timing.readout;
        self.timing.readout = (self.vector / self.information).clamp(0.0, MAX_READOUT);
    }
}
