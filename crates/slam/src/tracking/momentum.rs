//! The camera's momentum: whatever carries it, its velocity changes by what that can accelerate it by, and not by what a frame errs by.
//!
//! A Kalman filter over place and velocity. In a fast turn a shift by centimetres and a part of a degree look nearly the same, above all where most of what is seen
//! is new or walks; the velocity of the tenths of a second before tells them apart.

use super::Tracker;
use super::motion::CameraMotion;
use super::vote::{SOME_MOVE, UNDECIDED};
use stillpoint_estimation::KnownPlace;
use stillpoint_geometry::{Mat3, Mat6, Se3, Vec3};

/// A camera is accelerated by so much, m/s^2, one standard deviation along each axis: one in a hand by 0.6 in the median and by
/// 1.7 at most in nine tenths of the time (fr1_xyz, fr1_rpy and kitchen, by their ground truth).
const ACCELERATION: f64 = 1.5;
/// Time within which a new acceleration is learned, s: decision 44. Without learning, a scene with a carrier that jolts has 3.8 mm instead of 1.6
/// (decision 54).
const LEARNT_WITHIN: f64 = 0.3;
/// Largest relative change of the variance that one frame may suggest, a factor: single frames err. Chosen: that of a place three standard deviations
/// away, whose square is nine times the expected one.
const MOST_CHANGE: f64 = 8.0;
/// Largest acceleration that is learned, m/s^2: ten times [`ACCELERATION`], and about twice the 7 m/s^2 of a simulated carrier that jolts
/// (docs/simulator.md).
const MOST_ACCELERATION: f64 = 15.0;
/// Prior of the camera's velocity before anything is known, m/s, one standard deviation along each axis: wide enough for nearly any camera. A prior of half
/// a metre per second, which is much for a hand, biases the poses of a hand that moves as fast.
const SPEED: f64 = 3.0;
/// A place that is farther from where it was expected than so many standard deviations was found otherwise than by following: by chi-square with
/// three degrees of freedom, chance does so once in 65 000 frames.
const GATE_SIGMAS: f64 = 5.0;

/// Factor by which the error of a pose exceeds what the variances of its matches tell: a person who walks, or blur, shifts many of them alike.
/// Measured: with 1.0 the worst start has 58 mm, with 2.5 `kitchen` misses its bar (decision 44).
const POSE_FACTOR: f64 = 1.5;
/// Factor that an unsteady shutter adds in quadrature to the error of a pose, per pixel by which it shifts the rows a quarter of the image from the
/// middle: poses that are trusted as much in a turn as at rest have a worst start of 74 mm (decision 44).
const UNSTEADY_FACTOR: f64 = 2.5;
/// Factor by which the error of a vote of the flow exceeds what the variances of its pairs tell, for the same reason, and as large as
/// [`POSE_FACTOR`].
const VOTE_FACTOR: f64 = 1.5;
/// Factor that people add in quadrature to the error of a pose or vote, times the share of the view that moves. The more people are in view, the more
/// of them pass for the room, and all points of one person err alike from frame to frame (decision 45; without it and [`UNSTEADY_FACTOR`] crowds have
/// 1.1 to 1.9 times the error, decision 54).
const CROWD_FACTOR: f64 = 5.0;
/// The camera's acceleration is learned only from poses where the unsteady shutter moves rows by less than this, px: chosen, as much as flow errs by
/// (`flow::SIGMA_PX`).
const CALM_PX: f64 = 0.5;
/// Nobody is about when a map is begun where no more than a tenth moves for so long, s (decision 44).
const QUIET: f64 = 0.5;

/// What is known of the camera's velocity at a pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Momentum {
    /// In the map, m/s.
    velocity: Vec3,
    /// Covariance of the place, m^2.
    place: Mat3,
    /// Covariance of place (rows) and velocity (columns), m^2/s.
    cross: Mat3,
    /// Covariance of the velocity, m^2/s^2.
    spread: Mat3,
    /// What it is accelerated by of late, m/s^2, one standard deviation along each axis.
    acceleration: f64,
}

