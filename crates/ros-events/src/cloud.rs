//! The landmarks and keyframes of a submap.

use crate::mount::Mount;
use crate::parts::{pose, quaternion_and_point};
use stillpoint_geometry::Vec3;
use stillpoint_map::{MapView, SubmapId};
use stillpoint_ros_messages as ros;

/// The landmarks with their static probability and number of keyframe observations, in the frame of the submap.
pub(crate) fn landmarks<'a>(
    view: &MapView,
    submap: SubmapId,
    mount: &Mount,
    header: ros::Header<'a>,
) -> ros::PointCloud2<'a> {
    let mut data = Vec::with_capacity(20 * view.landmark_count());
    for (id, landmark) in view.landmarks() {
        if view.submap_of(landmark.anchor) != Some(submap) {
            continue;
        }
        let Some(position) = view.landmark_position(id) else {
            continue;
        };
        let p = mount.point(&position);
        let likely = 1.0 / (1.0 + (-landmark.static_odds).exp());
        for x in [p.x as f32, p.y as f32, p.z as f32, likely] {
            data.extend_from_slice(&x.to_le_bytes());
        }
        data.extend_from_slice(&landmark.observers.to_le_bytes());
    }
    let fields = [
        ("stands_still", ros::PointField::FLOAT32),
        ("observers", ros::PointField::UINT32),
    ];
    cloud(header, &fields, data)
}

/// Coloured points of a surface (m) in the world.
pub(crate) fn surface<'a>(
    points: &[([f32; 3], [u8; 3])],
    mount: &Mount,
    header: ros::Header<'a>,
) -> ros::PointCloud2<'a> {
    let mut data = Vec::with_capacity(16 * points.len());
    for (p, [r, g, b]) in points {
        let p = mount.point(&Vec3::from(p.map(f64::from)));
        for x in [p.x as f32, p.y as f32, p.z as f32] {
            data.extend_from_slice(&x.to_le_bytes());
        }
        // As rviz requires: the bytes of 0x00rrggbb, in a field declared as float.
        data.extend_from_slice(&[*b, *g, *r, 0]);
    }
    cloud(header, &[("rgb", ros::PointField::FLOAT32)], data)
}

/// A cloud of x, y and z and these fields, of four bytes each.
fn cloud<'a>(
    header: ros::Header<'a>,
    fields: &[(&'static str, u8)],
    data: Vec<u8>,
) -> ros::PointCloud2<'a> {
    let place = ["x", "y", "z"].map(|name| (name, ros::PointField::FLOAT32));
    let all = place.iter().chain(fields).enumerate();
    let fields: Vec<ros::PointField<'a>> = all
        .map(|(i, (name, datatype))| ros::PointField {
            name: (*name).into(),
            offset: 4 * i as u32,
            datatype: *datatype,
            count: 1,
        })
        .collect();
    let step = 4 * fields.len() as u32;
    let points = data.len() as u32 / step;
    ros::PointCloud2 {
        header,
        height: 1,
        width: points,
        fields,
        is_bigendian: false,
        point_step: step,
        row_step: step * points,
        data: data.into(),
        is_dense: true,
    }
}

/// The keyframes' bodies in order of time, in the frame of the submap.
pub(crate) fn path<'a>(
    view: &MapView,
    submap: SubmapId,
    mount: &Mount,
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
        pose: pose(&quaternion_and_point(&mount.base(&k.world_from_camera))),
    });
    ros::Path {
        header: header.clone(),
        poses: poses.collect(),
    }
}
