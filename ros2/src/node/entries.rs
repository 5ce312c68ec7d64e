//! Received messages as entries of the recording.

use super::{nanoseconds, now};
use crate::record::Entry;
use stillpoint::ros_messages as ros;
use stillpoint::ros_messages::{Message, Version};

pub(super) fn image(topic: String, compressed: bool, time: u64, bytes: Vec<u8>) -> Entry {
    let (type_name, definition): (_, fn() -> String) = if compressed {
        (ros::CompressedImage::NAME, || {
            ros::definition::<ros::CompressedImage<'_>>(Version::Ros2)
        })
    } else {
        (ros::Image::NAME, || {
            ros::definition::<ros::Image<'_>>(Version::Ros2)
        })
    };
    Entry {
        topic,
        type_name,
        definition,
        time,
        latched: false,
        bytes,
    }
}

pub(super) fn inertial(topic: String, time: u64, bytes: Vec<u8>) -> Entry {
    Entry {
        topic,
        type_name: ros::Imu::NAME,
        definition: || ros::definition::<ros::Imu<'_>>(Version::Ros2),
        time,
        latched: false,
        bytes,
    }
}

pub(super) fn odometry(topic: String, time: u64, bytes: Vec<u8>) -> Entry {
    Entry {
        topic,
        type_name: ros::Odometry::NAME,
        definition: || ros::definition::<ros::Odometry<'_>>(Version::Ros2),
        time,
        latched: false,
        bytes,
    }
}

pub(super) fn constant(bytes: Vec<u8>) -> Entry {
    Entry {
        topic: "/tf_static".to_owned(),
        type_name: ros::TfMessage::NAME,
        definition: || ros::definition::<ros::TfMessage<'_>>(Version::Ros2),
        time: nanoseconds(now()),
        latched: true,
        bytes,
    }
}
