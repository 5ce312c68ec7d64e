//! Smooths a sequence of poses: accelerations that neither hands nor robots reach are pose errors.
//!
//! Computes the most probable path if each pose has independent errors as large as the jitter, and accelerations are as
//! large as those over a tenth of a second. Translation and rotation are treated separately. Uses future frames, so it
//! is for offline use. Independent of the map. (docs/algorithm.md, the final trajectory.)

use stillpoint_geometry::{Se3, Vec3, so3};

/// Minimum assumed acceleration along each axis, m/s^2: that of a camera that is held still. Fixed at this value,
/// results were as good on all recordings; motion capture has 0.7 in the median (fr1_rpy_walkers, decision 42).
const USUAL: f64 = 1.0;
/// Minimum assumed angular acceleration about each axis, rad/s^2: that of a camera that is held still. Measured among
/// 3, 5, 10 and 20: smallest or second smallest errors from frame to frame (decision 42).
const USUAL_TURNING: f64 = 5.0;
/// Interval to either side over which accelerations are taken, s: longer than poses jitter, shorter than a hand moves
/// to and fro. Measured: with neighbouring frames instead, fr1_rpy_walkers has 21.2 mm instead of 20.8 (decision 42).
const LAG: f64 = 0.1;
/// Lower bound of pose errors, m and rad: chosen, below the least error of a simulated scene (0.45 mm of
/// `xyz`, decision 42).
const FLOOR: f64 = 1e-4;
/// Time to either side of a pose over which pose error and acceleration are estimated, s: chosen, as nine frames of 30
/// Hz on either side give a steady middle value.
const REACH: f64 = 0.3;
/// Minimum number of frames to either side for the same purpose: chosen, as the middle of 17 values is steady where
/// frames come slower than 30 Hz.
const REACH_FRAMES: usize = 8;
/// Minimum number of consecutive frames to estimate pose error and acceleration: chosen, as nine have five fourth
/// differences.
const LEAST: usize = 9;
/// The median of the norm of three normal numbers of deviation 1.
const MEDIAN_OF_NORM: f64 = 1.538;
/// Cauchy scale in standard deviations: an error of this size has half the weight. With 2.385 normal errors lose 5 % of
/// their efficiency (Holland and Welsch, Communications in Statistics 1977).
pub(crate) const CAUCHY: f64 = 2.4;
/// Number of reweighting iterations: chosen; a shock needs several to lose its weight, and each costs one linear
/// solution.
const ROUNDS: usize = 8;

/// Smooths consecutive poses `world_from_camera` at `stamps`, s, which increase by at least 0.1 ms. Fewer than nine are
/// unchanged.
pub(crate) fn smooth(stamps: &[f64], poses: &mut [Se3]) {
    if poses.len() < LEAST || poses.len() != stamps.len() {
        return;
    }
    let places: Vec<Vec3> = poses.iter().map(|p| p.translation).collect();
    let moved = corrections(stamps, &places, USUAL);
    let turned = corrections(stamps, &rolled_out(poses), USUAL_TURNING);
    for ((pose, moved), turned) in poses.iter_mut().zip(moved).zip(turned) {
        pose.translation += moved;
        pose.rotation = so3::exp(&turned) * pose.rotation;
    }
}

/// Rotations as a curve: the cumulative sum of rotations from pose to pose, rad in world axes. To first order, rotating
/// a pose moves its point of the curve.
fn rolled_out(poses: &[Se3]) -> Vec<Vec3> {
    let mut at = Vec3::zeros();
    let turns = poses.windows(2).map(|p| {
        at += so3::log(&(p[1].rotation * p[0].rotation.inverse()));
        at
    });
    std::iter::once(Vec3::zeros()).chain(turns).collect()
}

fn corrections(stamps: &[f64], points: &[Vec3], usual: f64) -> Vec<Vec3> {
    let (errors, limits) = Pace::of(stamps).judge(stamps, points, usual);
    let bends: Vec<[f64; 3]> = stamps.windows(3).map(bend).collect();
    let bent = |i: usize, of: &[Vec3]| {
        let [a, b, c] = bends[i];
        of[i] * a + of[i + 1] * b + of[i + 2] * c
    };
    let mut found = vec![Vec3::zeros(); points.len()];
    let weight = |off: f64, sigma: f64| {
        let off = off / (sigma * CAUCHY);
        1.0 / (sigma * sigma * (1.0 + off * off))
    };
    let mut smoothed = points.to_vec();
    // Start with equal weights: neither pose errors nor shocks are known yet.
    let mut weights: Vec<f64> = errors.iter().map(|e| weight(0.0, *e)).collect();
    let mut ties: Vec<f64> = limits.iter().map(|l| weight(0.0, *l)).collect();
    for _ in 0..ROUNDS {
        let mut system = Banded::new(&weights);
        for (i, shares) in bends.iter().enumerate() {
            system.add(i, shares, ties[i], &-bent(i, points));
        }
        found = system.solve();
        for (i, moved) in found.iter().enumerate() {
            smoothed[i] = points[i] + moved;
            weights[i] = weight(moved.norm(), errors[i]);
        }
        for (i, tie) in ties.iter_mut().enumerate() {
            *tie = weight(bent(i, &smoothed).norm(), limits[i]);
        }
    }
    found
}

struct Pace {
    lag: usize,
    reach: usize,
}

impl Pace {
    fn of(stamps: &[f64]) -> Self {
        let last = stamps.len() - 1;
        let frames = |seconds: f64| (seconds * last as f64 / (stamps[last] - stamps[0])).round();
        Self {
            lag: (frames(LAG) as usize).clamp(1, last / 2),
            reach: (frames(REACH) as usize).max(REACH_FRAMES),
        }
    }

