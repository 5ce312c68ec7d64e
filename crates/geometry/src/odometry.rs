//! Model of wheel odometry: camera mounting, time offset and noise. Holds no samples.

use crate::figure::{self, FigureError};
use crate::{Se3, Vec3, so3};

/// Odometry of the base that carries the camera. Errors grow with distance and rotation, as in the odometry motion
/// model of Thrun, Burgard, Fox (Probabilistic Robotics, 2005, section 5.4): standard deviations per metre or per
/// radian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OdometryModel {
    /// Pose of the camera in the base frame.
    pub base_from_camera: Se3,
    /// Added to a sample's stamp to get camera time, s.
    pub time_offset: f64,
    /// Error of the distance, m/m: slip and wrong wheel radii.
    pub slip_per_metre: f64,
    /// Error of the rotation, rad/rad.
    pub slip_per_radian: f64,
    /// Unmeasured rotation per distance, rad/m.
    pub turn_per_metre: f64,
}

impl OdometryModel {
    /// Odometry of an indoor robot with two driven wheels and the given camera mounting: 2 % of the distance, 3 % of
    /// the rotation, and a degree per metre.
    #[must_use]
    pub fn mounted(base_from_camera: Se3) -> Self {
        Self {
            base_from_camera,
            time_offset: 0.0,
            slip_per_metre: 0.02,
            slip_per_radian: 0.03,
            turn_per_metre: 1.0_f64.to_radians(),
        }
    }

    /// The same odometry, the camera rotated on its mount by a rotation vector in the axes of the base, rad.
    #[must_use]
    pub fn turned(self, turn: Vec3) -> Self {
        let turn = Se3::new(so3::exp(&turn), Vec3::zeros());
        Self {
            base_from_camera: turn * self.base_from_camera,
            ..self
        }
    }

    /// Converts a motion of the base to one of the camera; both map later to earlier coordinates.
    #[must_use]
    pub fn camera_motion(&self, earlier_from_later: &Se3) -> Se3 {
        self.base_from_camera.inverse() * *earlier_from_later * self.base_from_camera
    }

    /// Checks that all parameters are plausible.
    ///
    /// # Errors
    /// [`FigureError`] for the first that is not.
    pub fn check(&self) -> Result<(), FigureError> {
        let share = "above 0, 1 at most";
        let own = [
            ("slip_per_metre", self.slip_per_metre, 1e-6..=1.0, share),
            ("slip_per_radian", self.slip_per_radian, 1e-6..=1.0, share),
            ("turn_per_metre", self.turn_per_metre, 1e-6..=1.0, share),
        ];
        figure::check(&own, self.time_offset, &self.base_from_camera.translation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn implausible_odometry_parameters_are_reported() {
        let good = OdometryModel::mounted(Se3::identity());
        assert_eq!(good.check(), Ok(()));
        let wrong = |change: fn(&mut OdometryModel)| {
            let mut model = good;
            change(&mut model);
            model.check().unwrap_err().to_string()
        };
        assert!(wrong(|m| m.slip_per_metre = 0.0).contains("slip_per_metre above 0"));
        assert!(wrong(|m| m.turn_per_metre = f64::NAN).contains("found NaN"));
        assert!(wrong(|m| m.time_offset = 5.0).contains("within 1 s, found 5"));
        assert!(wrong(|m| m.base_from_camera.translation.z = 1e3).contains("translation z"));
    }

    #[test]
    fn camera_ahead_of_the_axle_moves_sideways_in_turns() {
        // Half a metre in front of the axle, looking ahead: camera x is the base's -y, camera z its x.
        let axes = so3::exp(&Vec3::new(0.0, 0.0, -std::f64::consts::FRAC_PI_2))
            * so3::exp(&Vec3::new(-std::f64::consts::FRAC_PI_2, 0.0, 0.0));
        let model = OdometryModel::mounted(Se3::new(axes, Vec3::new(0.5, 0.0, 0.0)));
        let ahead = model.camera_motion(&Se3::new(so3::exp(&Vec3::zeros()), Vec3::x()));
        assert!((ahead.translation - Vec3::z()).norm() < 1e-12);
        let left = so3::exp(&Vec3::new(0.0, 0.0, 0.1));
        let swung = model.camera_motion(&Se3::new(left, Vec3::zeros()));
        assert!((swung.translation.x + 0.5 * libm::sin(0.1)).abs() < 1e-12);
        assert!((so3::log(&swung.rotation) - Vec3::new(0.0, -0.1, 0.0)).norm() < 1e-12);
    }
}
