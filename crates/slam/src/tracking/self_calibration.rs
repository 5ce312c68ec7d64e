//! Estimates the readout time of a rolling shutter, from the exposure of an image's first row to the last.
//!
//! It is observable in static points of two consecutive frames: each is exposed early or late by its row's share of the
//! readout, while the camera moves with a different velocity in each frame. Velocities come from the points themselves,
//! as poses of single frames jitter. Each pair of frames contributes normal equations in the single unknown, with the
//! motion between them eliminated (it could explain part of the effect). Landmarks are unsuitable: they inherit the
//! readout assumed for their keyframes, and contradicting observations are not matched. Constant velocity carries no
//! information. The depth delay is not estimated: its effect is weak, and on simulated images a similar method
//! overestimates it by 6 to 18 ms. (docs/algorithm.md, readout.)

use crate::shutter::{Shutter, TYPICAL_DEPTH, point_velocity};
use crate::smoothing::CAUCHY;
use crate::timing::Timing;
use std::collections::VecDeque;
use stillpoint_geometry::nalgebra::{SMatrix, SVector};
use stillpoint_geometry::{Camera, Mat6, Se3, Vec2, Vec3, Vec6};

/// Number of correlated measurements that count as one, as errors of neighbouring features and frames are not
/// independent. Measured: with 8, 5 or 3 fr1_xyz_walkers has 7.4 mm instead of 6.7 (decision 28).
const CORRELATION: f64 = 20.0;
/// Velocity error common to all frames, and so of the readout, as a share: a hand trembles between the frames as well.
/// Measured: estimates for one camera differ by a tenth, 22.7 to 23.3 ms on fr1_rpy_walkers and 25.4 on fr1_xyz
/// (decision 28).
const VELOCITY_ERROR: f64 = 0.1;
/// Old frames together weigh as an estimate with this standard deviation, s: values learned while it was undecided
/// which surfaces move are forgotten once enough new ones were learned.
const MEMORY: f64 = 0.003;
/// Minimum speed (norm of the twist per second, m/s and rad/s) to learn from: chosen, as a readout of 20 ms moves the
/// image by 0.5 px then (f = 535 px, things at 1 m).
const MIN_SPEED: f64 = 0.05;
/// Maximum readout, s: chosen, beyond the 33 ms that a rolling shutter takes at 30 Hz, and the time of a frame at 20
/// Hz.
const MAX_READOUT: f64 = 0.05;
/// Maximum number of point pairs per pair of frames: 200 to 400 gave the figures of decision 28.
const MAX_PAIRS: usize = 400;
/// Minimum number of point pairs: the motion alone has six unknowns, of which this is five times as many; chosen.
const MIN_PAIRS: usize = 30;
/// Change of the motion below which its estimate has converged, m and rad: chosen, as it moves the image by 0.005 px (f
/// = 535 px, things at 1 m), far less than flow errs by.
const EXACT: f64 = 1e-5;
/// Number of reweighting iterations: chosen, as the initial motion is near, and Gauss-Newton is soon exact to
/// [`EXACT`].
const ROUNDS: usize = 4;
/// Number of consecutive intervals to learn from: the velocity at both of the middle frames takes [`SIDE`] of them on
/// either side.
const RUN: usize = 2 * SIDE + 1;
/// Intervals on either side of a frame for its velocity. Measured: of a readout of 20 ms one finds 24, two 21 and
/// three, with the weight by [`SMOOTH`], 20.5 where a hand trembles with 8 Hz (decision 28).
const SIDE: usize = 3;
/// Relative difference to a velocity from fewer intervals, as a share of the change of velocity, at which a measurement
/// has half the weight. Chosen; so weighted, a readout of 20 ms is found as 20.5 where a hand trembles with 8 Hz
/// (decision 28).
const SMOOTH: f64 = 0.03;
/// Maximum frame interval, s: slower frames cannot resolve a trembling hand. Chosen: 20 Hz has two and a half frames
/// per period of 8 Hz, with which the hand of decision 28 trembles.
const LONGEST: f64 = 0.05;

/// A point in two consecutive frames, as exposed.
#[derive(Clone, Copy, Debug)]
pub(super) struct RowPair {
    /// Undistorted pixel in the newer frame, and the row of the raw one.
    pub(super) now: (Vec2, f64),
    /// Likewise in the older frame.
    pub(super) before: (Vec2, f64),
    /// Depth in the newer frame, m.
    pub(super) z: f64,
    /// Standard deviation of the one pixel relative to the other, px.
    pub(super) sigma: f64,
}

