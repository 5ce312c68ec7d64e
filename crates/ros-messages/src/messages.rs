//! Messages that recordings of RGB-D cameras hold. Those here have the same fields in ROS 1 and ROS 2, but for the header's `seq`.
//!
//! Definitions: common_interfaces (std_msgs, sensor_msgs, geometry_msgs, nav_msgs) and tf2_msgs, of ROS Noetic and ROS 2 Jazzy.
// Fields have the names and the units of the definitions; to describe them again would only be a second source.
#![allow(missing_docs)]

use std::borrow::Cow;

use crate::wire::{Format, Reader, Wire, WireError, Writer};

/// `builtin_interfaces/Time`, and `time` of ROS 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Time {
    /// Seconds: from -2^31 to below 2^31 in ROS 2, from 0 to below 2^32 in ROS 1. Others are brought to the nearest that can be written.
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

/// `std_msgs/Header`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Header<'a> {
    /// In ROS 1 only; zero when read from ROS 2.
    pub seq: u32,
    pub stamp: Time,
    pub frame_id: Cow<'a, str>,
}

impl<'a> Wire<'a> for Header<'a> {
    fn read(from: &mut Reader<'a>) -> Result<Self, WireError> {
        let seq = match from.format() {
            Format::Ros1 => u32::read(from)?,
            _ => 0,
        };
        let (stamp, frame_id) = (Time::read(from)?, Cow::read(from)?);
        Ok(Self {
            seq,
            stamp,
            frame_id,
        })
    }

    fn write(&self, to: &mut Writer) {
        if to.format() == Format::Ros1 {
            self.seq.write(to);
        }
        self.stamp.write(to);
        self.frame_id.write(to);
    }
}

/// Structs whose fields are read and written in their order.
macro_rules! messages {
    ($($(#[$meta:meta])* $name:ident $(<$life:lifetime>)? { $($field:ident: $type:ty,)* })*) => {$(
        $(#[$meta])*
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct $name $(<$life>)? { $(pub $field: $type,)* }

        messages!(@wire $name $(<$life>)? { $($field)* });
    )*};
    (@wire $name:ident { $($field:ident)* }) => {
        impl Wire<'_> for $name { messages!(@body '_ { $($field)* }); }
    };
    (@wire $name:ident <$life:lifetime> { $($field:ident)* }) => {
        impl<$life> Wire<$life> for $name<$life> { messages!(@body $life { $($field)* }); }
    };
    (@body $life:lifetime { $($field:ident)* }) => {
        fn read(from: &mut Reader<$life>) -> Result<Self, WireError> {
            $(let $field = Wire::read(from)?;)*
            Ok(Self { $($field),* })
        }
        fn write(&self, to: &mut Writer) {
            $(self.$field.write(to);)*
        }
    };
}

messages! {
    /// `std_msgs/String`.
    StringMessage<'a> { data: Cow<'a, str>, }
    /// `geometry_msgs/Vector3`, and `Point`.
    Vector3 { x: f64, y: f64, z: f64, }
    /// `geometry_msgs/Quaternion`.
    Quaternion { x: f64, y: f64, z: f64, w: f64, }
    /// `geometry_msgs/Pose`.
    Pose { position: Vector3, orientation: Quaternion, }
    /// `geometry_msgs/PoseStamped`.
    PoseStamped<'a> { header: Header<'a>, pose: Pose, }
    /// `geometry_msgs/Transform`.
    Transform { translation: Vector3, rotation: Quaternion, }
    /// `geometry_msgs/TransformStamped`.
    TransformStamped<'a> { header: Header<'a>, child_frame_id: Cow<'a, str>, transform: Transform, }
    /// `tf2_msgs/TFMessage`.
    TfMessage<'a> { transforms: Vec<TransformStamped<'a>>, }
    /// `nav_msgs/Path`.
    Path<'a> { header: Header<'a>, poses: Vec<PoseStamped<'a>>, }
    /// `sensor_msgs/Image`.
    Image<'a> {
        header: Header<'a>,
        height: u32,
        width: u32,
        encoding: Cow<'a, str>,
        is_bigendian: u8,
        step: u32,
        data: Cow<'a, [u8]>,
    }
    /// `sensor_msgs/CompressedImage`.
    CompressedImage<'a> { header: Header<'a>, format: Cow<'a, str>, data: Cow<'a, [u8]>, }
    /// `sensor_msgs/RegionOfInterest`.
    RegionOfInterest { x_offset: u32, y_offset: u32, height: u32, width: u32, do_rectify: u8, }
    /// `sensor_msgs/CameraInfo`. The fields `d`, `k`, `r` and `p` are capital letters in ROS 1.
    CameraInfo<'a> {
        header: Header<'a>,
        height: u32,
        width: u32,
        distortion_model: Cow<'a, str>,
        d: Vec<f64>,
        k: [f64; 9],
        r: [f64; 9],
        p: [f64; 12],
        binning_x: u32,
        binning_y: u32,
        roi: RegionOfInterest,
    }
    /// `sensor_msgs/Imu`.
    Imu<'a> {
        header: Header<'a>,
        orientation: Quaternion,
        orientation_covariance: [f64; 9],
        angular_velocity: Vector3,
        angular_velocity_covariance: [f64; 9],
        linear_acceleration: Vector3,
        linear_acceleration_covariance: [f64; 9],
    }
}
