//! Fit of a rigid motion to pairs in both images.

use super::{RigidPair, both_ways};
use crate::linearise::{Linearised, by_world_point, linearise};
use crate::{Intrinsics, Measurement};
use stillpoint_geometry::{Mat3, Mat6, Se3, Vec3, Vec6, robust};

pub(super) struct Fit<'a> {
    pub(super) camera: &'a Intrinsics,
    pub(super) pairs: Vec<RigidPair>,
    pub(super) gate_scale: f64,
}

/// Normal equations of both images at one motion.
struct Normal {
    h: Mat6,
    b: Vec6,
    /// Sum over pairs of the outer products of their own `b`.
    outer: Mat6,
    cost: f64,
}

impl Fit<'_> {
    /// Squared residual divided by its gate, the larger one of both images.
    fn ratio(&self, motion: &(Mat3, Vec3), p: &RigidPair) -> f64 {
        let (in_b, in_a) = both_ways(motion, p);
        let ratio =
            |m: &Measurement, q: &Vec3| m.chi2(self.camera, q) / (m.gate() * self.gate_scale);
        ratio(&p.measurement_b, &in_b).max(ratio(&p.measurement_a, &in_a))
    }

    /// Sum over pairs: 1 for a perfect fit, falling to zero at the gate.
    pub(super) fn score(&self, b_from_a: &Se3) -> f64 {
        let motion = (b_from_a.rotation_matrix(), b_from_a.translation);
        let mut sum = 0.0;
        for p in &self.pairs {
            sum += (1.0 - self.ratio(&motion, p)).max(0.0);
        }
        sum
    }

    pub(super) fn inliers(&self, b_from_a: &Se3) -> Vec<bool> {
        self.agreeing(b_from_a, 1.0)
    }

    /// Pairs within their gates opened by a factor.
    pub(super) fn agreeing(&self, b_from_a: &Se3, opening: f64) -> Vec<bool> {
        let motion = (b_from_a.rotation_matrix(), b_from_a.translation);
        let within = |p: &RigidPair| self.ratio(&motion, p) <= opening;
        self.pairs.iter().map(within).collect()
    }

    /// Approximate combined standard deviation of both positions of a pair, m.
    pub(super) fn sigma_m(&self, p: &RigidPair) -> f64 {
        let sigma = |m: &Measurement, z: f64| {
            let along = if m.has_depth() {
                z * z / m.inverse_depth_weight.sqrt()
            } else {
                // Without depth the position is a landmark's, assumed accurate to two per cent.
                0.02 * z
            };
            along + z / (self.camera.fx * m.pixel_weight.sqrt())
        };
        sigma(&p.measurement_a, p.point_a.z) + sigma(&p.measurement_b, p.point_b.z)
    }

    /// Levenberg-Marquardt with the Huber kernel on the chosen pairs; `None` with fewer than four.
    pub(super) fn minimise(&self, start: &Se3, active: &[bool], iterations: usize) -> Option<Se3> {
        if active.iter().filter(|a| **a).count() < 4 {
            return None;
        }
        let (mut pose, mut lambda) = (*start, 1e-6);
        let mut normal = self.accumulate(&pose, active);
        for _ in 0..iterations {
            let mut h = normal.h;
            for i in 0..6 {
                h[(i, i)] += lambda * h[(i, i)] + 1e-9;
            }
            let Some(step) = h.cholesky().map(|c| c.solve(&normal.b)) else {
                break;
            };
            let candidate = Se3::exp(&step) * pose;
            let next = self.accumulate(&candidate, active);
            let small = step.norm_squared() < 1e-14;
            if next.cost <= normal.cost {
                let gain = normal.cost - next.cost;
                let settled = small || gain < 1e-6 * normal.cost;
                (pose, normal) = (candidate, next);
                lambda = f64::max(lambda * 0.1, 1e-9);
                if settled {
                    break;
                }
            } else if small {
                break;
            } else {
                lambda = f64::max(lambda * 100.0, 1e-4);
            }
        }
        pose.is_finite().then(|| pose.normalized())
    }

    /// The information of a motion from its inliers, and the factor by which it was reduced. With the gradient `g` of
    /// each pair, `sum g g^T` equals `sum J^T W J` in expectation if residuals are independent and of the stated size;
    /// the mean ratio of the two (White, Econometrica 1980, as one factor) is valid for points of any origin.
    pub(super) fn information(&self, pose: &Se3, active: &[bool]) -> Option<(Mat6, f64)> {
        let n = active.iter().filter(|a| **a).count() as f64;
        let normal = self.accumulate(pose, active);
        let factor = normal.h.cholesky()?.solve(&normal.outer).trace() / 6.0;
        // Six parameters were fitted to the pairs.
        let factor = (factor * n / (n - 6.0).max(1.0)).max(1.0);
        let information = normal.h / factor;
        let finite = information.iter().all(|v| v.is_finite());
        finite.then_some((information, factor))
    }

    fn accumulate(&self, b_from_a: &Se3, active: &[bool]) -> Normal {
        let mut normal = Normal {
            h: Mat6::zeros(),
            b: Vec6::zeros(),
            outer: Mat6::zeros(),
            cost: 0.0,
        };
        let motion = (b_from_a.rotation_matrix(), b_from_a.translation);
        let inverse_rotation = motion.0.transpose();
        for (p, _) in self.pairs.iter().zip(active).filter(|(_, a)| **a) {
            let (in_b, in_a) = both_ways(&motion, p);
            let mut own = Vec6::zeros();
            for (m, q, is_b) in [
                (&p.measurement_b, &in_b, true),
                (&p.measurement_a, &in_a, false),
            ] {
                let gate = m.gate() * self.gate_scale;
                if q.z <= 1e-3 {
                    // A point behind the camera costs as much as a point at the gate, and has no gradient.
                    normal.cost += gate;
                    continue;
                }
                let l = linearise(self.camera, m, q);
                let rows = if is_b {
                    l.by_pose
                } else {
                    by_inverse(&l, &inverse_rotation, &p.point_b)
                };
                let e = &l.residual;
                let w = [m.pixel_weight, m.pixel_weight, m.inverse_depth_weight];
                let chi2 = w[0] * (e[0] * e[0] + e[1] * e[1]) + w[2] * e[2] * e[2];
                normal.cost += robust::huber_cost(chi2, gate);
                let weight = robust::huber_weight(chi2, gate);
                for k in 0..if m.has_depth() { 3 } else { 2 } {
                    let j = Vec6::from(rows[k]);
                    let wj = j * (weight * w[k]);
                    normal.h += wj * j.transpose();
                    own += wj * e[k];
                }
            }
            normal.b += own;
            normal.outer += own * own.transpose();
        }
        normal
    }
}

