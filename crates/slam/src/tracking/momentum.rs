//! Motion model of the camera's position: bounded acceleration limits velocity changes between frames.
//!
//! A Kalman filter over position and velocity. In a fast turn a small translation and a small rotation look nearly the
//! same, above all where most of the image is new or moves; the recent velocity tells them apart.

use super::Tracker;
use super::motion::CameraMotion;
use super::vote::{SOME_MOVE, UNDECIDED};
use stillpoint_estimation::KnownPlace;
use stillpoint_geometry::{Mat3, Mat6, Se3, Vec3};

/// Acceleration of a camera, m/s^2, one standard deviation along each axis: one in a hand by 0.6 in the median and by
/// 1.7 at most in nine tenths of the time (fr1_xyz, fr1_rpy and kitchen, by their ground truth).
const ACCELERATION: f64 = 1.5;
/// Time within which a new acceleration is learned, s: decision 44. Without learning, a scene with a carrier that jolts
/// has 3.8 mm instead of 1.6 (decision 54).
const LEARNT_WITHIN: f64 = 0.3;
/// Largest relative change of the variance from a single frame, a factor, since single frames err. Chosen: that of a
/// position three standard deviations away, whose square is nine times the expected one.
const MOST_CHANGE: f64 = 8.0;
/// Largest acceleration that is learned, m/s^2: ten times [`ACCELERATION`], and about twice the 7 m/s^2 of a simulated
/// carrier that jolts (docs/simulator.md).
const MOST_ACCELERATION: f64 = 15.0;
/// Prior of the camera's velocity before anything is known, m/s, one standard deviation along each axis: wide enough
/// for nearly any camera. A prior of half a metre per second, which is much for a hand, biases the poses of a hand that
/// moves as fast.
const SPEED: f64 = 3.0;
/// Maximum Mahalanobis distance (standard deviations) between predicted and observed position; beyond it the pose did
/// not come from tracking. By chi-square with three degrees of freedom, chance exceeds it once in 65 000 frames.
const GATE_SIGMAS: f64 = 5.0;

