//! The camera's mount on a body, so that the body's frame can be published instead of the camera's.
//!
//! The world of a run has the axes of the first camera. The map of a robot has those of the robot's base at that moment: x forward, z up,
//! whatever the camera's direction.

use crate::axes;
use stillpoint_geometry::{Mat3, Mat6, Se3, Vec3, Vec6};

/// Pose of the camera's body (x forward) on the base; the default is the base itself, and rounds nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mount {
    base_from_body: Option<Se3>,
}

impl Mount {
    /// From the transform from the optical frame (z forward) to the base, as chains of transforms give it.
    #[must_use]
    pub fn of_optical(base_from_optical: &Se3) -> Self {
        let body_from_optical = Se3::new(axes::body_from_optical(), Vec3::zeros());
        let pose = *base_from_optical * body_from_optical.inverse();
        let is_base = pose.translation.norm() < 1e-12 && pose.rotation.angle() < 1e-9;
        Self {
            base_from_body: (!is_base).then_some(pose),
        }
    }

    /// `base_from_body`.
    #[must_use]
    pub fn pose(&self) -> Se3 {
        self.base_from_body.unwrap_or_else(Se3::identity)
    }

    /// The up direction in the world of a run: away from the floor of the base.
    #[must_use]
    pub fn up(&self) -> Vec3 {
        axes::point_to_optical(&(self.pose().rotation.inverse() * Vec3::z()))
    }

    /// Pose of the base in the map, from the camera's in the world.
    pub(crate) fn base(&self, world_from_camera: &Se3) -> Se3 {
        let pose = axes::pose_to_ros(world_from_camera);
        self.base_from_body
            .map_or(pose, |mount| mount * pose * mount.inverse())
    }

    /// Converts a point of the world (m) to the map.
    pub(crate) fn point(&self, p: &Vec3) -> Vec3 {
        let p = axes::point_to_ros(p);
        self.base_from_body.map_or(p, |mount| mount.transform(&p))
    }

    /// Converts a pose in the world in ROS axes to the map: only its parent changes.
    pub(crate) fn place(&self, pose: &Se3) -> Se3 {
        self.base_from_body.map_or(*pose, |mount| mount * *pose)
    }

    /// Converts a direction of the world in ROS axes to the map.
    pub(crate) fn direction(&self, v: &Vec3) -> Vec3 {
        self.base_from_body.map_or(*v, |mount| mount.rotation * *v)
    }

    /// Converts the covariance of a point in the world in ROS axes to the map.
    pub(crate) fn point_covariance(&self, covariance: &Mat6) -> Mat6 {
        self.base_from_body.map_or(*covariance, |mount| {
            axes::turned(covariance, &mount.rotation_matrix())
        })
    }

    /// The covariance `[translation; rotation]` of the base's pose, about the axes of `odom`, from that of the camera's pose about the axes
    /// of its world. `odom_from_base` gives the direction of the lever between them.
    pub(crate) fn covariance(&self, of_camera: &Mat6, odom_from_base: &Se3) -> Mat6 {
        let covariance = axes::covariance_to_ros(of_camera);
        let Some(mount) = self.base_from_body else {
            return covariance;
        };
        let turned = axes::turned(&covariance, &mount.rotation_matrix());
        let lever = -(odom_from_base.rotation * mount.translation);
        carried(&turned, &lever)
    }

    /// Covariance of the base's velocity in its own axes, from the camera's in its own.
    pub(crate) fn velocity_covariance(&self, of_camera: &Mat6) -> Mat6 {
        let covariance = axes::covariance_to_ros(of_camera);
        let Some(mount) = self.base_from_body else {
            return covariance;
        };
        let turned = axes::turned(&covariance, &mount.rotation_matrix());
        carried(&turned, &-mount.translation)
    }

