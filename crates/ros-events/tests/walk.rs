//! A simulated walk past people: its messages agree with its events.

use std::collections::BTreeMap;
use std::sync::OnceLock;
use stillpoint_detection::{
    BoundingBox, ClassId, Detection, Detector, ScriptRow, ScriptedDetector,
};
use stillpoint_geometry::nalgebra::{Quaternion, UnitQuaternion};
use stillpoint_geometry::{Camera, Se3, Vec3};
use stillpoint_ros_events::{FrameNames, Outgoing, Publisher, Topic, axes};
use stillpoint_ros_messages as ros;
use stillpoint_ros_messages::{Format, Wire, from_bytes};
use stillpoint_simulator::{DetectionNoise, Simulator, SimulatorConfig};
use stillpoint_slam::{Config, Event, FrameEvent, Simd, System};

const FRAMES: usize = 60;

struct Walk {
    events: Vec<Event>,
    messages: Vec<Outgoing>,
}

fn walk() -> &'static Walk {
    static WALK: OnceLock<Walk> = OnceLock::new();
    WALK.get_or_init(|| {
        let simulator = Simulator::new(&SimulatorConfig {
            scene: "walking_xyz".to_owned(),
            frames: Some(FRAMES),
            camera: Camera::pinhole(320, 240, [267.5, 267.5, 159.5, 119.5]),
            ..SimulatorConfig::default()
        })
        .unwrap();
        let noise = DetectionNoise {
            min_visible_px: 100,
            ..DetectionNoise::default()
        };
        let rows = (0..FRAMES).flat_map(|i| simulator.detections(i, &noise));
        let rows = rows.map(|d| ScriptRow {
            stamp: d.stamp,
            detection: Detection {
                class: ClassId::from_name(d.class).unwrap(),
                score: d.score,
                bounds: BoundingBox {
                    x0: d.x0,
                    y0: d.y0,
                    x1: d.x1,
                    y1: d.y1,
                },
            },
        });
        let detector = ScriptedDetector::new("the simulator's", rows.collect()).unwrap();
        let detector: Box<dyn Detector> = Box::new(detector);
        let camera = *simulator.camera();
        let system = System::new(Config::default(), camera, Simd::detect()).unwrap();
        let mut system = system.with_detector(detector);
        let mut publisher = Publisher::new(camera, FrameNames::default());
        let (mut events, mut messages) = (Vec::new(), Vec::new());
        for i in 0..FRAMES {
            for event in system.step(simulator.frame(i)) {
                messages.extend(publisher.publish(&event));
                if event.as_frame().is_some() {
                    messages.extend(publisher.picture(vec![0xff, 0xd8]));
                }
                events.push(event);
            }
        }
        for event in system.finish() {
            messages.extend(publisher.publish(&event));
            events.push(event);
        }
        messages.extend(publisher.finish());
        messages.push(publisher.mask(3, 2, &[0, 255, 0, 0, 0, 255]));
        messages.push(publisher.surface(&[([1.0, 2.0, 3.0], [9, 8, 7])]));
        let corner = publisher
            .map_from_world()
            .transform(&Vec3::new(0.5, 1.0, 2.0));
        messages.push(publisher.grid(2, 0.05, &corner, vec![-1, 0, 100, 0, 0, 0]));
        Walk { events, messages }
    })
}

fn frames() -> impl Iterator<Item = &'static FrameEvent> {
    walk().events.iter().filter_map(Event::as_frame)
}

fn messages<T: Wire<'static>>(topic: Topic) -> Vec<(u64, T)> {
    let of_topic = walk().messages.iter().filter(|m| m.topic == topic);
    of_topic
        .map(|m| {
            let message = from_bytes(&m.bytes, Format::CdrLittleEndian);
            (m.time, message.unwrap())
        })
        .collect()
}

fn pose(transform: &ros::Transform) -> Se3 {
    let (t, q) = (&transform.translation, &transform.rotation);
    Se3::new(
        UnitQuaternion::new_unchecked(Quaternion::new(q.w, q.x, q.y, q.z)),
        Vec3::new(t.x, t.y, t.z),
    )
}

fn microseconds(stamp: f64) -> u64 {
    (stamp * 1e6).round() as u64 * 1000
}

