//! The axes of ROS (REP-103) and those of cameras.
//!
//! Poses of this project are of cameras: x to the right, y down, z forward, in the world and in the camera alike. ROS requires bodies and
//! worlds with x forward, y to the left, z up. The world's axes are those of the camera at the first frame, so *up* is up at that frame.
//!
//! Only the names of coordinates and their signs change, so nothing is rounded, and [`pose_to_optical`] inverts [`pose_to_ros`] exactly.

use stillpoint_geometry::nalgebra::{Quaternion, UnitQuaternion};
use stillpoint_geometry::{Mat3, Mat6, Se3, Vec3};

/// The rotation `body_from_optical`: that of the constant transform from `camera_link` to `camera_color_optical_frame`.
#[must_use]
pub fn body_from_optical() -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(0.5, -0.5, 0.5, -0.5))
}

/// Converts a point or vector from optical axes to ROS axes.
#[must_use]
pub fn point_to_ros(p: &Vec3) -> Vec3 {
    Vec3::new(p.z, -p.x, -p.y)
}

/// Converts a point or vector from ROS axes to optical axes.
#[must_use]
pub fn point_to_optical(p: &Vec3) -> Vec3 {
    Vec3::new(-p.y, -p.z, p.x)
}

/// Converts `world_from_camera`, both in optical axes, to `world_from_body`, both in ROS axes.
#[must_use]
pub fn pose_to_ros(pose: &Se3) -> Se3 {
    let q = &pose.rotation;
    let turned = Quaternion::new(q.w, q.k, -q.i, -q.j);
    Se3::new(
        UnitQuaternion::new_unchecked(turned),
        point_to_ros(&pose.translation),
    )
}

/// Inverse of [`pose_to_ros`].
#[must_use]
pub fn pose_to_optical(pose: &Se3) -> Se3 {
    let q = &pose.rotation;
    let turned = Quaternion::new(q.w, -q.j, -q.k, q.i);
    Se3::new(
        UnitQuaternion::new_unchecked(turned),
        point_to_optical(&pose.translation),
    )
}

/// Converts a covariance `[translation; rotation]` from optical axes to ROS axes.
#[must_use]
pub fn covariance_to_ros(covariance: &Mat6) -> Mat6 {
    let turn = Mat3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    turned(covariance, &turn)
}

/// A covariance `[translation; rotation]` in other axes: `rotation` maps to them.
pub(crate) fn turned(covariance: &Mat6, rotation: &Mat3) -> Mat6 {
    let mut both = Mat6::zeros();
    both.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation);
    both.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation);
    both * covariance * both.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use stillpoint_geometry::{Vec6, so3};

    fn poses() -> impl Strategy<Value = Se3> {
        prop::array::uniform6(-3.0..3.0_f64).prop_map(|t| Se3::exp(&Vec6::from(t)))
    }

    proptest! {
        #[test]
        fn pose_conversion_round_trips_exactly(pose in poses()) {
            prop_assert_eq!(pose_to_optical(&pose_to_ros(&pose)), pose);
        }

        #[test]
        fn points_and_poses_agree(pose in poses(), p in prop::array::uniform3(-9.0..9.0_f64)) {
            let p = Vec3::from(p);
            let there = pose_to_ros(&pose).transform(&point_to_ros(&p));
            prop_assert!((there - point_to_ros(&pose.transform(&p))).norm() < 1e-12);
            prop_assert_eq!(point_to_optical(&point_to_ros(&p)), p);
        }

        #[test]
        fn constant_transform_leads_to_the_optical_frame(pose in poses()) {
            // map -> camera_link -> optical, with the rotation of the world undone, is the camera's own pose.
            let constant = Se3::new(body_from_optical(), Vec3::zeros());
            let found = constant.inverse() * pose_to_ros(&pose) * constant;
            prop_assert!((found.translation - pose.translation).norm() < 1e-12);
            prop_assert!(found.rotation.angle_to(&pose.rotation) < 1e-7);
        }
    }

    #[test]
    fn forward_is_x_left_is_y_and_up_is_z() {
        let (right, down, forward) = (Vec3::x(), Vec3::y(), Vec3::z());
        assert_eq!(point_to_ros(&forward), Vec3::x());
        assert_eq!(point_to_ros(&-right), Vec3::y());
        assert_eq!(point_to_ros(&-down), Vec3::z());
        assert!((body_from_optical() * forward - Vec3::x()).norm() < 1e-15);
        // A turn to the left is about the axis that points up.
        let left = Se3::new(so3::exp(&Vec3::new(0.0, -0.3, 0.0)), Vec3::zeros());
        let turn = so3::log(&pose_to_ros(&left).rotation);
        assert!((turn - Vec3::new(0.0, 0.0, 0.3)).norm() < 1e-12);
    }

    #[test]
    fn variances_follow_their_axes() {
        let covariance = Mat6::from_diagonal(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0].into());
        let found = covariance_to_ros(&covariance).diagonal();
        assert_eq!(found.as_slice(), [3.0, 1.0, 2.0, 6.0, 4.0, 5.0]);
    }
}
