//! Pose-only optimisation from measurements of known points.

use crate::linearise::linearise;
use crate::{Intrinsics, KnownPlace, KnownTurn, Measurement};
use stillpoint_geometry::nalgebra::Matrix3x6;
use stillpoint_geometry::{Mat3, Mat6, Se3, Vec3, Vec6, robust, so3};

/// A measurement of a point with known world position.
#[derive(Clone, Copy, Debug)]
pub struct PoseObservation {
    /// World position, m.
    pub point: Vec3,
    /// The measurement.
    pub measurement: Measurement,
}

/// Effort of pose optimisation.
#[derive(Clone, Copy, Debug)]
pub struct PoseOptions {
    /// Rounds; after each all observations are tested against the gate again.
    pub rounds: usize,
    /// Final rounds without the robust kernel.
    pub plain_rounds: usize,
    /// Maximum number of iterations per round.
    pub iterations: usize,
    /// Factor on the squared chi-square gates (95 %); 1 for measurements with known noise.
    pub gate_scale: f64,
    /// Known rotation and optionally translation, as an additional measurement. Its gates are not applied.
    pub turn: Option<KnownTurn>,
    /// Known position of the camera, as an additional measurement.
    pub place: Option<KnownPlace>,
}

impl Default for PoseOptions {
    fn default() -> Self {
        // Four rounds of ten with outliers tested again after each are ORB-SLAM2's (Mur-Artal, Tardos 2017).
        Self {
            rounds: 4,
            plain_rounds: 2,
            iterations: 10,
            gate_scale: 1.0,
            turn: None,
            place: None,
        }
    }
}

/// Result of pose optimisation.
#[derive(Clone, Debug)]
pub struct PoseEstimate {
    /// The pose.
    pub camera_from_world: Se3,
    /// Per observation: within the gate at the final pose.
    pub inliers: Vec<bool>,
    /// Number of inliers.
    pub inlier_count: usize,
    /// Sum over inliers of `J^T W J` at the final pose, for a left perturbation `[translation; rotation]` of
    /// `camera_from_world`: the inverse covariance from the measurements and [`PoseOptions::turn`].
    pub information: Mat6,
    /// Mean squared residual of the inliers' pixel coordinates relative to their stated variance. 1 if that is right,
    /// slightly less after gating; 0 without inliers.
    pub pixel_variance: f64,
}

/// Finds the pose `camera_from_world` that minimises the sum of squared Mahalanobis residuals of pixel and inverse
/// depth, with the Huber kernel in the first rounds and outlier removal between rounds (Levenberg-Marquardt on SE(3)).
///
/// With fewer than three observations the initial pose is returned with no inliers.
#[must_use]
pub fn optimise_pose(
    camera: &Intrinsics,
    initial: &Se3,
    observations: &[PoseObservation],
    options: &PoseOptions,
) -> PoseEstimate {
    optimise_pose_in(Vec::new(), camera, initial, observations, options)
}

/// As [`optimise_pose`], reusing `memory` for [`PoseEstimate::inliers`].
#[must_use]
pub fn optimise_pose_in(
    memory: Vec<bool>,
    camera: &Intrinsics,
    initial: &Se3,
    observations: &[PoseObservation],
    options: &PoseOptions,
) -> PoseEstimate {
    let mut active = memory;
    active.clear();
    active.resize(observations.len(), true);
    let mut problem = Problem {
        camera,
        observations,
        active,
        gate_scale: options.gate_scale,
        turn: options.turn,
        place: options.place,
    };
    let mut pose = *initial;
    let mut inlier_count = 0;
    if observations.len() >= 3 {
        for round in 0..options.rounds {
            // Without outliers the kernel is unnecessary.
            let robust = round + options.plain_rounds < options.rounds;
            pose = problem.minimise(pose, robust, options.iterations);
            let (changed, count) = problem.classify(&pose);
            inlier_count = count;
            // With unchanged inliers and no kernel the minimum is unchanged.
            if count < 3 || (!changed && !robust) {
                break;
            }
        }
    }
    if inlier_count < 3 {
        // Fewer than three points do not determine the pose.
        problem.active.fill(false);
        inlier_count = 0;
    }
    problem.place = None;
    let information = problem.accumulate(&pose, false).h;
    let pixel_variance = problem.pixel_variance(&pose);
    PoseEstimate {
        camera_from_world: pose.normalized(),
        inliers: problem.active,
        inlier_count,
        information,
        pixel_variance,
    }
}

struct Problem<'a> {
    camera: &'a Intrinsics,
    observations: &'a [PoseObservation],
    active: Vec<bool>,
    gate_scale: f64,
    turn: Option<KnownTurn>,
    place: Option<KnownPlace>,
}

struct Normal {
    h: Mat6,
    b: Vec6,
    cost: f64,
}

