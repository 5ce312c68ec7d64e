//! State of the inertial sensor, for reports.

use crate::trust::SensorState;
use stillpoint_geometry::nalgebra::UnitQuaternion;

/// Why an inertial sensor is ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorFault {
    /// Its values do not change: stuck, or not connected.
    Constant,
    /// Its noise is far beyond that of any useful sensor.
    Noisy,
    /// Its rotation contradicts the camera's: the mount differs from the calibration, or its stamps are of another
    /// clock.
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

/// Trust in the inertial sensor.
pub type InertialState = SensorState<SensorFault>;

/// Estimated state of the inertial sensor at a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialReport {
    /// Trust in the sensor.
    pub state: InertialState,
    /// Gyroscope bias, in its axes, rad/s.
    pub gyro_bias: [f64; 3],
    /// Standard deviation of the gyroscope bias, rad/s.
    pub gyro_bias_sigma: f64,
    /// Estimated rotation from sensor axes to camera axes.
    pub camera_from_imu: UnitQuaternion<f64>,
    /// Angle between the estimated and the configured mount, rad.
    pub mount_error: f64,
    /// Standard deviation of the estimated mount about an axis, rad.
    pub mount_sigma: f64,
    /// Estimated correction to the sensor's stamps, s.
    pub time_offset: f64,
    /// Difference between the estimated and the configured time offset, s.
    pub time_offset_error: f64,
    /// Standard deviation of the estimated time offset, s.
    pub time_offset_sigma: f64,
    /// Up direction in the world of the map; `None` during the first second.
    pub up: Option<[f64; 3]>,
}