/// Two consecutive frames and their common static points.
#[derive(Clone, Debug)]
pub(super) struct Between {
    pub(super) before_from_now: Se3,
    /// Interval, s.
    pub(super) seconds: f64,
    pub(super) pairs: Vec<RowPair>,
}

/// Running estimate of a camera's readout.
#[derive(Clone, Debug)]
pub(super) struct SelfCalibration {
    /// Information of all frames.
    information: f64,
    /// Information of remembered frames, and the same times the estimate.
    weight: f64,
    vector: f64,
    /// Information of the prior.
    known: f64,
    timing: Timing,
    /// The newest consecutive frames, oldest first.
    run: VecDeque<Between>,
    rows: Vec<Row>,
}

impl SelfCalibration {
    /// An estimate starting from a prior; one with zero deviation does not change.
    pub(super) fn new(start: Timing) -> Self {
        let information = 1.0 / (start.readout_sigma * start.readout_sigma).max(1e-12);
        Self {
            information,
            weight: information,
            vector: information * start.readout,
            known: information,
            timing: start,
            run: VecDeque::new(),
            rows: Vec::new(),
        }
    }

    /// The estimate for frames with reversed stamps.
    pub(super) fn mirrored(&self) -> Self {
        Self {
            vector: -self.vector,
            timing: Timing {
                readout: -self.timing.readout,
                depth_delay: -self.timing.depth_delay,
                ..self.timing
            },
            run: VecDeque::new(),
            ..self.clone()
        }
    }

    pub(super) fn timing(&self) -> &Timing {
        &self.timing
    }

    /// Adds the two newest frames, and learns from the pair in the middle of the sequence; `None` if the last frame has
    /// no pose. Returns the used points.
    pub(super) fn learn(
        &mut self,
        camera: &Camera,
        newest: Option<Between>,
    ) -> Option<Vec<RowPair>> {
        let Some(newest) = newest.filter(|b| b.seconds > 1e-6 && b.seconds < LONGEST) else {
            self.run.clear();
            return None;
        };
        let newest = self.refined(camera, newest);
        self.run.push_back(newest);
        if self.run.len() < RUN {
            return None;
        }
        let mut motions = [(Vec6::zeros(), 0.0); RUN];
        for (motion, between) in motions.iter_mut().zip(&self.run) {
            let now_from_before = between.before_from_now.inverse();
            *motion = (now_from_before.log() / between.seconds, between.seconds);
        }
        let runs = [&motions[..2 * SIDE], &motions[1..]];
        let both = runs.map(velocity_between::<{ 2 * SIDE }>);
        let coarse = runs.map(velocity_between::<{ 2 * SIDE - 2 }>);
        // The points are used up, but the motion is still needed.
        let middle = &mut self.run[RUN / 2];
        let middle = Between {
            pairs: std::mem::take(&mut middle.pairs),
            ..*middle
        };
        self.run.pop_front();
        if let ([Some(before), Some(now)], [Some(b), Some(n)]) = (both, coarse) {
            // If the hand trembles faster than the frame rate resolves, the velocity is unreliable.
            let unsure = size(&(before - b)) + size(&(now - n));
            let share = unsure / (SMOOTH * size(&(now - before)) + 1e-9);
            let trust = 1.0 / (1.0 + share * share);
            self.learn_from(camera, &middle, [&before, &now], trust);
        }
        Some(middle.pairs)
    }

    /// Replaces the motion by that of its own points. Pose errors are independent, up to centimetres where people leave
    /// few landmarks, and amplified thirtyfold in a velocity between consecutive frames; velocity errors bias the
    /// estimate towards 0.
    fn refined(&mut self, camera: &Camera, mut between: Between) -> Between {
        if between.pairs.len() < MIN_PAIRS {
            return between;
        }
        for _ in 0..ROUNDS {
            let velocity = between.before_from_now.inverse().log() / between.seconds;
            let velocities = [&velocity; 2];
            self.gather(camera, &between, velocities);
            let Some(step) = motion_of(&self.rows) else {
                break;
            };
            between.before_from_now = Se3::exp(&step) * between.before_from_now;
            if step.norm() < EXACT {
                break;
            }
        }
        between
    }

