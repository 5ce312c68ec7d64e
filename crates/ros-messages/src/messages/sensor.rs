//! Images, cameras, motion and points.

use super::{Header, Quaternion, Vector3};
use std::borrow::Cow;

messages! {
    Image<'a> "sensor_msgs/msg/Image" "060021388200f6f0f447d0fcd9c64743" {
        header: Header<'a>,
        height: u32,
        width: u32,
        encoding: Cow<'a, str>,
        is_bigendian: u8,
        step: u32,
        data: Cow<'a, [u8]>,
    }
    CompressedImage<'a> "sensor_msgs/msg/CompressedImage" "8f7a12909da2c9d3332d540a0977563f" {
        header: Header<'a>,
        format: Cow<'a, str>,
        data: Cow<'a, [u8]>,
    }
    RegionOfInterest "sensor_msgs/msg/RegionOfInterest" {
        x_offset: u32,
        y_offset: u32,
        height: u32,
        width: u32,
        do_rectify: bool,
    }
    CameraInfo<'a> "sensor_msgs/msg/CameraInfo" "c9a58c1b0b154e0e6da7578cb991d214" {
        header: Header<'a>,
        height: u32,
        width: u32,
        distortion_model: Cow<'a, str>,
        d / D: Vec<f64>,
        k / K: [f64; 9],
        r / R: [f64; 9],
        p / P: [f64; 12],
        binning_x: u32,
        binning_y: u32,
        roi: RegionOfInterest,
    }
    Imu<'a> "sensor_msgs/msg/Imu" "6a62c6daae103f4ff57a132d6f95cec2" {
        header: Header<'a>,
        orientation: Quaternion,
        orientation_covariance: [f64; 9],
        angular_velocity: Vector3,
        angular_velocity_covariance: [f64; 9],
        linear_acceleration: Vector3,
        linear_acceleration_covariance: [f64; 9],
    }
    PointField<'a> "sensor_msgs/msg/PointField" {
        name: Cow<'a, str>,
        offset: u32,
        datatype: u8,
        count: u32,
    }
    PointCloud2<'a> "sensor_msgs/msg/PointCloud2" "1158d486dd51d683ce2f1be655c3c181" {
        header: Header<'a>,
        height: u32,
        width: u32,
        fields: Vec<PointField<'a>>,
        is_bigendian: bool,
        point_step: u32,
        row_step: u32,
        data: Cow<'a, [u8]>,
        is_dense: bool,
    }
}

/// Types of a [`PointField`].
impl<'a> CameraInfo<'a> {
    /// A single camera with Brown-Conrady distortion: `size` is its width and height, `pinhole` is fx, fy, cx, cy, `lens` k1, k2, p1, p2,
    /// k3.
    #[must_use]
    pub fn plumb_bob(
        header: Header<'a>,
        size: [u32; 2],
        pinhole: [f64; 4],
        lens: [f64; 5],
    ) -> Self {
        let [fx, fy, cx, cy] = pinhole;
        Self {
            header,
            height: size[1],
            width: size[0],
            distortion_model: "plumb_bob".into(),
            d: lens.to_vec(),
            k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
            ..Self::default()
        }
    }
}

impl PointField<'_> {
    pub const INT8: u8 = 1;
    pub const UINT8: u8 = 2;
    pub const INT16: u8 = 3;
    pub const UINT16: u8 = 4;
    pub const INT32: u8 = 5;
    pub const UINT32: u8 = 6;
    pub const FLOAT32: u8 = 7;
    pub const FLOAT64: u8 = 8;
}
