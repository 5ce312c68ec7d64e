//! Objects with a known position, as detections and as markers.

use crate::axes;
use crate::mount::Mount;
use crate::parts::{pose, quaternion_and_point, rows, vector};
use stillpoint_detection::{Motion, Object, ObjectInCamera, ObjectState};
use stillpoint_geometry::{Mat6, Se3, Vec3};
use stillpoint_ros_messages as ros;
use stillpoint_slam::FrameReport;

/// Kinds and actions of markers.
const ARROW: i32 = 0;
const CUBE: i32 = 1;
const TEXT: i32 = 9;
const DELETE_ALL: i32 = 3;
/// Speed below which no arrow is drawn, m/s.
const STANDS: f64 = 0.05;
/// Height of letters and thickness of arrows, m.
const LETTERS: f64 = 0.15;
const ARROW_SHAFT: f64 = 0.04;
const ARROW_HEAD: f64 = 0.1;
/// Side of an object of unknown size, m.
const UNKNOWN_SIZE: f64 = 0.3;

/// An object in the world, in ROS axes.
struct Placed<'a> {
    object: &'a Object,
    position: Vec3,
    velocity: Vec3,
    /// Of the position, in the axes of the world.
    covariance: Mat6,
    /// Width and height are those in the image, so the box has the camera's axes.
    world_from_box: Se3,
    size: [f64; 3],
}

impl<'a> Placed<'a> {
    fn new(
        object: &'a Object,
        seen: &ObjectInCamera,
        world_from_camera: &Se3,
        mount: &Mount,
    ) -> Self {
        let position = mount.point(&world_from_camera.transform(&seen.position));
        let velocity = axes::point_to_ros(&(world_from_camera.rotation * seen.velocity));
        let velocity = mount.direction(&velocity);
        let in_world = axes::turned(&seen.covariance, &world_from_camera.rotation_matrix());
        let mut covariance = Mat6::zeros();
        covariance
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&axes::covariance_to_ros(&in_world).fixed_view::<3, 3>(0, 0));
        let covariance = mount.point_covariance(&covariance);
        let mut world_from_box = mount.place(&axes::pose_to_ros(world_from_camera));
        world_from_box.translation = position;
        let [width, height] = object.size.unwrap_or([UNKNOWN_SIZE; 2]);
        Self {
            object,
            position,
            velocity,
            covariance,
            world_from_box,
            // The camera does not see its depth.
            size: [width, width, height],
        }
    }
}

/// The confirmed objects of a frame, in the frame of `header`.
pub(crate) fn messages<'a>(
    report: &FrameReport,
    world_from_camera: &Se3,
    mount: &Mount,
    header: &ros::Header<'a>,
) -> (ros::Detection3DArray<'a>, ros::MarkerArray<'a>) {
    let placed = report
        .objects
        .iter()
        .filter(|o| o.state != ObjectState::Tentative)
        .filter_map(|o| {
            Some(Placed::new(
                o,
                &o.seen_from(world_from_camera)?,
                world_from_camera,
                mount,
            ))
        });
    let placed: Vec<Placed<'_>> = placed.collect();
    let detections = placed.iter().map(|p| detection(p, header)).collect();
    let mut markers = vec![ros::Marker {
        header: header.clone(),
        action: DELETE_ALL,
        ..ros::Marker::default()
    }];
    for p in &placed {
        markers.push(cube(p, header));
        markers.extend(arrow(p, header));
        markers.push(name(p, header));
    }
    let detections = ros::Detection3DArray {
        header: header.clone(),
        detections,
    };
    (detections, ros::MarkerArray { markers })
}

fn detection<'a>(p: &Placed<'_>, header: &ros::Header<'a>) -> ros::Detection3D<'a> {
    let centre = pose(&quaternion_and_point(&p.world_from_box));
    ros::Detection3D {
        header: header.clone(),
        results: vec![ros::ObjectHypothesisWithPose {
            hypothesis: ros::ObjectHypothesis {
                class_id: p.object.class.name().into(),
                score: p.object.score.into(),
            },
            pose: ros::PoseWithCovariance {
                pose: centre.clone(),
                covariance: rows(&p.covariance),
            },
        }],
        bbox: ros::BoundingBox3D {
            center: centre,
            size: vector(&Vec3::from(p.size)),
        },
        id: p.object.id.0.to_string().into(),
    }
}

fn marker<'a>(
    p: &Placed<'_>,
    header: &ros::Header<'a>,
    kind: i32,
    namespace: &'static str,
) -> ros::Marker<'a> {
    ros::Marker {
        header: header.clone(),
        ns: namespace.into(),
        id: i32::try_from(p.object.id.0).unwrap_or(i32::MAX),
        r#type: kind,
        pose: pose(&quaternion_and_point(&p.world_from_box)),
        color: colour(p.object.motion),
        ..ros::Marker::default()
    }
}

fn cube<'a>(p: &Placed<'_>, header: &ros::Header<'a>) -> ros::Marker<'a> {
    let mut cube = marker(p, header, CUBE, "boxes");
    cube.scale = vector(&Vec3::from(p.size));
    cube.color.a = 0.4;
    cube
}

/// From the object to its position in a second.
fn arrow<'a>(p: &Placed<'_>, header: &ros::Header<'a>) -> Option<ros::Marker<'a>> {
    let moves = p.object.motion == Motion::Moving && p.velocity.norm() > STANDS;
    moves.then(|| {
        let mut arrow = marker(p, header, ARROW, "velocity");
        arrow.pose = ros::Pose::default();
        arrow.pose.orientation.w = 1.0;
        let point = |v: Vec3| ros::Point {
            x: v.x,
            y: v.y,
            z: v.z,
        };
        arrow.points = vec![point(p.position), point(p.position + p.velocity)];
        arrow.scale = vector(&Vec3::new(ARROW_SHAFT, ARROW_HEAD, 0.0));
        arrow
    })
}

fn name<'a>(p: &Placed<'_>, header: &ros::Header<'a>) -> ros::Marker<'a> {
    let mut name = marker(p, header, TEXT, "names");
    name.pose.position.z += 0.5 * p.size[2] + LETTERS;
    name.scale.z = LETTERS;
    name.text = match p.object.motion {
        Motion::Moving => format!(
            "{} {}  {:.1} m/s",
            p.object.class,
            p.object.id.0,
            p.velocity.norm()
        ),
        Motion::Parked => format!("{} {} parked", p.object.class, p.object.id.0),
        Motion::Unknown => format!("{} {}", p.object.class, p.object.id.0),
    }
    .into();
    name
}

fn colour(motion: Motion) -> ros::ColorRgba {
    let [r, g, b] = match motion {
        Motion::Moving => [0.9, 0.2, 0.15],
        Motion::Parked => [0.5, 0.5, 0.55],
        Motion::Unknown => [0.95, 0.75, 0.1],
    };
    ros::ColorRgba { r, g, b, a: 1.0 }
}
