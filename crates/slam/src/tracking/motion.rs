//! Camera motion in time: pose prediction and velocity at a stamp.

use super::momentum::Momentum;
use stillpoint_geometry::{Se3, Vec3, Vec6};

/// Relative uncertainty of the angular velocity in the first interval, when the rotation may have begun within the
/// frame: a share of the turning, chosen, as a turn that began at any time of the frame is half of it off in the mean.
const UNSTEADY_FIRST: f64 = 0.5;
/// Uncertainty of the next change of angular velocity, as a share of the last change: chosen on the recordings of
/// decision 23; without the deviation fr1_rpy_walkers loses 35 frames (decision 54).
const UNSTEADY_CHANGE: f64 = 0.5;
/// Additional uncertainty, as a share of the angular velocity: fast rotations are unsteady. Chosen with
/// [`UNSTEADY_CHANGE`] on the recordings of decision 23.
const UNSTEADY_TURN: f64 = 0.2;

/// Remaining uncertainty with a gyroscope at both poses, as a share of the change: rows are exposed for less than a
/// frame's time. Chosen: 10 ms of exposure are this share of 33.
const UNSTEADY_MEASURED: f64 = 0.3;

/// Camera motion over the intervals between the last poses. Twists are per second, of
/// `camera_later_from_camera_earlier`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CameraMotion {
    last: Option<Interval>,
    before: Option<Interval>,
    /// Angular velocities at the pose before the last and at the last one, rad/s, from a gyroscope.
    turning: Option<[Vec3; 2]>,
    /// Motion model of the position, at the last accepted pose.
    momentum: Momentum,
}

#[derive(Clone, Copy, Debug)]
struct Interval {
    velocity: Vec6,
    /// s.
    seconds: f64,
}

impl CameraMotion {
    /// The motion after moving from one pose to another of the same map view within `seconds`.
    pub(super) fn followed_by(
        &self,
        last_from_world: &Se3,
        now_from_world: &Se3,
        seconds: f64,
    ) -> Self {
        let moved = || Interval {
            velocity: (*now_from_world * last_from_world.inverse()).log() / seconds,
            seconds,
        };
        Self {
            last: (seconds > 1e-6).then(moved),
            before: self.last,
            turning: None,
            momentum: self.momentum,
        }
    }

    /// Sets the motion model state at the last pose.
    pub(super) fn with(self, momentum: Momentum) -> Self {
        Self { momentum, ..self }
    }

    pub(super) fn momentum(&self) -> &Momentum {
        &self.momentum
    }

    /// Sets the angular velocities at the pose before the last and at the last one: angular parts of twists, rad/s.
    pub(super) fn turning(self, turning: Option<[Vec3; 2]>) -> Self {
        Self { turning, ..self }
    }

    /// Mean velocity since the last pose: that of the middle of the interval.
    pub(super) fn mean(&self) -> Option<&Vec6> {
        self.last.as_ref().map(|i| &i.velocity)
    }

    /// Velocity at the last pose. The interval's mean is that of its middle; a turning head changes its velocity
    /// considerably within half a frame.
    pub(super) fn at_last(&self) -> Option<Vec6> {
        let last = self.last?;
        let velocity = match self.before {
            Some(before) => last.velocity + before.change_to(&last) * (0.5 * last.seconds),
            None => last.velocity,
        };
        Some(turned(velocity, self.turning.map(|t| t[1])))
    }

    /// Velocity at the pose before the last, between the two intervals.
    pub(super) fn at_before(&self) -> Option<Vec6> {
        let last = self.last?;
        let velocity = match self.before {
            Some(before) => before.velocity + before.change_to(&last) * (0.5 * before.seconds),
            None => last.velocity,
        };
        Some(turned(velocity, self.turning.map(|t| t[0])))
    }

    /// Uncertainty of the angular velocity within a frame, rad/s: one standard deviation.
    pub(super) fn unsteadiness(&self) -> f64 {
        if let Some([before, last]) = self.turning {
            return UNSTEADY_MEASURED * (last - before).norm();
        }
        let turning = |v: &Vec6| v.fixed_rows::<3>(3).norm();
        let Some(last) = self.last else {
            return 0.0;
        };
        let turn = turning(&last.velocity);
        match self.before {
            Some(before) => {
                UNSTEADY_CHANGE * turning(&(last.velocity - before.velocity)) + UNSTEADY_TURN * turn
            }
            None => UNSTEADY_FIRST * turn,
        }
    }

