//! Stamps, poses, vectors, covariances and cameras in message form.

use stillpoint_geometry::{Camera, Mat6, Se3, Vec3};
use stillpoint_ros_messages as ros;

/// Stamps of data sets have microseconds; further digits of a number of seconds are rounding.
pub(crate) fn nanoseconds(stamp: f64) -> u64 {
    let micro = (stamp * 1e6).round();
    if micro > 0.0 {
        (micro as u64).saturating_mul(1000)
    } else {
        0
    }
}

/// A stamp in seconds as ROS time.
pub(crate) fn time_of(stamp: f64) -> ros::Time {
    let time = nanoseconds(stamp);
    ros::Time {
        sec: (time / 1_000_000_000) as i64,
        nanosec: (time % 1_000_000_000) as u32,
    }
}

/// A pose in ROS axes, in the parts of its messages.
pub(crate) fn quaternion_and_point(pose: &Se3) -> (ros::Quaternion, ros::Point) {
    let t = &pose.translation;
    let point = ros::Point {
        x: t.x,
        y: t.y,
        z: t.z,
    };
    (quaternion(&pose.rotation), point)
}

pub(crate) fn quaternion(
    q: &stillpoint_geometry::nalgebra::UnitQuaternion<f64>,
) -> ros::Quaternion {
    ros::Quaternion {
        x: q.i,
        y: q.j,
        z: q.k,
        w: q.w,
    }
}

pub(crate) fn pose((orientation, position): &(ros::Quaternion, ros::Point)) -> ros::Pose {
    ros::Pose {
        position: position.clone(),
        orientation: orientation.clone(),
    }
}

pub(crate) fn vector(v: &Vec3) -> ros::Vector3 {
    ros::Vector3 {
        x: v.x,
        y: v.y,
        z: v.z,
    }
}

/// Row by row.
pub(crate) fn rows(covariance: &Mat6) -> ros::Covariance6 {
    ros::Covariance6(std::array::from_fn(|i| covariance[(i / 6, i % 6)]))
}

pub(crate) fn camera_info<'a>(camera: &Camera, header: ros::Header<'a>) -> ros::CameraInfo<'a> {
    let (c, d) = (camera, &camera.distortion);
    let (pinhole, lens) = ([c.fx, c.fy, c.cx, c.cy], [d.k1, d.k2, d.p1, d.p2, d.k3]);
    ros::CameraInfo::plumb_bob(header, [c.width, c.height], pinhole, lens)
}
