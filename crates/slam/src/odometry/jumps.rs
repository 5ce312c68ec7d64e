//! Detects odometry that jumps in ways impossible for a heavy base.

use super::path::Stand;
use stillpoint_geometry::{Se3, Vec3, so3};

/// Length of the window over which jumps are averaged, samples: chosen, a second of wheels of 50 Hz.
const WINDOW: f64 = 50.0;
/// Minimum number of jumps for a meaningful average, samples: resetting the pose changes the velocity twice, by
/// [`MOST`] at most each, and the mean stays below 1 then (2 x 8 / 20 = 0.8).
const LEAST: f64 = 20.0;
/// Maximum contribution of a single jump to the average, a factor: a pose reset is a single jump. Chosen with
/// [`LEAST`]: jittering odometry is above it at each sample.
const MOST: f64 = 8.0;
/// Largest acceleration of a base between samples, m/s^2: about standard gravity, which is as much as wheels with a
/// friction of 1 can transmit.
const ACCELERATION: f64 = 10.0;
/// Largest angular acceleration of a base between samples, rad/s^2: that of [`ACCELERATION`] at a wheel a third of a
/// metre from the middle.
const TURNING: f64 = 30.0;
/// Largest quantisation error of a difference, m and rad. Chosen: some odometry is rounded to centimetres and half
/// degrees, so that each end errs by half of that, and a difference by twice as much.
const STEP: f64 = 0.01;

/// Running mean of velocity changes, relative to the limits of a base.
#[derive(Clone, Debug, Default)]
pub(super) struct Jumps {
    last: Option<Stand>,
    /// Velocity of the last step: m/s and rad/s in the axes of the odometry and of the base.
    velocity: Option<[Vec3; 2]>,
    mean: f64,
    count: f64,
}

impl Jumps {
    pub(super) fn take(&mut self, sample: &Stand) {
        let last = self.last.replace(*sample);
        let Some(last) = last else {
            return;
        };
        let dt = sample.stamp - last.stamp;
        let velocity = velocity(&last.odom_from_base, &sample.odom_from_base, dt);
        if let Some(before) = self.velocity.replace(velocity) {
            let change = |k: usize| (velocity[k] - before[k]).norm() * dt;
            let moved = change(0) / (STEP + ACCELERATION * dt * dt);
            let turned = change(1) / (STEP + TURNING * dt * dt);
            self.mean += (moved.max(turned).min(MOST) - self.mean) / (self.count + 1.0);
            self.count = (self.count + 1.0).min(WINDOW);
        }
    }

    pub(super) fn are_wild(&self) -> bool {
        self.count >= LEAST && self.mean > 1.0
    }
}

fn velocity(from: &Se3, to: &Se3, dt: f64) -> [Vec3; 2] {
    let turn = so3::log(&(from.rotation.inverse() * to.rotation));
    [(to.translation - from.translation) / dt, turn / dt]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(rate: f64, pose: impl Fn(f64) -> Se3) -> Jumps {
        let mut jumps = Jumps::default();
        for k in 0..60 {
            let stamp = f64::from(k) / rate;
            let odom_from_base = pose(stamp);
            jumps.take(&Stand {
                stamp,
                odom_from_base,
                sigmas: None,
            });
        }
        jumps
    }

    fn at(x: f64) -> Se3 {
        Se3::new(so3::exp(&Vec3::zeros()), Vec3::x() * x)
    }

    #[test]
    fn normal_base_motion_is_not_a_jump() {
        for rate in [10.0, 30.0, 200.0] {
            assert!(!after(rate, |t| at(0.5 * libm::sin(3.0 * t))).are_wild());
            // Some encoders have a resolution of centimetres.
            assert!(!after(rate, |t| at(0.005 * libm::round(100.0 * t))).are_wild());
            // A pose reset.
            assert!(!after(rate, |t| at(if t > 1.0 { 20.0 } else { t })).are_wild());
            let to_and_fro = |t: f64| at(0.5 * libm::round(t * rate % 2.0));
            assert!(after(rate, to_and_fro).are_wild());
        }
    }
}