    /// The motion for tracking backwards.
    pub(super) fn reversed(&self) -> Self {
        let back = |i: Interval| Interval {
            velocity: -i.velocity,
            ..i
        };
        Self {
            last: self.last.map(back),
            before: None,
            turning: None,
            momentum: self.momentum.reversed(),
        }
    }

    /// Predicted pose `dt` seconds after `last_from_world`.
    pub(super) fn predict(&self, last_from_world: &Se3, dt: f64) -> Se3 {
        // Constant velocity is extrapolated for at most half a second.
        match self.mean() {
            Some(v) => Se3::exp(&(v * dt.clamp(0.0, 0.5))) * *last_from_world,
            None => *last_from_world,
        }
    }
}

/// Replaces the angular part of a twist, if given.
fn turned(mut twist: Vec6, turning: Option<Vec3>) -> Vec6 {
    if let Some(turning) = turning {
        twist.fixed_rows_mut::<3>(3).copy_from(&turning);
    }
    twist
}

impl Interval {
    /// Change of velocity per second between the middles of two intervals.
    fn change_to(&self, next: &Self) -> Vec6 {
        (next.velocity - self.velocity) / (0.5 * (self.seconds + next.seconds))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pose on a path that rotates about one axis with angular velocity `w + a t` rad/s.
    fn turned(w: f64, a: f64, t: f64) -> Se3 {
        let angle = w * t + 0.5 * a * t * t;
        Se3::exp(&Vec6::new(0.0, 0.0, 0.0, 0.0, angle, 0.0))
    }

    fn motion(w: f64, a: f64, stamps: [f64; 3]) -> CameraMotion {
        let [p, q, r] = stamps.map(|t| turned(w, a, t));
        CameraMotion::default()
            .followed_by(&p, &q, stamps[1] - stamps[0])
            .followed_by(&q, &r, stamps[2] - stamps[1])
    }

    #[test]
    fn constant_acceleration_gives_exact_velocities() {
        for stamps in [[0.0, 0.033, 0.067], [0.0, 0.03, 0.10]] {
            let m = motion(1.0, 20.0, stamps);
            let turn = |v: Option<Vec6>| v.map_or(f64::NAN, |v| v[4]);
            assert!((turn(m.at_last()) - (1.0 + 20.0 * stamps[2])).abs() < 1e-9);
            assert!((turn(m.at_before()) - (1.0 + 20.0 * stamps[1])).abs() < 1e-9);
            // The mean lags by half a frame: here by more than a third of a radian per second.
            assert!(turn(m.at_last()) - turn(m.mean().copied()) > 0.3);
        }
    }

    #[test]
    fn single_interval_uses_the_mean_velocity() {
        let none = CameraMotion::default();
        assert!(none.at_last().is_none() && none.at_before().is_none());
        let one = none.followed_by(&turned(1.0, 0.0, 0.0), &turned(1.0, 0.0, 0.1), 0.1);
        assert_eq!(one.at_last(), one.mean().copied());
        assert_eq!(one.at_before(), one.mean().copied());
        assert!(
            one.followed_by(&Se3::identity(), &Se3::identity(), 0.0)
                .mean()
                .is_none()
        );
    }

    #[test]
    fn unsteadiness_is_larger_while_a_turn_begins() {
        let still = motion(0.0, 0.0, [0.0, 0.03, 0.06]).unsteadiness();
        let steady = motion(2.0, 0.0, [0.0, 0.03, 0.06]).unsteadiness();
        let begins = motion(0.0, 30.0, [0.0, 0.03, 0.06]).unsteadiness();
        let first = CameraMotion::default()
            .followed_by(&turned(2.0, 0.0, 0.0), &turned(2.0, 0.0, 0.03), 0.03)
            .unsteadiness();
        assert!(still.abs() < 1e-9);
        assert!((steady - 2.0 * UNSTEADY_TURN).abs() < 1e-9 && begins > steady);
        assert!((first - 2.0 * UNSTEADY_FIRST).abs() < 1e-9);
    }

    #[test]
    fn prediction_uses_the_mean_for_at_most_half_a_second() {
        let m = motion(1.0, 0.0, [0.0, 0.1, 0.2]);
        let at = |dt: f64| m.predict(&turned(1.0, 0.0, 0.2), dt).log()[4];
        assert!((at(0.1) - 0.3).abs() < 1e-9 && (at(9.0) - 0.7).abs() < 1e-9);
        let still = CameraMotion::default().predict(&turned(1.0, 0.0, 0.2), 1.0);
        assert!(
            (still.transform(&Vec3::z()) - turned(1.0, 0.0, 0.2).transform(&Vec3::z())).norm()
                < 1e-12
        );
    }
}