    /// Linearises the points of two frames with the camera velocities at the older and at the newer one.
    fn gather(&mut self, camera: &Camera, between: &Between, velocities: [&Vec6; 2]) {
        let readout = self.timing.readout;
        let step = between.pairs.len().div_ceil(MAX_PAIRS);
        let pairs = between.pairs.iter().step_by(step);
        let row = |p| Row::new(camera, p, &between.before_from_now, velocities, readout);
        self.rows.clear();
        self.rows.reserve(MAX_PAIRS);
        self.rows.extend(pairs.filter_map(row));
    }

    /// Learns from two frames with the camera velocities at the older and at the newer one, with weight `trust`, 0
    /// to 1.
    fn learn_from(
        &mut self,
        camera: &Camera,
        between: &Between,
        velocities: [&Vec6; 2],
        trust: f64,
    ) {
        let slow = velocities.iter().all(|v| v.norm() < MIN_SPEED);
        if slow || between.pairs.len() < MIN_PAIRS {
            return;
        }
        let readout = self.timing.readout;
        self.gather(camera, between, velocities);
        let Some((reduced, step)) = reduce(&self.rows) else {
            return;
        };
        let trust = trust / CORRELATION;
        let said = reduced * trust;
        self.information += said;
        // The prior keeps its weight.
        let most = (1.0 / (MEMORY * MEMORY) - said).max(self.known);
        let kept = (most / self.weight).min(1.0);
        self.weight = kept * self.weight + said;
        // The residuals use the current estimate, so the step is relative to it.
        self.vector = kept * self.vector + (step + reduced * readout) * trust;
        self.timing.readout = (self.vector / self.weight).clamp(0.0, MAX_READOUT);
        let chance = 1.0 / self.information.sqrt();
        self.timing.readout_sigma = libm::hypot(chance, VELOCITY_ERROR * self.timing.readout);
    }
}

/// Angular speed of points at [`TYPICAL_DEPTH`], rad/s.
fn size(velocity: &Vec6) -> f64 {
    let shift = velocity.fixed_rows::<3>(0).norm() / TYPICAL_DEPTH;
    libm::hypot(shift, velocity.fixed_rows::<3>(3).norm())
}

/// Velocity in the middle of at least `N` intervals, each given by its mean velocity and its length, s: that of the
/// polynomial with these means. A plain mean would attenuate trembling. `None` if an interval has no length.
fn velocity_between<const N: usize>(intervals: &[(Vec6, f64)]) -> Option<Vec6> {
    let middle = intervals.len() / 2;
    let mut ends = [[0.0; 2]; N];
    // In frames rather than seconds, for conditioning.
    let unit = intervals[middle].1;
    let first = middle - N / 2;
    let mut at = -intervals[first..middle].iter().map(|i| i.1).sum::<f64>();
    for (ends, (_, seconds)) in ends.iter_mut().zip(&intervals[first..]) {
        *ends = [at, at + seconds].map(|t| t / unit);
        at += seconds;
    }
    // Mean of each power of time over each interval; the value in the middle is the constant coefficient.
    let means = SMatrix::<f64, N, N>::from_fn(|power, k| {
        let raised = |x: f64| (0..=power).fold(1.0, |product, _| product * x);
        let [from, to] = ends[k];
        (raised(to) - raised(from)) / ((power as f64 + 1.0) * (to - from))
    });
    let mut value = SVector::<f64, N>::zeros();
    value[0] = 1.0;
    let weights = means.try_inverse()? * value;
    let sum = |sum: Vec6, (i, w): (&(Vec6, f64), &f64)| sum + i.0 * *w;
    let found = intervals[first..]
        .iter()
        .zip(weights.iter())
        .fold(Vec6::zeros(), sum);
    found.iter().all(|v| v.is_finite()).then_some(found)
}

/// A linearised pair: for a readout longer by `dt` and motion change `dx`, its residual is `residual + by_readout dt -
/// by_motion dx`, in standard deviations.
#[derive(Clone, Debug)]
struct Row {
    residual: [f64; 2],
    by_readout: [f64; 2],
    by_motion: [Vec6; 2],
}