    /// Velocity `[linear; angular]` of the base in its own axes, from the camera's in its own (optical).
    pub(crate) fn velocity(&self, of_camera: &Vec6) -> [Vec3; 2] {
        let [linear, angular] = [0, 3].map(|at| {
            let part: Vec3 = of_camera.fixed_rows::<3>(at).into();
            axes::point_to_ros(&part)
        });
        let Some(mount) = self.base_from_body else {
            return [linear, angular];
        };
        let angular = mount.rotation * angular;
        let linear = mount.rotation * linear + angular.cross(&-mount.translation);
        [linear, angular]
    }
}

/// A covariance `[translation; rotation]` of a point of a rigid body, from that of a point `lever` away: `t' = t + r x lever`.
fn carried(covariance: &Mat6, lever: &Vec3) -> Mat6 {
    let cross = Mat3::new(
        0.0, lever.z, -lever.y, -lever.z, 0.0, lever.x, lever.y, -lever.x, 0.0,
    );
    let mut jacobian = Mat6::identity();
    jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
    jacobian * covariance * jacobian.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn poses() -> impl Strategy<Value = Se3> {
        prop::array::uniform6(-1.0..1.0_f64).prop_map(|t| Se3::exp(&Vec6::from(t)))
    }

    proptest! {
        #[test]
        fn transform_chain_leads_to_the_camera(base_from_optical in poses(), world_from_camera in poses(), p in prop::array::uniform3(-2.0..2.0_f64)) {
            let mount = Mount::of_optical(&base_from_optical);
            // map -> base -> optical maps a point of the camera to its place in the map.
            let p = Vec3::from(p);
            let by_chain = mount.base(&world_from_camera).transform(&base_from_optical.transform(&p));
            let direct = mount.point(&world_from_camera.transform(&p));
            prop_assert!((by_chain - direct).norm() < 1e-9);
            // At first, the base is the map.
            let at_first = mount.base(&Se3::identity());
            prop_assert!(at_first.translation.norm() < 1e-12);
        }

        #[test]
        fn velocity_matches_the_base_motion(base_from_optical in poses(), velocity in prop::array::uniform6(-1.0..1.0_f64)) {
            let mount = Mount::of_optical(&base_from_optical);
            let velocity = Vec6::from(velocity);
            let [linear, angular] = mount.velocity(&velocity);
            let dt = 1e-6;
            let step = mount.base(&Se3::exp(&(velocity * dt))).log() / dt;
            prop_assert!((step.fixed_rows::<3>(0) - linear).norm() < 1e-4);
            prop_assert!((step.fixed_rows::<3>(3) - angular).norm() < 1e-4);
        }

        #[test]
        fn covariances_include_the_lever_arm(base_from_optical in poses(), odom_from_camera in poses(), turn in prop::array::uniform6(-1.0..1.0_f64)) {
            // A small motion of the camera about the axes of its world, and its effect on the base.
            let mount = Mount::of_optical(&base_from_optical);
            let small = Vec6::from(turn) * 1e-6;
            let (t, r): (Vec3, Vec3) = (small.fixed_rows::<3>(0).into(), small.fixed_rows::<3>(3).into());
            let moved = Se3::new(
                stillpoint_geometry::so3::exp(&r) * odom_from_camera.rotation,
                odom_from_camera.translation + t,
            );
            let (before, after) = (mount.base(&odom_from_camera), mount.base(&moved));
            let shift = after.translation - before.translation;
            let about = stillpoint_geometry::so3::log(&(after.rotation * before.rotation.inverse()));
            let found = mount.covariance(&(small * small.transpose()), &before);
            let mut expected = Vec6::zeros();
            expected.fixed_rows_mut::<3>(0).copy_from(&shift);
            expected.fixed_rows_mut::<3>(3).copy_from(&about);
            let off = (found - expected * expected.transpose()).norm();
            prop_assert!(off < 1e-3 * small.norm_squared(), "{off}");
        }
    }

    #[test]
    fn camera_as_base_gives_the_default_mount() {
        let optical = Se3::new(axes::body_from_optical(), Vec3::zeros());
        assert_eq!(Mount::of_optical(&optical), Mount::default());
    }
}
