//! Messages in recordings of RGB-D cameras, and those that a recorder or node writes.
//!
//! Definitions: common_interfaces (std_msgs, sensor_msgs, geometry_msgs, nav_msgs, visualization_msgs, diagnostic_msgs, std_srvs),
//! tf2_msgs, rcl_interfaces and vision_msgs 4, of ROS Noetic and ROS 2 Jazzy; Orbbec's additions. One struct serves both if they differ in
//! single fields.
// Fields have the names and units of the definitions, which document them.
#![allow(missing_docs)]

#[macro_use]
mod macros;
mod geometry;
mod navigation;
mod orbbec;
mod report;
mod sensor;
mod service;

pub use geometry::*;
pub use navigation::*;
pub use orbbec::*;
pub use report::*;
pub use sensor::*;
pub use service::*;

use crate::wire::{Format, Reader, Wire, WireError, Writer};
use std::borrow::Cow;

/// `builtin_interfaces/Time`, and `time` of ROS 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Time {
    /// Seconds: from -2^31 to below 2^31 in ROS 2, from 0 to below 2^32 in ROS 1. Other values are clamped on writing.
    pub sec: i64,
    pub nanosec: u32,
}

impl Wire<'_> for Time {
    fn read(from: &mut Reader<'_>) -> Result<Self, WireError> {
        let sec = match from.format() {
            Format::Ros1 => u32::read(from)?.into(),
            _ => i32::read(from)?.into(),
        };
        let nanosec = u32::read(from)?;
        Ok(Self { sec, nanosec })
    }

    fn write(&self, to: &mut Writer) {
        let sec = self.sec;
        // Clamped first, so neither conversion loses anything.
        match to.format() {
            Format::Ros1 => (sec.clamp(0, u32::MAX.into()) as u32).write(to),
            _ => (sec.clamp(i32::MIN.into(), i32::MAX.into()) as i32).write(to),
        }
        self.nanosec.write(to);
    }
}

/// `builtin_interfaces/Duration`, and `duration` of ROS 1, whose second field is signed there: both have the same 8 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Duration {
    pub sec: i32,
    pub nanosec: u32,
}

impl Wire<'_> for Duration {
    fn read(from: &mut Reader<'_>) -> Result<Self, WireError> {
        let (sec, nanosec) = (i32::read(from)?, u32::read(from)?);
        Ok(Self { sec, nanosec })
    }

    fn write(&self, to: &mut Writer) {
        self.sec.write(to);
        self.nanosec.write(to);
    }
}

messages! {
    /// `seq` exists in ROS 1 only, and is zero when read from ROS 2.
    Header<'a> "std_msgs/msg/Header" {
        [ros1] seq: u32,
        stamp: Time,
        frame_id: Cow<'a, str>,
    }
    StringMessage<'a> "std_msgs/msg/String" "992ce8a1687cec8c8bd883ec73ca41d1" { data: Cow<'a, str>, }
    Float32 "std_msgs/msg/Float32" "73fcbf46b49191e672908e50842a83d4" { data: f32, }
    ColorRgba "std_msgs/msg/ColorRGBA" { r: f32, g: f32, b: f32, a: f32, }
}
