//! Model of an inertial sensor: mounting, time offset and noise. Holds no samples.

use crate::figure::{self, FigureError};
use crate::{Se3, Vec3, so3};

/// An inertial sensor fixed to the camera. Noise follows the continuous model of IEEE Std 952-1997, annex C: white
/// noise given by its density, and a random-walk bias.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuModel {
    /// Pose of the sensor in the camera frame.
    pub camera_from_imu: Se3,
    /// Added to a sample's stamp to get camera time, s.
    pub time_offset: f64,
    /// Density of the gyroscope's white noise, rad/s/sqrt(Hz).
    pub gyro_noise: f64,
    /// Standard deviation of the gyroscope's turn-on bias, rad/s.
    pub gyro_bias: f64,
    /// Random walk of the gyroscope's bias, rad/s/sqrt(s).
    pub gyro_walk: f64,
    /// Density of the accelerometer's white noise, m/s^2/sqrt(Hz).
    pub accel_noise: f64,
    /// Standard deviation of the accelerometer's turn-on bias, m/s^2.
    pub accel_bias: f64,
    /// Random walk of the accelerometer's bias, m/s^2/sqrt(s).
    pub accel_walk: f64,
}

/// Standard gravity, m/s^2.
pub const STANDARD_GRAVITY: f64 = 9.806_65;

impl ImuModel {
    /// The Bosch BMI055 of Intel's D435i, in the camera's place and axes. Typical values of its data sheet
    /// (BST-BMI055-DS000-08, July 2014): gyroscope noise 0.014 deg/s/sqrt(Hz), zero-rate offset 1 deg/s and 0.015
    /// deg/s/K; accelerometer noise 150 ug/sqrt(Hz), zero-g offset 70 mg and 1 mg/K. The data sheet does not specify
    /// bias walk: a temperature change of 1 K within a minute is taken as one standard deviation of it.
    #[must_use]
    pub fn bmi055() -> Self {
        let minute = 60.0_f64.sqrt();
        Self {
            camera_from_imu: Se3::identity(),
            time_offset: 0.0,
            gyro_noise: 0.014_f64.to_radians(),
            gyro_bias: 1.0_f64.to_radians(),
            gyro_walk: 0.015_f64.to_radians() / minute,
            accel_noise: 150e-6 * STANDARD_GRAVITY,
            accel_bias: 70e-3 * STANDARD_GRAVITY,
            accel_walk: 1e-3 * STANDARD_GRAVITY / minute,
        }
    }

    /// The same sensor with another mounting pose.
    #[must_use]
    pub fn mounted(self, camera_from_imu: Se3) -> Self {
        Self {
            camera_from_imu,
            ..self
        }
    }

    /// The same sensor, its mounting rotated by a rotation vector in its own axes, rad.
    #[must_use]
    pub fn turned(self, turn: Vec3) -> Self {
        let turn = Se3::new(so3::exp(&turn), Vec3::zeros());
        self.mounted(self.camera_from_imu * turn)
    }

    /// Checks that all parameters are plausible.
    ///
    /// # Errors
    /// [`FigureError`] for the first that is not.
    pub fn check(&self) -> Result<(), FigureError> {
        let (noise, least) = ("above 0, in SI units", "of 0 or more, in SI units");
        let own = [
            ("gyro_noise", self.gyro_noise, 1e-9..=1.0, noise),
            ("gyro_bias", self.gyro_bias, 0.0..=10.0, least),
            ("gyro_walk", self.gyro_walk, 0.0..=1.0, least),
            ("accel_noise", self.accel_noise, 1e-9..=10.0, noise),
            ("accel_bias", self.accel_bias, 0.0..=100.0, least),
            ("accel_walk", self.accel_walk, 0.0..=10.0, least),
        ];
        figure::check(&own, self.time_offset, &self.camera_from_imu.translation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn implausible_imu_parameters_are_reported() {
        let good = ImuModel::bmi055();
        assert_eq!(good.check(), Ok(()));
        let wrong = |change: fn(&mut ImuModel)| {
            let mut model = good;
            change(&mut model);
            model.check().unwrap_err().to_string()
        };
        assert!(wrong(|m| m.gyro_noise = 0.0).contains("gyro_noise above 0"));
        assert!(wrong(|m| m.gyro_noise = f64::NAN).contains("found NaN"));
        assert!(wrong(|m| m.accel_bias = -1.0).contains("accel_bias of 0 or more"));
        assert!(wrong(|m| m.time_offset = 5.0).contains("within 1 s, found 5"));
        assert!(wrong(|m| m.camera_from_imu.translation.y = 1e3).contains("translation y"));
    }

    #[test]
    fn rotated_sensor_has_rotated_axes() {
        let turned = ImuModel::bmi055().turned(Vec3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2));
        let seen = turned.camera_from_imu.rotation * Vec3::x();
        assert!((seen - Vec3::y()).norm() < 1e-12);
    }
}