#[test]
fn transform_chain_gives_the_pose_of_every_frame() {
    let fixed = messages::<ros::TfMessage<'_>>(Topic::TfStatic);
    let constant = &fixed[0].1.transforms[0];
    assert_eq!(constant.header.frame_id, "camera_link");
    assert_eq!(constant.child_frame_id, "camera_color_optical_frame");
    assert_eq!(fixed.len(), 1);
    let found: BTreeMap<u64, _> = messages::<ros::TfMessage<'_>>(Topic::Tf)
        .into_iter()
        .collect();
    let mut tracked = 0;
    for frame in frames() {
        let Some(expected) = frame.report.world_from_camera else {
            continue;
        };
        tracked += 1;
        let [first, second] = &found[&microseconds(frame.report.stamp)].transforms[..] else {
            panic!("expected two transforms");
        };
        let names = |t: &ros::TransformStamped<'_>| {
            (
                t.header.frame_id.clone().into_owned(),
                t.child_frame_id.clone().into_owned(),
            )
        };
        assert_eq!(names(first), ("map".to_owned(), "odom".to_owned()));
        assert_eq!(names(second), ("odom".to_owned(), "camera_link".to_owned()));
        let map_from_body = pose(&first.transform) * pose(&second.transform);
        let world_from_camera = axes::pose_to_optical(&map_from_body);
        let off = (world_from_camera.inverse() * expected).log().norm();
        assert!(off < 1e-12, "{off}");
        // The same by the constant transform: the world's own axes remain.
        let map_from_optical = map_from_body * pose(&constant.transform);
        let undone = axes::body_from_optical().inverse() * map_from_optical.translation;
        assert!((undone - expected.translation).norm() < 1e-12);
    }
    assert!(tracked > FRAMES / 2 && tracked == found.len());
}

#[test]
fn odometry_matches_the_odom_transform() {
    let odometry = messages::<ros::Odometry<'_>>(Topic::Odometry);
    let transforms = messages::<ros::TfMessage<'_>>(Topic::Tf);
    assert_eq!(odometry.len(), transforms.len());
    let mut before: Option<(f64, Vec3)> = None;
    for ((time, o), (_, tf)) in odometry.iter().zip(&transforms) {
        assert_eq!(
            (o.header.frame_id.as_ref(), o.child_frame_id.as_ref()),
            ("odom", "camera_link")
        );
        let (p, t) = (&o.pose.pose.position, &tf.transforms[1].transform);
        let position = Vec3::new(p.x, p.y, p.z);
        assert_eq!(position, pose(t).translation);
        assert_eq!(o.pose.pose.orientation, t.rotation);
        let c = &o.pose.covariance.0;
        for i in 0..6 {
            assert!(c[7 * i] >= 0.0, "{c:?}");
            for j in 0..6 {
                assert!((c[6 * i + j] - c[6 * j + i]).abs() < 1e-9);
            }
        }
        let now = *time as f64 * 1e-9;
        if let Some((then, was)) = before {
            let v = &o.twist.twist.linear;
            let speed = Vec3::new(v.x, v.y, v.z).norm();
            let expected = (position - was).norm() / (now - then);
            assert!((speed - expected).abs() < 0.02 + 0.05 * expected);
        }
        before = Some((now, position));
    }
    // Variances of millimetres, and of millimetres per hundredth of a second: neither zero nor unknown.
    let last = &odometry.last().unwrap().1;
    let (pose, twist) = (last.pose.covariance.0[0], last.twist.covariance.0[0]);
    assert!(pose > 1e-10 && pose < 1e-2, "{pose}");
    assert!(twist > 1e-8 && twist < 1.0, "{twist}");
}

#[test]
fn last_map_message_equals_the_final_map() {
    let view = walk().events.iter().filter_map(Event::view).next_back();
    let view = view.unwrap();
    let clouds = messages::<ros::PointCloud2<'_>>(Topic::Map);
    let paths = messages::<ros::Path<'_>>(Topic::Path);
    // Two seconds: the first map, one a second later, and the last.
    assert!((2..=5).contains(&clouds.len()) && clouds.len() == paths.len());
    let cloud = &clouds.last().unwrap().1;
    assert_eq!(cloud.width as usize, view.landmark_count());
    assert_eq!(cloud.data.len(), (cloud.point_step * cloud.width) as usize);
    let (id, _) = view.landmarks().next().unwrap();
    let expected = axes::point_to_ros(&view.landmark_position(id).unwrap());
    let x = f32::from_le_bytes(cloud.data[..4].try_into().unwrap());
    assert_eq!(x, expected.x as f32);
    assert_eq!(
        paths.last().unwrap().1.poses.len(),
        view.keyframes().count()
    );
}