/// Factor on pose errors beyond the variances of the matches: a walking person, or blur, shifts many of them alike.
/// Measured: with 1.0 the worst start has 58 mm, with 2.5 `kitchen` misses its bar (decision 44).
const POSE_FACTOR: f64 = 1.5;
/// Factor added in quadrature for an unsteady rotation under rolling shutter, per pixel of displacement of rows a
/// quarter of the image from the middle: poses that are trusted as much in a turn as at rest have a worst start of 74
/// mm (decision 44).
const UNSTEADY_FACTOR: f64 = 2.5;
/// Factor on errors of flow votes beyond the variances of the pairs, for the same reason, and as large as
/// [`POSE_FACTOR`].
const VOTE_FACTOR: f64 = 1.5;
/// Factor added in quadrature to the error of a pose or vote, times the moving share of the view. The more people are
/// in view, the more of them are taken for static, and all points of a person err alike from frame to frame (decision
/// 45; without it and [`UNSTEADY_FACTOR`] crowds have 1.1 to 1.9 times the error, decision 54).
const CROWD_FACTOR: f64 = 5.0;
/// Maximum rolling-shutter displacement by unsteady rotation for a pose to update the acceleration, px: chosen, as much
/// as flow errs by (`flow::SIGMA_PX`).
const CALM_PX: f64 = 0.5;
/// Duration after the start of a map with at most a tenth moving from which the scene counts as free of people, s
/// (decision 44).
const QUIET: f64 = 0.5;

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
    shift: Vec3,
    /// Covariance of `shift`, m^2.
    moved: Mat3,
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
    fn forgotten(&self) -> Self {
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

    /// Kalman update: the position is `off` from the prediction, m, with posterior `covariance`, m^2. If it `tells`,
    /// the innovation also updates the acceleration.
    pub(super) fn found(&self, off: &Vec3, covariance: Option<Mat3>, tells: bool) -> Momentum {
        let expected = &self.momentum;
        let Some((covariance, inverse)) = covariance.zip(expected.place.try_inverse()) else {
            return *expected;
        };
        let far = off.dot(&(inverse * off)) > GATE_SIGMAS * GATE_SIGMAS;
        if far || !covariance.sum().is_finite() {
            return Momentum {
                place: covariance,
                acceleration: expected.acceleration,
                ..Momentum::default()
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
            acceleration: if tells {
                self.accelerated(off, &covariance)
            } else {
                expected.acceleration
            },
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
        libm::sqrt(before * before * (1.0 + share * change)).clamp(ACCELERATION, MOST_ACCELERATION)
    }
}

impl Tracker {
    /// Predicted position and state at the current frame, in the newest view; `None` without tracking.
    fn expected(&self) -> Option<(Vec3, Expected)> {
        let last = self.state.tracked()?;
        let dt = self.front_end.clock.now() - last.time;
        let momentum = match self.knows_momentum() {
            true => *self.state.momentum()?,
            false => self.state.momentum()?.forgotten(),
        };
        let expected = momentum.expect(dt);
        Some((
            last.world_from_camera.translation + expected.shift,
            expected,
        ))
    }

    /// Records motion in a frame `age` seconds after the start of the map or submap.
    pub(super) fn note_quiet(&mut self, age: f64) {
        if age <= 0.0 {
            self.beginning.quiet = true;
        }
        if age < QUIET && self.moving_share > SOME_MOVE {
            self.beginning.quiet = false;
        }
    }

    /// Whether the velocity is reliably that of the camera: with people at the start of a map or submap it may be
    /// theirs until it is known which surfaces move. Always true when tracking backwards.
    pub(super) fn knows_momentum(&self) -> bool {
        let age = self
            .state
            .last()
            .map_or(0.0, |l| l.stamp - self.beginning.stamp);
        self.goes_back || age >= UNDECIDED || (self.beginning.quiet && age >= QUIET)
    }

    /// Position prior from the motion model, for a pose with the rotation of `camera_from_world`.
    pub(super) fn known_place(&self, camera_from_world: &Se3) -> Option<KnownPlace> {
        let (place, expected) = self.expected().filter(|_| !self.wheels_tell())?;
        let r = camera_from_world.rotation_matrix();
        let information = expected.place().try_inverse()?;
        let factor = self.pose_factor(self.unsteady_px(camera_from_world));
        Some(KnownPlace {
            in_a: place,
            in_b: Vec3::zeros(),
            information: r * information * r.transpose() * factor,
        })
    }

    /// Whether confirmed wheels give the translation: they notice a base that stops, which the motion model does not.
    fn wheels_tell(&self) -> bool {
        self.trusted_since_last().is_some_and(|k| k.shift.is_some())
    }

    /// Rolling-shutter displacement by unsteady rotation of rows a quarter of the image from the middle, px.
    fn unsteady_px(&self, camera_from_world: &Se3) -> f64 {
        let unsteady = self.motion_to(camera_from_world).unsteadiness();
        let camera = &self.front_end.observer.camera;
        self.front_end.shutter().sigma_px(camera.cy * 0.5, unsteady)
    }

    /// Squared factor on pose errors beyond their matches' variances.
    fn pose_factor(&self, unsteady_px: f64) -> f64 {
        let unsteady = UNSTEADY_FACTOR * unsteady_px;
        POSE_FACTOR * POSE_FACTOR + unsteady * unsteady + self.crowd_factor()
    }

    /// The part of it, squared, due to people taken for static. Zero when tracking backwards: relying on the motion
    /// model there would smooth a pose that follows a person, and hide it.
    fn crowd_factor(&self) -> f64 {
        if self.goes_back {
            return 0.0;
        }
        let crowd = CROWD_FACTOR * self.moving_share;
        crowd * crowd
    }

    /// Translation prior for the flow vote, from this frame to the last. `None` when tracking backwards, where votes
    /// must reveal which surfaces move.
    pub(super) fn known_shift(&self) -> Option<KnownPlace> {
        let last = self.state.tracked().filter(|_| !self.goes_back)?;
        let (_, expected) = self.expected().filter(|_| !self.wheels_tell())?;
        let r = last.world_from_camera.rotation_matrix().transpose();
        let information = expected.moved.try_inverse()?;
        let factor = VOTE_FACTOR * VOTE_FACTOR + self.crowd_factor();
        Some(KnownPlace {
            in_a: Vec3::zeros(),
            in_b: r * expected.shift,
            information: r * information * r.transpose() * factor,
        })
    }

    /// Camera motion after a pose was accepted, with the updated state; without `information` there is no measurement
    /// update.
    pub(super) fn moved_to(
        &self,
        camera_from_world: &Se3,
        information: Option<Mat6>,
    ) -> CameraMotion {
        let motion = self.motion_to(camera_from_world);
        let Some((place, expected)) = self.expected() else {
            return motion;
        };
        let unsteady_px = self.unsteady_px(camera_from_world);
        let factor = self.pose_factor(unsteady_px);
        let r = camera_from_world.rotation_matrix();
        let covariance = information.and_then(|information| {
            let mut sum = information / factor;
            let mut known = sum.fixed_view_mut::<3, 3>(0, 0);
            known += r * expected.place().try_inverse()? * r.transpose();
            let covariance = sum.try_inverse()?;
            Some(r.transpose() * covariance.fixed_view::<3, 3>(0, 0) * r)
        });
        let off = camera_from_world.inverse().translation - place;
        let tells = unsteady_px < CALM_PX;
        motion.with(expected.found(&off, covariance, tells))
    }
}

#[cfg(test)]
mod tests;
