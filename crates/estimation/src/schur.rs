//! The normal equations of bundle adjustment with points eliminated.

use crate::BundleProblem;
use crate::linearise::{Linearised, by_world_point, linearise};
use crate::pose::transform;
use crate::reduced::{Method, Plan, solve_by_factor, solve_by_gradients};
use nalgebra::{DMatrix, DVector};
use stillpoint_geometry::{Mat3, Vec3, Vec6, robust};

/// Cross block `J_pose^T W J_point` of one observation, 6x3, row by row.
pub(crate) type Cross = [[f64; 3]; 6];

/// One point's share of the normal equations.
pub(crate) struct PointBlock {
    h: Mat3,
    pub(crate) b: Vec3,
    /// Range of its cross blocks in [`System::cross`].
    pub(crate) cross: std::ops::Range<usize>,
}

/// The undamped normal equations at one linearisation point.
#[derive(Default)]
pub(crate) struct System {
    pub(crate) pose_h: Vec<[[f64; 6]; 6]>,
    pub(crate) pose_b: Vec<[f64; 6]>,
    pub(crate) points: Vec<PointBlock>,
    /// Cross blocks, point by point, and the pose of each. Separate, as most passes filter by pose.
    pub(crate) cross: Vec<Cross>,
    pub(crate) pose_of: Vec<u32>,
}

/// A step of poses (left perturbations `[translation; rotation]`) and points (m).
pub(crate) struct Step {
    pub(crate) poses: Vec<Vec6>,
    pub(crate) points: Vec<Vec3>,
}

/// Linearises all active observations, with the Huber weights of the current residuals. Reuses memory: allocating the
/// cross blocks of a large map takes as long as computing them.
pub(crate) fn build(problem: &BundleProblem, active: &[bool], system: &mut System) {
    let free = problem.free_poses;
    let frames: Vec<(Mat3, Vec3)> = problem
        .poses
        .iter()
        .map(|p| (p.rotation_matrix(), p.translation))
        .collect();
    system.clear(free);
    system.cross.reserve(problem.observations.len());
    let mut at = 0;
    for (index, point) in problem.points.iter().enumerate() {
        let mut h = [[0.0; 3]; 3];
        let mut b = [0.0; 3];
        let first = system.cross.len();
        // Observations are sorted by point, so one pass suffices.
        while let Some(o) = problem
            .observations
            .get(at)
            .filter(|o| o.point as usize == index)
        {
            let is_active = active[at];
            at += 1;
            if !is_active {
                continue;
            }
            let pose = o.pose as usize;
            let (r, t) = &frames[pose];
            let p = transform(r, t, point);
            if p.z <= 1e-3 {
                continue;
            }
            let m = &o.measurement;
            let l = linearise(&problem.camera, m, &p);
            let e = &l.residual;
            let chi2 =
                m.pixel_weight * (e[0] * e[0] + e[1] * e[1]) + m.inverse_depth_weight * e[2] * e[2];
            let weight = robust::huber_weight(chi2, m.gate());
            let w = [
                weight * m.pixel_weight,
                weight * m.pixel_weight,
                weight * m.inverse_depth_weight,
            ];
            let rows = if m.has_depth() { 3 } else { 2 };
            let jp = by_world_point(&l.by_point, r);
            for k in 0..rows {
                add_outer(&mut h, &jp[k], &jp[k], w[k]);
                add_scaled(&mut b, &jp[k], w[k] * e[k]);
            }
            // Fixed poses contribute to the points only.
            if pose < free {
                let (pose_h, pose_b) = (&mut system.pose_h[pose], &mut system.pose_b[pose]);
                let cross = add_to_pose(pose_h, pose_b, &l, &jp, (rows, w));
                system.cross.push(cross);
                system.pose_of.push(o.pose);
            }
        }
        system.points.push(PointBlock {
            h: Mat3::from_fn(|r, c| h[r][c]),
            b: Vec3::from_row_slice(&b),
            cross: first..system.cross.len(),
        });
    }
}

/// Adds the first `rows` rows of an observation to its pose's share; returns its cross block.
// Not inlined, so that the compiler knows that the arguments do not alias and vectorises the loop.
#[inline(never)]
fn add_to_pose(
    h: &mut [[f64; 6]; 6],
    b: &mut [f64; 6],
    l: &Linearised,
    by_point: &[[f64; 3]; 3],
    (rows, weights): (usize, [f64; 3]),
) -> Cross {
    let mut cross = [[0.0; 3]; 6];
    for k in 0..rows {
        let w = weights[k];
        add_outer(h, &l.by_pose[k], &l.by_pose[k], w);
        add_scaled(b, &l.by_pose[k], w * l.residual[k]);
        add_outer(&mut cross, &l.by_pose[k], &by_point[k], w);
    }
    cross
}

#[inline]
fn add_outer<const R: usize, const C: usize>(
    m: &mut [[f64; C]; R],
    a: &[f64; R],
    b: &[f64; C],
    w: f64,
) {
    for (row, ai) in m.iter_mut().zip(a) {
        let s = ai * w;
        for (v, bj) in row.iter_mut().zip(b) {
            *v += s * bj;
        }
    }
}

#[inline]
fn add_scaled<const N: usize>(v: &mut [f64; N], a: &[f64; N], s: f64) {
    for (x, y) in v.iter_mut().zip(a) {
        *x += y * s;
    }
}