#[test]
fn people_are_published_at_their_positions() {
    let arrays = messages::<ros::Detection3DArray<'_>>(Topic::Objects);
    let found: Vec<_> = arrays.iter().flat_map(|(_, a)| &a.detections).collect();
    assert!(found.len() > 20, "{}", found.len());
    let is_person = |d: &&&ros::Detection3D<'_>| d.results[0].hypothesis.class_id == "person";
    assert!(found.iter().filter(is_person).count() > found.len() / 2);
    for d in &found {
        let (p, size) = (&d.bbox.center.position, &d.bbox.size);
        // In the room, before the camera, and as large as people.
        assert!(
            p.x > 0.3 && p.x < 8.0 && p.y.abs() < 5.0 && p.z.abs() < 2.5,
            "{p:?}"
        );
        assert!(size.z > 0.0 && size.z < 3.0, "{size:?}");
        assert!(d.results[0].pose.covariance.0[0] > 0.0);
    }
    let markers = messages::<ros::MarkerArray<'_>>(Topic::Markers);
    for ((_, markers), (_, objects)) in markers.iter().zip(&arrays) {
        let cubes = markers.markers.iter().filter(|m| m.ns == "boxes");
        assert_eq!(cubes.count(), objects.detections.len());
        // Removes earlier markers.
        assert_eq!(markers.markers[0].action, 3);
    }
    let arrows = markers.iter().flat_map(|(_, m)| &m.markers);
    assert!(arrows.filter(|m| m.ns == "velocity").count() > 0);
}

#[test]
fn every_frame_has_health_and_picture_messages() {
    let all = messages::<ros::DiagnosticArray<'_>>(Topic::Diagnostics);
    assert_eq!(all.len(), FRAMES);
    for ((time, message), frame) in all.iter().zip(frames()) {
        assert_eq!(*time, microseconds(frame.report.stamp));
        let status = &message.status[0];
        assert_eq!(status.message, frame.health.to_string());
        let lost = frame.health.loss.is_some();
        assert_eq!(status.level == 2, lost);
        let quality = status.values.iter().find(|v| v.key == "quality").unwrap();
        let quality: f64 = quality.value.parse().unwrap();
        assert!((quality - frame.health.quality.value()).abs() < 1e-6);
    }
    let infos = messages::<ros::CameraInfo<'_>>(Topic::CameraInfo);
    assert_eq!(infos.len(), FRAMES);
    assert_eq!((infos[0].1.width, infos[0].1.k[0]), (320, 267.5));
    let images = messages::<ros::CompressedImage<'_>>(Topic::Image);
    assert_eq!(images.len(), FRAMES);
    assert_eq!(images[0].1.header.frame_id, "camera_color_optical_frame");
}

#[test]
fn every_topic_has_a_type_and_is_published() {
    for topic in Topic::ALL {
        let definition = topic.definition();
        assert!(!definition.is_empty() && topic.type_name().contains("/msg/"));
        assert!(topic.name().starts_with('/'));
        let sent = walk().messages.iter().any(|m| m.topic == topic);
        assert!(sent, "{topic:?}");
    }
}

#[test]
fn masks_surfaces_and_grids_match_their_input() {
    let (_, mask) = &messages::<ros::Image<'_>>(Topic::Mask)[0];
    assert_eq!((mask.width, mask.height, mask.step), (3, 2, 3));
    assert_eq!(mask.data[..], [0, 255, 0, 0, 0, 255]);
    let (_, cloud) = &messages::<ros::PointCloud2<'_>>(Topic::Surface)[0];
    assert_eq!((cloud.width, cloud.point_step), (1, 16));
    let number = |at: usize| f32::from_le_bytes(cloud.data[at..at + 4].try_into().unwrap());
    // Forward, left, up.
    assert_eq!([number(0), number(4), number(8)], [3.0, -1.0, -2.0]);
    assert_eq!(cloud.data[12..], [7, 8, 9, 0]);
    let (_, grid) = &messages::<ros::OccupancyGrid<'_>>(Topic::Grid)[0];
    assert_eq!((grid.info.width, grid.info.height), (2, 3));
    assert_eq!(grid.data, [-1, 0, 100, 0, 0, 0]);
    let origin = &grid.info.origin;
    let p = &origin.position;
    assert!((Vec3::new(p.x, p.y, p.z) - Vec3::new(2.0, -0.5, -1.0)).norm() < 1e-12);
    assert_eq!(origin.orientation.w, 1.0);
}