/// The derivative of a prediction in A of a point of B by a left perturbation of `b_from_a`: with `q = T^-1 p`,
/// `(exp([rho; phi]) T)^-1 p ~ q - R^T (rho + phi x p)`.
fn by_inverse(l: &Linearised, inverse_rotation: &Mat3, p: &Vec3) -> [[f64; 6]; 3] {
    by_world_point(&l.by_point, inverse_rotation).map(|j| {
        [
            -j[0],
            -j[1],
            -j[2],
            -(p.y * j[2] - p.z * j[1]),
            -(p.z * j[0] - p.x * j[2]),
            -(p.x * j[1] - p.y * j[0]),
        ]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use stillpoint_geometry::Vec2;

    const CAMERA: Intrinsics = Intrinsics {
        fx: 520.0,
        fy: 515.0,
        cx: 320.0,
        cy: 240.0,
    };

    proptest! {
        /// The prediction in A, differentiated by the motion from A to B, compared with central differences.
        #[test]
        fn inverse_motion_derivative_matches_differences(twist in prop::array::uniform6(-0.8..0.8f64), x in -0.5..0.5f64, y in -0.4..0.4f64, z in 0.5..6.0f64) {
            let b_from_a = Se3::exp(&Vec6::from(twist));
            let q = Vec3::new(x * z, y * z, z);
            let p = b_from_a.transform(&q);
            let m = Measurement::new(Vec2::new(300.0, 200.0), 1.0, Some((2.0, 0.1)));
            let residual = |d: Vec6| {
                let moved = (Se3::exp(&d) * b_from_a).inverse().transform(&p);
                Vec3::from(linearise(&CAMERA, &m, &moved).residual)
            };
            let l = linearise(&CAMERA, &m, &q);
            let rows = by_inverse(&l, &b_from_a.rotation_matrix().transpose(), &p);
            for k in 0..6 {
                let mut d = Vec6::zeros();
                d[k] = 1e-6;
                let numeric = (residual(-d) - residual(d)) / 2e-6;
                for (row, j) in rows.iter().enumerate() {
                    let size = j.iter().fold(0.0, |a: f64, v| a.max(v.abs()));
                    prop_assert!((numeric[row] - j[k]).abs() < 1e-6 * size, "{row} {k}");
                }
            }
        }
    }
}
