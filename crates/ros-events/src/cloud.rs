//! The landmarks and keyframes of a submap.

use crate::axes;
use crate::publisher::{pose, quaternion_and_point};
use stillpoint_map::{MapView, SubmapId};
use stillpoint_ros_messages as ros;

/// Bytes of a point: x, y, z, how likely it stands still, and how many keyframes saw it.
const POINT: usize = 20;

/// The landmarks, in the frame of the submap.
pub(crate) fn landmarks<'a>(
    view: &MapView,
    submap: SubmapId,
    header: ros::Header<'a>,
) -> ros::PointCloud2<'a> {
    let mut data = Vec::with_capacity(POINT * view.landmark_count());
    for (id, landmark) in view.landmarks() {
        if view.submap_of(landmark.anchor) != Some(submap) {
            continue;
        }
        let Some(position) = view.landmark_position(id) else {
            continue;
        };
        let p = axes::point_to_ros(&position);
        let likely = 1.0 / (1.0 + (-landmark.static_odds).exp());
        for x in [p.x as f32, p.y as f32, p.z as f32, likely] {
            data.extend_from_slice(&x.to_le_bytes());
        }
        data.extend_from_slice(&landmark.observers.to_le_bytes());
    }
    let points = (data.len() / POINT) as u32;
    let field = |name: &'static str, offset: u32, datatype: u8| ros::PointField {
        name: name.into(),
        offset,
        datatype,
        count: 1,
    };
    ros::PointCloud2 {
        header,
        height: 1,
        width: points,
        fields: vec![
            field("x", 0, ros::PointField::FLOAT32),
            field("y", 4, ros::PointField::FLOAT32),
            field("z", 8, ros::PointField::FLOAT32),
            field("stands_still", 12, ros::PointField::FLOAT32),
            field("observers", 16, ros::PointField::UINT32),
        ],
        is_bigendian: false,
        point_step: POINT as u32,
        row_step: POINT as u32 * points,
        data: data.into(),
        is_dense: true,
    }
}

/// The keyframes' bodies in order of time, in the frame of the submap.
pub(crate) fn path<'a>(
    view: &MapView,
    submap: SubmapId,
    header: &ros::Header<'a>,
    stamp: impl Fn(f64) -> ros::Time,
) -> ros::Path<'a> {
    let mut keyframes: Vec<_> = view.keyframes().filter(|k| k.submap == submap).collect();
    keyframes.sort_by(|a, b| a.data.stamp.total_cmp(&b.data.stamp));
    let poses = keyframes.into_iter().map(|k| ros::PoseStamped {
        header: ros::Header {
            stamp: stamp(k.data.stamp),
            ..header.clone()
        },
        pose: pose(&quaternion_and_point(&axes::pose_to_ros(
            &k.world_from_camera,
        ))),
    });
    ros::Path {
        header: header.clone(),
        poses: poses.collect(),
    }
}
