//! What is said of the inertial sensor.

use crate::trust::SensorState;
use stillpoint_geometry::nalgebra::UnitQuaternion;

/// What is wrong with an inertial sensor that is not listened to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorFault {
    /// Its values do not change: it is stuck, or not connected.
    Constant,
    /// Its noise is far beyond that of any sensor of use.
    Noisy,
    /// It turns otherwise than the camera: it is mounted otherwise than the calibration says, or its stamps are of another clock.
    Contradicts,
}

impl std::fmt::Display for SensorFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Constant => "its values do not change: is it connected?",
            Self::Noisy => "its noise is over 10 deg/s",
            Self::Contradicts => {
                "it turns otherwise than the camera: check camera_from_imu and time_offset"
            }
        })
    }
}

/// How far the inertial sensor is believed.
pub type InertialState = SensorState<SensorFault>;

/// What is known of the inertial sensor at a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialReport {
    /// Whether it is believed.
    pub state: InertialState,
    /// The gyroscope's bias, in its axes, rad/s.
    pub gyro_bias: [f64; 3],
    /// Standard deviation of the gyroscope's bias, rad/s.
    pub gyro_bias_sigma: f64,
    /// How the sensor stands to the camera, as estimated: turns its axes to the camera's.
    pub camera_from_imu: UnitQuaternion<f64>,
    /// By how much the estimated mount differs from the stated one, rad.
    pub mount_error: f64,
    /// Standard deviation of the estimated mount about an axis, rad.
    pub mount_sigma: f64,
    /// What is to be added to the sensor's stamps, as estimated, s.
    pub time_offset: f64,
    /// By how much the estimated time offset differs from the stated one, s.
    pub time_offset_error: f64,
    /// Standard deviation of the estimated time offset, s.
    pub time_offset_sigma: f64,
    /// The direction that points up, in the world of the map; none before the sensor has told for a second.
    pub up: Option<[f64; 3]>,
}