/// `a * m` for a cross block and a symmetric 3x3 matrix.
#[inline]
pub(crate) fn times(a: &Cross, m: &Mat3) -> Cross {
    let mut out = [[0.0; 3]; 6];
    for (o, r) in out.iter_mut().zip(a) {
        for (c, v) in o.iter_mut().enumerate() {
            *v = r[0] * m[(0, c)] + r[1] * m[(1, c)] + r[2] * m[(2, c)];
        }
    }
    out
}

impl System {
    fn clear(&mut self, free: usize) {
        self.pose_h.clear();
        self.pose_h.resize(free, [[0.0; 6]; 6]);
        self.pose_b.clear();
        self.pose_b.resize(free, [0.0; 6]);
        self.points.clear();
        self.cross.clear();
        self.pose_of.clear();
    }

    /// The cross blocks of a point, each with its pose.
    fn crosses(&self, p: &PointBlock) -> impl Iterator<Item = (usize, &Cross)> + Clone {
        let poses = self.pose_of[p.cross.clone()].iter();
        poses.map(|i| *i as usize).zip(&self.cross[p.cross.clone()])
    }

    /// Solves the damped equations; `None` if the reduced system is not positive definite.
    pub(crate) fn solve(&self, plan: &Plan, lambda: f64) -> Option<Step> {
        let inverses: Vec<Option<Mat3>> = self
            .points
            .iter()
            .map(|p| {
                let mut h = p.h;
                for i in 0..3 {
                    h[(i, i)] += lambda * h[(i, i)] + 1e-9;
                }
                h.try_inverse()
            })
            .collect();
        let poses = match &plan.method {
            Method::Dense => self.solve_dense(lambda, &inverses)?,
            Method::Factor(p) => solve_by_factor(self, p, lambda, &inverses)?,
            Method::Iterate(p) => solve_by_gradients(self, p, lambda, &inverses)?,
        };
        let points = self
            .points
            .iter()
            .zip(&inverses)
            .map(|(p, inverse)| {
                let Some(inverse) = inverse else {
                    return Vec3::zeros();
                };
                let mut b = p.b;
                for (pose, c) in self.crosses(p) {
                    let s = &poses[pose];
                    for (row, si) in c.iter().zip(s.iter()) {
                        b.x -= row[0] * si;
                        b.y -= row[1] * si;
                        b.z -= row[2] * si;
                    }
                }
                inverse * b
            })
            .collect();
        Some(Step { poses, points })
    }

    fn solve_dense(&self, lambda: f64, inverses: &[Option<Mat3>]) -> Option<Vec<Vec6>> {
        let free = self.pose_h.len();
        // Lower triangle of blocks of the reduced camera system; block (i, j) with i >= j at i (i + 1) / 2 + j.
        let mut blocks = vec![[[0.0; 6]; 6]; free * (free + 1) / 2];
        let mut rhs = self.pose_b.clone();
        for (i, h) in self.pose_h.iter().enumerate() {
            let d = &mut blocks[i * (i + 1) / 2 + i];
            *d = *h;
            for k in 0..6 {
                d[k][k] += lambda * h[k][k] + 1e-9;
            }
        }
        let mut crossed = Vec::new();
        for (p, inverse) in self.points.iter().zip(inverses) {
            let Some(inverse) = inverse else { continue };
            crossed.clear();
            crossed.extend(self.crosses(p).map(|(j, b)| (j, across(b))));
            for (i, a) in self.crosses(p) {
                let w = times(a, inverse);
                for (r, row) in w.iter().enumerate() {
                    rhs[i][r] -= row[0] * p.b.x + row[1] * p.b.y + row[2] * p.b.z;
                }
                for (j, b) in crossed.iter().filter(|(j, _)| *j <= i) {
                    subtract_product(&mut blocks[i * (i + 1) / 2 + j], &w, b);
                }
            }
        }
        if free == 0 {
            return Some(Vec::new());
        }
        let n = 6 * free;
        let mut s = DMatrix::<f64>::zeros(n, n);
        let mut b = DVector::<f64>::zeros(n);
        for i in 0..free {
            for r in 0..6 {
                b[6 * i + r] = rhs[i][r];
            }
            for j in 0..=i {
                let block = &blocks[i * (i + 1) / 2 + j];
                for (r, row) in block.iter().enumerate() {
                    for (c, v) in row.iter().enumerate() {
                        s[(6 * i + r, 6 * j + c)] = *v;
                    }
                }
            }
        }
        // nalgebra's Cholesky reads the lower triangle only and does not select kernels at run time.
        let x = s.cholesky()?.solve(&b);
        x.iter().all(|v| v.is_finite()).then(|| {
            (0..free)
                .map(|i| Vec6::from_fn(|r, _| x[6 * i + r]))
                .collect()
        })
    }
}

/// A transposed cross block, 3x6.
pub(crate) type Across = [[f64; 6]; 3];

#[inline]
pub(crate) fn across(b: &Cross) -> Across {
    let mut out = [[0.0; 6]; 3];
    for (c, row) in b.iter().enumerate() {
        for (k, v) in row.iter().enumerate() {
            out[k][c] = *v;
        }
    }
    out
}

/// `s -= w * b^T` for 6x3 blocks, the second one transposed, so that whole rows are updated.
// Not inlined, so that the compiler knows that the arguments do not alias and vectorises the loop.
#[inline(never)]
pub(crate) fn subtract_product(s: &mut [[f64; 6]; 6], w: &Cross, b: &Across) {
    for (row, wr) in s.iter_mut().zip(w) {
        for c in 0..6 {
            row[c] -= wr[0] * b[0][c] + wr[1] * b[1][c] + wr[2] * b[2][c];
        }
    }
}