    /// Standard deviations per axis of the error of each point, and of the acceleration at each point but the first and
    /// the last.
    fn judge(&self, stamps: &[f64], points: &[Vec3], usual: f64) -> (Vec<f64>, Vec<f64>) {
        let errors = self.errors(stamps, points);
        let limits = self.accelerations(stamps, points, &errors, usual);
        (errors, limits)
    }

    /// From fourth differences, in which camera motion cancels.
    fn errors(&self, stamps: &[f64], points: &[Vec3]) -> Vec<f64> {
        let fourth = |k: usize| {
            let times = &stamps[k..k + 5];
            // Divided differences (Newton), normalised to unit noise gain.
            let share = |i: usize| {
                let others = (0..5).filter(|j| *j != i);
                others.fold(1.0, |s, j| s / (times[i] - times[j]))
            };
            let shares = [0, 1, 2, 3, 4].map(share);
            let norm = shares.iter().map(|s| s * s).sum::<f64>().sqrt();
            let terms = shares.iter().zip(&points[k..]);
            let sum = terms.fold(Vec3::zeros(), |sum, (s, p)| sum + p * *s);
            sum.norm() / norm
        };
        let all: Vec<f64> = (0..points.len() - 4).map(fourth).collect();
        let near = |i: usize| self.median(&all, i.saturating_sub(2)) / MEDIAN_OF_NORM;
        (0..points.len()).map(|i| near(i).max(FLOOR)).collect()
    }

    /// Over [`LAG`], less the contribution of point errors.
    fn accelerations(
        &self,
        stamps: &[f64],
        points: &[Vec3],
        errors: &[f64],
        usual: f64,
    ) -> Vec<f64> {
        let lag = self.lag;
        let over = |k: usize| {
            let b = bend(&[stamps[k], stamps[k + lag], stamps[k + 2 * lag]]);
            let sum = points[k] * b[0] + points[k + lag] * b[1] + points[k + 2 * lag] * b[2];
            (sum.norm(), b.iter().map(|b| b * b).sum::<f64>().sqrt())
        };
        let count = points.len() - 2 * lag;
        let (all, noise): (Vec<f64>, Vec<f64>) = (0..count).map(over).unzip();
        let near = |i: usize| {
            let at = i.saturating_sub(lag);
            let seen = self.median(&all, at) / MEDIAN_OF_NORM;
            let by_error = self.median(&noise, at) * errors[i];
            (seen * seen - by_error * by_error)
                .max(usual * usual)
                .sqrt()
        };
        (1..points.len() - 1).map(near).collect()
    }

    /// Median of the values near an index; the window is shifted inwards at the ends.
    fn median(&self, values: &[f64], at: usize) -> f64 {
        let count = (2 * self.reach + 1).min(values.len());
        let first = at.saturating_sub(self.reach).min(values.len() - count);
        let mut near = values[first..first + count].to_vec();
        near.sort_unstable_by(f64::total_cmp);
        near[count / 2]
    }
}

/// Coefficients of three points in the second derivative at the middle one.
fn bend(times: &[f64]) -> [f64; 3] {
    let (before, after) = (times[1] - times[0], times[2] - times[1]);
    let c = 2.0 / (before + after);
    [c / before, -c / before - c / after, c / after]
}

/// Normal equations of a sequence of points, each coupled to the two before and after it.
struct Banded {
    /// Diagonal and the two subdiagonals by row: `lower[k][i]` is of row `i + k + 1`.
    diagonal: Vec<f64>,
    lower: [Vec<f64>; 2],
    right: Vec<Vec3>,
}

impl Banded {
    fn new(weights: &[f64]) -> Self {
        let n = weights.len();
        Self {
            diagonal: weights.to_vec(),
            lower: [vec![0.0; n], vec![0.0; n]],
            right: vec![Vec3::zeros(); n],
        }
    }

    /// Adds a measurement `value` of a linear combination of three points from `first` on.
    fn add(&mut self, first: usize, shares: &[f64; 3], weight: f64, value: &Vec3) {
        for (k, share) in shares.iter().enumerate() {
            self.diagonal[first + k] += weight * share * share;
            self.right[first + k] += value * (weight * share);
        }
        self.lower[0][first] += weight * shares[0] * shares[1];
        self.lower[0][first + 1] += weight * shares[1] * shares[2];
        self.lower[1][first] += weight * shares[0] * shares[2];
    }

    /// Root-free Cholesky decomposition: the matrix is positive definite, as every point is measured.
    fn solve(mut self) -> Vec<Vec3> {
        let n = self.right.len();
        for i in 0..n {
            let pivot = self.diagonal[i];
            let by = [self.lower[0][i] / pivot, self.lower[1][i] / pivot];
            let own = self.right[i];
            if i + 1 < n {
                self.diagonal[i + 1] -= by[0] * self.lower[0][i];
                self.lower[0][i + 1] -= by[0] * self.lower[1][i];
                self.right[i + 1] -= own * by[0];
            }
            if i + 2 < n {
                self.diagonal[i + 2] -= by[1] * self.lower[1][i];
                self.right[i + 2] -= own * by[1];
            }
            [self.lower[0][i], self.lower[1][i]] = by;
            self.right[i] = own / pivot;
        }
        for i in (0..n).rev() {
            for k in 0..2 {
                if i + k + 1 < n {
                    let later = self.right[i + k + 1] * self.lower[k][i];
                    self.right[i] -= later;
                }
            }
        }
        self.right
    }
}

#[cfg(test)]
mod tests;