impl Row {
    /// `None` if the point is behind the camera.
    fn new(
        camera: &Camera,
        pair: &RowPair,
        before_from_now: &Se3,
        [v_before, v_now]: [&Vec6; 2],
        readout: f64,
    ) -> Option<Self> {
        let [s_before, s_now] = [pair.before.1, pair.now.1].map(|y| Shutter::row_share(camera, y));
        // The point as exposed in the newer frame, at its stamp, at the older frame's stamp, and as exposed there.
        let exposed = camera.backproject(pair.now.0, pair.z);
        let late = point_velocity(v_now, &exposed) * s_now;
        let p = exposed - late * readout;
        let q = before_from_now.transform(&p);
        let moved = point_velocity(v_before, &q) * s_before;
        let there = q + moved * readout;
        if p.z < 0.1 || there.z < 0.1 {
            return None;
        }
        let back = before_from_now.rotation * -late;
        let (w, pixel) = (1.0 / there.z, camera.project(&there));
        let by_point = [
            Vec3::new(camera.fx * w, 0.0, -camera.fx * there.x * w * w),
            Vec3::new(0.0, camera.fy * w, -camera.fy * there.y * w * w),
        ];
        // Its position at the older frame's stamp affects its displacement until exposure.
        let turning: Vec3 = v_before.fixed_rows::<3>(3) * (s_before * readout);
        let by_place = by_point.map(|d| d + d.cross(&turning));
        let off = pair.before.0 - pixel;
        let by_pose = |d: &Vec3| {
            let turn = q.cross(d);
            Vec6::new(d.x, d.y, d.z, turn.x, turn.y, turn.z)
        };
        let scale = 1.0 / pair.sigma;
        Some(Self {
            residual: [off.x * scale, off.y * scale],
            by_readout: [0, 1].map(|k| -(by_point[k].dot(&moved) + by_place[k].dot(&back)) * scale),
            by_motion: by_place.map(|d| by_pose(&d) * scale),
        })
    }

    /// Cauchy weight with a readout longer by `dt` and motion change `dx`.
    fn weight(&self, dt: f64, dx: &Vec6) -> f64 {
        let off = |k: usize| self.residual[k] + self.by_readout[k] * dt - self.by_motion[k].dot(dx);
        let (x, y) = (off(0), off(1));
        1.0 / (1.0 + (x * x + y * y) / (CAUCHY * CAUCHY))
    }
}

/// Left-multiplied correction of the motion that fits the rows best; `None` if undetermined.
fn motion_of(rows: &[Row]) -> Option<Vec6> {
    let (mut jj, mut je) = (Mat6::zeros(), Vec6::zeros());
    for row in rows {
        let weight = row.weight(0.0, &Vec6::zeros());
        for k in 0..2 {
            let j = row.by_motion[k];
            jj += j * j.transpose() * weight;
            je += j * (row.residual[k] * weight);
        }
    }
    Some(jj.cholesky()?.solve(&je))
}

/// Information on the readout with the motion eliminated, and information times step.
fn reduce(rows: &[Row]) -> Option<(f64, f64)> {
    let (mut dt, mut dx) = (0.0, Vec6::zeros());
    let mut said = None;
    for _ in 0..ROUNDS {
        let (mut jj, mut jg, mut je) = (Mat6::zeros(), Vec6::zeros(), Vec6::zeros());
        let (mut gg, mut ge) = (0.0, 0.0);
        for row in rows {
            let weight = row.weight(dt, &dx);
            for k in 0..2 {
                let (e, g, j) = (row.residual[k], row.by_readout[k], &row.by_motion[k]);
                jj += j * j.transpose() * weight;
                jg += j * (g * weight);
                je += j * (e * weight);
                gg += g * g * weight;
                ge += g * e * weight;
            }
        }
        let factor = jj.cholesky()?;
        // Schur complement: effects explained by a different motion carry no information on the readout.
        let information = gg - jg.dot(&factor.solve(&jg));
        let vector = jg.dot(&factor.solve(&je)) - ge;
        if !(information > 0.0 && vector.is_finite()) {
            return None;
        }
        said = Some((information, vector));
        // Limits steps of poorly determined frames.
        dt = (vector / information).clamp(-MAX_READOUT, MAX_READOUT);
        dx = factor.solve(&(je + jg * dt));
    }
    said
}

#[cfg(test)]
mod tests;
