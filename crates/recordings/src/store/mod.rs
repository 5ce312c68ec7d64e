//! Message files: index of the messages, and access to their bytes.
//!
//! A file is scanned once from its beginning, so that no format needs its index, and a truncated file gives everything before the cut. Only
//! the location of a message is kept; its bytes are read on demand.

pub(crate) mod bag;
pub(crate) mod blocks;
mod chunk;
mod contents;
pub(crate) mod cursor;
pub(crate) mod mcap;
mod scanned;
#[cfg(feature = "sqlite")]
pub(crate) mod sqlite;
pub(crate) mod temporary;

pub(crate) use contents::Contents;

use crate::budget;
use crate::error::Result;
use blocks::Blocks;
use stillpoint_ros_messages::Format;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Channel {
    pub(crate) topic: String,
    pub(crate) type_name: String,
    /// `None` for messages that are not of ROS, which are only counted.
    pub(crate) format: Option<Format>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Slot {
    pub(crate) channel: u32,
    /// Time at which it was received, ns.
    pub(crate) logged: i64,
    /// Header stamp, ns; `None` for messages without a header.
    pub(crate) stamp: Option<i64>,
    pub(crate) place: Place,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    pub(crate) file: u16,
    pub(crate) block: Option<u32>,
    /// Offset in the block or file; in a database the row.
    pub(crate) offset: u64,
    pub(crate) len: u32,
}

/// Whether a type is parsed: cameras, poses and sensors. Other messages, such as point clouds, are only counted.
pub(crate) fn is_looked_into(type_name: &str) -> bool {
    [
        "sensor_msgs/msg/Image",
        "sensor_msgs/msg/CompressedImage",
        "sensor_msgs/msg/CameraInfo",
        "sensor_msgs/msg/Imu",
        "custom_msg/msg/OBStreamProfileInfo",
        "custom_msg/msg/OBDeviceInfo",
        "tf2_msgs/msg/TFMessage",
        "tf/msg/tfMessage",
        "geometry_msgs/msg/PoseStamped",
        "geometry_msgs/msg/TransformStamped",
        "geometry_msgs/msg/Transform",
        "nav_msgs/msg/Odometry",
        "std_msgs/msg/String",
        "std_msgs/msg/Float32",
        "diagnostic_msgs/msg/KeyValue",
    ]
    .contains(&type_name)
}

pub(crate) trait Store: Send + std::fmt::Debug {
    /// The bytes of a message. Decompressed blocks are cached in `blocks`.
    fn read(&mut self, place: &Place, blocks: &mut Blocks) -> Result<Vec<u8>>;
}

/// Maximum size of a message of a parsed type, bytes.
pub(crate) fn largest_message(type_name: &str) -> u64 {
    match type_name {
        "sensor_msgs/msg/Image" | "sensor_msgs/msg/CompressedImage" => budget::LARGEST_IMAGE,
        _ => budget::LARGEST_MESSAGE,
    }
}

/// Number of bytes of a message read by the scan: its stamp, and all values of a sensor.
pub(crate) fn head_of(type_name: &str) -> usize {
    match type_name {
        "sensor_msgs/msg/Imu" | "nav_msgs/msg/Odometry" => 2048,
        _ => HEAD,
    }
}

/// Converts a type name to that of ROS 2.
pub(crate) fn full_name(name: &str) -> String {
    match name.split_once('/') {
        Some((package, kind)) if !kind.contains('/') => format!("{package}/msg/{kind}"),
        _ => name.to_owned(),
    }
}

/// Number of bytes that contain a message's stamp.
pub(crate) const HEAD: usize = 12;

/// The header stamp of a message of this type, ns.
pub(crate) fn header_stamp(channel: &Channel, head: &[u8]) -> Option<i64> {
    const WITHOUT: [&str; 7] = [
        "tf2_msgs/msg/TFMessage",
        "tf/msg/tfMessage",
        "std_msgs/msg/String",
        "diagnostic_msgs/msg/KeyValue",
        "geometry_msgs/msg/Transform",
        "visualization_msgs/msg/MarkerArray",
        "rcl_interfaces/msg/Log",
    ];
    const WITH: [&str; 7] = [
        "sensor_msgs/",
        "nav_msgs/",
        "geometry_msgs/",
        "vision_msgs/",
        "diagnostic_msgs/",
        "rosgraph_msgs/msg/Log",
        "stereo_msgs/",
    ];
    let name = channel.type_name.as_str();
    if WITHOUT.contains(&name) || !WITH.iter().any(|with| name.starts_with(with)) {
        return None;
    }
    let word = |at: usize, big: bool| {
        let bytes: [u8; 4] = head.get(at..at + 4)?.try_into().ok()?;
        Some(if big {
            u32::from_be_bytes(bytes)
        } else {
            u32::from_le_bytes(bytes)
        })
    };
    // Four bytes precede the seconds in both: the encapsulation, or the sequence number.
    let (sec, nanosec) = match channel.format? {
        Format::Ros1 => (i64::from(word(4, false)?), word(8, false)?),
        _ => {
            let big = head.get(1) == Some(&0);
            (i64::from(word(4, big)? as i32), word(8, big)?)
        }
    };
    Some(sec * 1_000_000_000 + i64::from(nanosec))
}

/// ns as s, rounded once for whole seconds.
pub(crate) fn seconds(ns: i64) -> f64 {
    let (sec, rest) = (ns.div_euclid(1_000_000_000), ns.rem_euclid(1_000_000_000));
    sec as f64 + rest as f64 / 1e9
}