/// Where a camera is expected that is followed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    /// By how much it has moved on, in the map, m.
    shift: Vec3,
    /// Covariance of `shift`, m^2.
    moved: Mat3,
    /// Its momentum, unless its place tells more.
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
    /// What is expected `dt` seconds later, when nothing is seen: somewhere in between it was accelerated.
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

    /// What is left of it where it may be somebody else's: next to nothing.
    fn forgotten(&self) -> Self {
        Self {
            place: self.place,
            acceleration: self.acceleration,
            ..Self::default()
        }
    }

    /// The momentum of a camera that goes back the way that it came.
    pub(super) fn reversed(&self) -> Self {
        Self {
            velocity: -self.velocity,
            cross: -self.cross,
            ..*self
        }
    }
}

impl Expected {
    /// Covariance of the place where it is expected, m^2.
    pub(super) fn place(&self) -> &Mat3 {
        &self.momentum.place
    }

    /// The momentum at a place that is `off` from where it was expected, m, and known by `covariance`, m^2, with all that was expected.
    /// Where it `tells`, so does how far that is of how the camera is accelerated.
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

    /// What the camera is accelerated by, m/s^2, seen from a place that is `off` from where it was expected: of all that should differ, so much did.
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
    /// Where the camera is expected at the present frame, in the newest view; none where it is not followed.
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

    /// Notes how much moves at a frame, which is so old since the map or submap was begun, s.
    pub(super) fn note_quiet(&mut self, age: f64) {
        if age <= 0.0 {
            self.beginning.quiet = true;
        }
        if age < QUIET && self.moving_share > SOME_MOVE {
            self.beginning.quiet = false;
        }
    }

    /// Whether the momentum is that of the camera: where people were about when a map or submap was begun, it may be theirs until it is known who moves. A way
    /// back begins where it is.
    pub(super) fn knows_momentum(&self) -> bool {
        let age = self
            .state
            .last()
            .map_or(0.0, |l| l.stamp - self.beginning.stamp);
        self.goes_back || age >= UNDECIDED || (self.beginning.quiet && age >= QUIET)
    }

    /// What the camera's momentum says of the place of a pose that turns about as `camera_from_world`, as its matches see it.
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

    /// Whether wheels that are confirmed tell how the camera moves: they know of a base that stops, which momentum does not.
    fn wheels_tell(&self) -> bool {
        self.trusted_since_last().is_some_and(|k| k.shift.is_some())
    }

    /// By how much the shutter's unsteadiness moves rows that are a quarter of the image away from its middle, px.
    fn unsteady_px(&self, camera_from_world: &Se3) -> f64 {
        let unsteady = self.motion_to(camera_from_world).unsteadiness();
        let camera = &self.front_end.observer.camera;
        self.front_end.shutter().sigma_px(camera.cy * 0.5, unsteady)
    }

    /// By how much poses err more than their matches' variances tell, squared.
    fn pose_factor(&self, unsteady_px: f64) -> f64 {
        let unsteady = UNSTEADY_FACTOR * unsteady_px;
        POSE_FACTOR * POSE_FACTOR + unsteady * unsteady + self.crowd_factor()
    }

    /// The part of it, squared, that is due to people who pass for the room. On a way back there is none: what leans on its momentum rides smoothly on
    /// whom it rides on, and then nothing tells that it does.
    fn crowd_factor(&self) -> f64 {
        if self.goes_back {
            return 0.0;
        }
        let crowd = CROWD_FACTOR * self.moving_share;
        crowd * crowd
    }

    /// What it says of the motion from this frame to the last one, as the vote of the flow sees it: nothing on a way back, whose votes are to find out who moves.
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

    /// The camera's motion once a pose is taken, with its momentum; without `information` of its matches nothing new is known of that.
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
