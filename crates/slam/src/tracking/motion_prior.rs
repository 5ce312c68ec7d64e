//! Priors of poses and flow votes from the motion model ([`Momentum`](super::momentum::Momentum)), and its update.

use super::Tracker;
use super::crowd::{SOME_MOVE, UNDECIDED};
use super::momentum::Expected;
use super::motion::CameraMotion;
use stillpoint_estimation::KnownPlace;
use stillpoint_geometry::{Mat6, Se3, Vec3};

/// Factor on errors of poses and flow votes beyond the variances of their measurements: a walking person, or blur,
/// shifts many of them alike. Measured: with 1.0 a start has 58 mm, with 2.5 `kitchen` misses its bar (decision 44).
const COMMON_FACTOR: f64 = 1.5;
/// Factor added in quadrature for an unsteady rotation under rolling shutter, per pixel of displacement of rows a
/// quarter of the image from the middle. Measured: without it, and with 2.5 for [`COMMON_FACTOR`], the worst start has
/// 74 mm (decision 44).
const UNSTEADY_FACTOR: f64 = 2.5;
/// Factor added in quadrature to the error of a pose or vote, times the moving share of the view. The more people are
/// in view, the more of them are taken for static, and all points of a person err alike from frame to frame (decision
/// 45). Measured: without it and [`UNSTEADY_FACTOR`] crowds have 1.1 to 1.9 times the error (decision 54).
const CROWD_FACTOR: f64 = 5.0;
/// Duration after the start of a map with at most a tenth moving from which the scene counts as free of people, s.
/// Measured: with the velocity used from the first frame on, starts follow a man by 226 mm (decision 44).
const QUIET: f64 = 0.5;

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
        COMMON_FACTOR * COMMON_FACTOR + unsteady * unsteady + self.crowd_factor()
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
        let factor = COMMON_FACTOR * COMMON_FACTOR + self.crowd_factor();
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
        let factor = self.pose_factor(self.unsteady_px(camera_from_world));
        let r = camera_from_world.rotation_matrix();
        let covariance = information.and_then(|information| {
            let mut sum = information / factor;
            let mut known = sum.fixed_view_mut::<3, 3>(0, 0);
            known += r * expected.place().try_inverse()? * r.transpose();
            let covariance = sum.try_inverse()?;
            Some(r.transpose() * covariance.fixed_view::<3, 3>(0, 0) * r)
        });
        let off = camera_from_world.inverse().translation - place;
        motion.with(expected.found(&off, covariance))
    }
}

#[cfg(test)]
mod tests;
