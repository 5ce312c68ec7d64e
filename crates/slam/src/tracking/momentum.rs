//! Motion model of the camera's position: bounded acceleration limits velocity changes between frames.
//!
//! A Kalman filter over position and velocity. In a fast turn a small translation and a small rotation look nearly the
//! same, above all where most of the image is new or moves; the recent velocity tells them apart.

use stillpoint_geometry::{Mat3, Vec3};

/// Acceleration of a camera, m/s^2, one standard deviation along each axis: one in a hand by 0.6 in the median and by
/// 1.7 at most in nine tenths of the time (fr1_xyz, fr1_rpy and kitchen, by their ground truth).
const ACCELERATION: f64 = 1.5;
/// Time within which a new acceleration is learned, s: decision 44. Without learning, a scene with a carrier that jolts
/// has 3.8 mm instead of 1.6 (decision 54).
const LEARNT_WITHIN: f64 = 0.3;
/// Largest relative change of the variance from a single frame, a factor, since single frames err. Chosen: that of a
/// position three standard deviations away, whose square is nine times the expected one. Measured: without it one start
/// of fr1_rpy_walkers has 47 mm instead of 10 (decision 58).
const MOST_CHANGE: f64 = 8.0;
/// Prior of the camera's velocity before anything is known, m/s, one standard deviation along each axis: wide enough
/// for nearly any camera. A prior of half a metre per second, which is much for a hand, biases the poses of a hand that
/// moves as fast.
const SPEED: f64 = 3.0;
/// Maximum Mahalanobis distance (standard deviations) between predicted and observed position; beyond it the pose
/// is taken for wrong. By chi-square with three degrees of freedom, chance exceeds it once in 65 000 frames.
const GATE_SIGMAS: f64 = 5.0;

/// Motion state at a pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Momentum {
    /// In the map, m/s.
    velocity: Vec3,
    /// Covariance of the position, m^2.
    place: Mat3,
    /// Covariance of position (rows) and velocity (columns), m^2/s.
    cross: Mat3,
    /// Covariance of the velocity, m^2/s^2.
    spread: Mat3,
    /// Learned acceleration, m/s^2, one standard deviation along each axis.
    acceleration: f64,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    /// Predicted translation, in the map, m.
    pub(super) shift: Vec3,
    /// Covariance of `shift`, m^2.
    pub(super) moved: Mat3,
    /// State without a new measurement.
    momentum: Momentum,
    /// s.
    dt: f64,
}

impl Default for Momentum {
    fn default() -> Self {
        Self {
            velocity: Vec3::zeros(),
            place: Mat3::zeros(),
            cross: Mat3::zeros(),
            spread: Mat3::from_diagonal_element(SPEED * SPEED),
            acceleration: ACCELERATION,
        }
    }
}

impl Momentum {
    /// Prediction `dt` seconds later, with an acceleration at an unknown time in between.
    pub(super) fn expect(&self, dt: f64) -> Expected {
        let change = self.acceleration * dt;
        let noise = |scale: f64| Mat3::from_diagonal_element(change * change * scale);
        let moved = self.spread * (dt * dt) + noise(0.25 * dt * dt);
        Expected {
            shift: self.velocity * dt,
            moved,
            momentum: Self {
                velocity: self.velocity,
                place: self.place + (self.cross + self.cross.transpose()) * dt + moved,
                cross: self.cross + self.spread * dt + noise(0.5 * dt),
                spread: self.spread + noise(1.0),
                acceleration: self.acceleration,
            },
            dt,
        }
    }

    /// A nearly uninformative state, for when the velocity may be that of a moving object.
    pub(super) fn forgotten(&self) -> Self {
        Self {
            place: self.place,
            acceleration: self.acceleration,
            ..Self::default()
        }
    }

    /// The state for tracking backwards.
    pub(super) fn reversed(&self) -> Self {
        Self {
            velocity: -self.velocity,
            cross: -self.cross,
            ..*self
        }
    }
}

impl Expected {
    pub(super) fn place(&self) -> &Mat3 {
        &self.momentum.place
    }

    /// Kalman update: the position is `off` from the prediction, m, with posterior `covariance`, m^2. The innovation
    /// also updates the acceleration.
    pub(super) fn found(&self, off: &Vec3, covariance: Option<Mat3>) -> Momentum {
        let expected = &self.momentum;
        let covariance = covariance.filter(|c| c.sum().is_finite());
        let Some((covariance, inverse)) = covariance.zip(expected.place.try_inverse()) else {
            return *expected;
        };
        if off.dot(&(inverse * off)) > GATE_SIGMAS * GATE_SIGMAS {
            // The velocity stays. If the camera was hit, the acceleration grows until the next poses are near enough.
            return Momentum {
                place: covariance,
                cross: Mat3::zeros(),
                acceleration: self.accelerated(off, &covariance),
                ..*expected
            };
        }
        let gain = expected.cross.transpose() * inverse;
        let learnt = gain * (expected.place - covariance) * gain.transpose();
        let spread = expected.spread - learnt;
        Momentum {
            velocity: expected.velocity + gain * off,
            place: covariance,
            cross: covariance * gain.transpose(),
            spread: (spread + spread.transpose()) * 0.5,
            acceleration: self.accelerated(off, &covariance),
        }
    }

    /// Acceleration, m/s^2, updated from the ratio of squared innovation to its expectation.
    fn accelerated(&self, off: &Vec3, covariance: &Mat3) -> f64 {
        let before = self.momentum.acceleration;
        let expected = (self.momentum.place - covariance).trace();
        if expected <= 0.0 {
            return before;
        }
        let change = (off.norm_squared() / expected - 1.0).min(MOST_CHANGE);
        let share = (self.dt / LEARNT_WITHIN).min(1.0);
        libm::sqrt(before * before * (1.0 + share * change)).max(ACCELERATION)
    }
}

#[cfg(test)]
mod tests;
