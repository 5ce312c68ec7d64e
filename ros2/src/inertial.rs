//! The inertial sensor: its messages, and its mount.

use stillpoint::geometry::{ImuModel, Se3};
use stillpoint::imaging::ImuSample;
use stillpoint::recordings::{Transforms, stamp_seconds};
use stillpoint::ros_messages as ros;
use stillpoint::ros_messages::{Format, WireError};

/// The sensor's topic, before remapping.
pub const IMU: &str = "camera/imu";

/// A message of the sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// The measurement.
    pub sample: ImuSample,
    /// Stamp of the message.
    pub stamp: ros::Time,
    /// The sensor's frame of reference.
    pub frame: String,
}

impl Measured {
    /// Parses a message.
    ///
    /// # Errors
    /// Unreadable messages, missing stamps, values that are not finite.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        let told = |e: WireError| format!("inertial sensor: {e}");
        let message: ros::Imu<'_> =
            ros::from_bytes(bytes, Format::CdrLittleEndian).map_err(told)?;
        let vector = |v: &ros::Vector3| [v.x, v.y, v.z];
        let stamp = message.header.stamp;
        let sample = ImuSample {
            stamp: stamp_seconds(stamp),
            angular_rate: vector(&message.angular_velocity),
            specific_force: vector(&message.linear_acceleration),
        };
        if stamp == ros::Time::default() {
            return Err(
                "inertial sensor: expected messages with stamps of the camera's clock, found none"
                    .to_owned(),
            );
        }
        if !sample.is_finite() || message.angular_velocity_covariance[0] == -1.0 {
            return Err(format!(
                "inertial sensor: expected angular rates, found {:?}; name a topic that has them (unite_imu_method of realsense2_camera)",
                sample.angular_rate
            ));
        }
        Ok(Self {
            sample,
            stamp,
            frame: message.header.frame_id.trim_start_matches('/').to_owned(),
        })
    }
}

/// The sensor's mount, with the noise model of a BMI055, if transforms connect it to the camera.
#[must_use]
pub fn mounted(transforms: &Transforms, optical: &str, frame: &str) -> Option<ImuModel> {
    let camera_from_imu: Se3 = transforms.find(optical, frame)?;
    Some(ImuModel::bmi055().mounted(camera_from_imu))
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint::ros_messages::to_bytes;

    fn message(sec: i64, rate: f64) -> ros::Imu<'static> {
        let mut imu = ros::Imu::default();
        imu.header.stamp.sec = sec;
        imu.header.frame_id = "/camera_imu_optical_frame".into();
        imu.angular_velocity.x = rate;
        imu.linear_acceleration.y = -9.8;
        imu
    }

    fn read(message: &ros::Imu<'_>) -> Result<Measured, String> {
        Measured::read(&to_bytes(message, Format::CdrLittleEndian))
    }

    #[test]
    fn imu_message_is_read() {
        let found = read(&message(7, 0.5)).unwrap();
        assert_eq!(
            (found.sample.stamp, found.frame.as_str()),
            (7.0, "camera_imu_optical_frame")
        );
        assert_eq!(found.sample.angular_rate, [0.5, 0.0, 0.0]);
        assert_eq!(found.sample.specific_force, [0.0, -9.8, 0.0]);
    }

    #[test]
    fn invalid_imu_messages_are_reported() {
        let told = |message: &ros::Imu<'_>| read(message).unwrap_err();
        assert!(told(&message(0, 0.5)).contains("stamps"));
        assert!(told(&message(1, f64::NAN)).contains("angular rates, found [NaN"));
        let mut forces = message(1, 0.0);
        forces.angular_velocity_covariance[0] = -1.0;
        assert!(told(&forces).contains("unite_imu_method"));
        assert!(
            Measured::read(&[0, 1, 0, 0, 9])
                .unwrap_err()
                .starts_with("inertial sensor: ")
        );
    }
}