impl Problem<'_> {
    fn minimise(&self, start: Se3, robust: bool, iterations: usize) -> Se3 {
        let mut pose = start;
        let mut lambda = 1e-6;
        let mut normal = self.accumulate(&pose, robust);
        for _ in 0..iterations {
            let mut h = normal.h;
            for i in 0..6 {
                // The absolute term is for unconstrained directions.
                h[(i, i)] += lambda * h[(i, i)] + 1e-12;
            }
            let Some(step) = h.cholesky().map(|c| c.solve(&normal.b)) else {
                break;
            };
            let candidate = Se3::exp(&step) * pose;
            let next = self.accumulate(&candidate, robust);
            if next.cost <= normal.cost {
                let gain = normal.cost - next.cost;
                (pose, normal) = (candidate, next);
                lambda = f64::max(lambda * 0.1, 1e-9);
                if step.norm_squared() < 1e-14 || gain < 1e-6 * normal.cost {
                    break;
                }
            } else {
                if step.norm_squared() < 1e-14 {
                    break;
                }
                lambda = f64::max(lambda * 100.0, 1e-4);
            }
        }
        pose
    }

    fn accumulate(&self, pose: &Se3, robust: bool) -> Normal {
        let (r, t) = (pose.rotation_matrix(), pose.translation);
        let mut sums = Sums::default();
        for (o, _) in self
            .observations
            .iter()
            .zip(&self.active)
            .filter(|(_, a)| **a)
        {
            let p = transform(&r, &t, &o.point);
            let gate = o.measurement.gate() * self.gate_scale;
            if p.z <= 1e-3 {
                // A point behind the camera costs as much as a point at the gate, and has no gradient.
                sums.cost += gate;
                continue;
            }
            let l = linearise(self.camera, &o.measurement, &p);
            let m = &o.measurement;
            let chi2 = m.pixel_weight
                * (l.residual[0] * l.residual[0] + l.residual[1] * l.residual[1])
                + m.inverse_depth_weight * l.residual[2] * l.residual[2];
            let (weight, cost) = if robust {
                (
                    robust::huber_weight(chi2, gate),
                    robust::huber_cost(chi2, gate),
                )
            } else {
                (1.0, chi2)
            };
            sums.cost += cost;
            let w = [
                weight * m.pixel_weight,
                weight * m.pixel_weight,
                weight * m.inverse_depth_weight,
            ];
            let ([u, v, d], e) = (&l.by_pose, &l.residual);
            sums.add([0, 1, 2, 3, 4, 5], u, e[0], w[0]);
            sums.add([0, 1, 2, 3, 4, 5], v, e[1], w[1]);
            if m.has_depth() {
                sums.add([2, 3, 4], d, e[2], w[2]);
            }
        }
        if let Some(turn) = &self.turn {
            sums.add_turn(turn, pose);
        }
        if let Some(place) = &self.place {
            sums.add_place(place, pose);
        }
        sums.finish()
    }

    fn pixel_variance(&self, pose: &Se3) -> f64 {
        let (r, t) = (pose.rotation_matrix(), pose.translation);
        let (mut sum, mut count) = (0.0, 0.0);
        for (o, _) in self.observations.iter().zip(&self.active).filter(|o| *o.1) {
            let p = transform(&r, &t, &o.point);
            if p.z <= 1e-3 {
                continue;
            }
            let [u, v, _] = linearise(self.camera, &o.measurement, &p).residual;
            sum += o.measurement.pixel_weight * (u * u + v * v);
            count += 2.0;
        }
        sum / f64::max(count, 1.0)
    }

    /// Tests every observation against its gate; returns whether any changed, and the number of inliers.
    fn classify(&mut self, pose: &Se3) -> (bool, usize) {
        let (r, t) = (pose.rotation_matrix(), pose.translation);
        let (mut changed, mut count) = (false, 0);
        for (o, active) in self.observations.iter().zip(&mut self.active) {
            let chi2 = o
                .measurement
                .chi2(self.camera, &transform(&r, &t, &o.point));
            let inlier = chi2 <= o.measurement.gate() * self.gate_scale;
            changed |= inlier != *active;
            count += usize::from(inlier);
            *active = inlier;
        }
        (changed, count)
    }
}

/// Lower triangle of `J^T W J`, row by row, and `J^T W e`.
#[derive(Default)]
struct Sums {
    h: [[f64; 6]; 6],
    b: [f64; 6],
    cost: f64,
}

impl Sums {
    /// Adds a row `j` of the Jacobian, which is nonzero only at these indices, ascending.
    #[inline(always)]
    fn add<const N: usize>(&mut self, places: [usize; N], j: &[f64; 6], e: f64, w: f64) {
        for (k, &row) in places.iter().enumerate() {
            let wj = j[row] * w;
            for &column in &places[..=k] {
                self.h[row][column] += wj * j[column];
            }
            self.b[row] += wj * e;
        }
    }

    fn add_turn(&mut self, turn: &KnownTurn, pose: &Se3) {
        let weight = 1.0 / (turn.sigma * turn.sigma);
        let offset = turn.offset(pose);
        for axis in 0..3 {
            self.h[3 + axis][3 + axis] += weight;
            self.b[3 + axis] += weight * offset[axis];
        }
        self.cost += weight * offset.norm_squared();
        if let Some(shift) = &turn.shift {
            let weight = 1.0 / (shift.sigma * shift.sigma);
            let offset = turn.shift_offset(shift, pose);
            for axis in 0..3 {
                self.h[axis][axis] += weight;
                self.b[axis] += weight * offset[axis];
            }
            self.cost += weight * offset.norm_squared();
        }
    }

    fn add_place(&mut self, place: &KnownPlace, pose: &Se3) {
        let (offset, seen) = place.offset(pose);
        let mut by_pose = Matrix3x6::zeros();
        by_pose.fixed_columns_mut::<3>(0).fill_with_identity();
        by_pose
            .fixed_columns_mut::<3>(3)
            .copy_from(&-so3::hat(&seen));
        let weighted = by_pose.transpose() * place.information;
        let (h, b) = (weighted * by_pose, weighted * offset);
        for row in 0..6 {
            for column in 0..=row {
                self.h[row][column] += h[(row, column)];
            }
            self.b[row] += b[row];
        }
        self.cost += offset.dot(&(place.information * offset));
    }

    fn finish(self) -> Normal {
        Normal {
            h: Mat6::from_fn(|r, c| self.h[r.max(c)][r.min(c)]),
            b: Vec6::from_row_slice(&self.b),
            cost: self.cost,
        }
    }
}

#[inline]
pub(crate) fn transform(r: &Mat3, t: &Vec3, p: &Vec3) -> Vec3 {
    r * p + t
}
