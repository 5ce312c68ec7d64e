//! Poses and transforms.

use super::Header;
use std::borrow::Cow;

messages! {
    Vector3 "geometry_msgs/msg/Vector3" { x: f64, y: f64, z: f64, }
    Point "geometry_msgs/msg/Point" { x: f64, y: f64, z: f64, }
    Quaternion "geometry_msgs/msg/Quaternion" { x: f64, y: f64, z: f64, w: f64, }
    Pose "geometry_msgs/msg/Pose" { position: Point, orientation: Quaternion, }
    PoseStamped<'a> "geometry_msgs/msg/PoseStamped" "d3812c3cbc69362b77dc0b19b345f8f5" { header: Header<'a>, pose: Pose, }
    Transform "geometry_msgs/msg/Transform" { translation: Vector3, rotation: Quaternion, }
    TransformStamped<'a> "geometry_msgs/msg/TransformStamped" "b5764a33bfeb3588febc2682852579b0" {
        header: Header<'a>,
        child_frame_id: Cow<'a, str>,
        transform: Transform,
    }
    TfMessage<'a> "tf2_msgs/msg/TFMessage" "94810edda583a504dfda3829e70d7eec" { transforms: Vec<TransformStamped<'a>>, }
    Twist "geometry_msgs/msg/Twist" { linear: Vector3, angular: Vector3, }
    PoseWithCovariance "geometry_msgs/msg/PoseWithCovariance" { pose: Pose, covariance: Covariance6, }
    TwistWithCovariance "geometry_msgs/msg/TwistWithCovariance" { twist: Twist, covariance: Covariance6, }
}

/// Covariance of x, y, z and of rotations about x, y, z, row by row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance6(pub [f64; 36]);

impl Default for Covariance6 {
    fn default() -> Self {
        Self([0.0; 36])
    }
}

impl crate::wire::Wire<'_> for Covariance6 {
    fn read(from: &mut crate::wire::Reader<'_>) -> Result<Self, crate::wire::WireError> {
        crate::wire::Wire::read(from).map(Self)
    }

    fn write(&self, to: &mut crate::wire::Writer) {
        self.0.write(to);
    }
}

impl crate::describe::Described for Covariance6 {
    fn type_text(version: crate::describe::Version) -> String {
        <[f64; 36]>::type_text(version)
    }

    fn sections(_: crate::describe::Version, _: &mut Vec<crate::describe::Section>) {}
}
