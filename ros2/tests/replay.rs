//! Frames of a node's recording equal those it tracked, in number, stamps and pixels.

use std::path::Path;
use stillpoint::geometry::Camera;
use stillpoint::imaging::{FrameId, FrameSource, RgbdFrame};
use stillpoint::recordings::{
    FrameOptions, ImageMessage, Incoming, IncomingTopic, OpenOptions, Transforms,
    camera_info_topic, open,
};
use stillpoint::ros_messages as ros;
use stillpoint::ros_messages::{Format, Message, Version, to_bytes};
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint_ros2::odometry::{Rolled, mounted};
use stillpoint_ros2::pairing::{Pairing, Stream};
use stillpoint_ros2::record::{Entry, Recorder, Recording};

const COLOUR: &str = "/front/rgb/image_raw";
const DEPTH: &str = "/front/depth_registered/image_raw";
const FRAMES: usize = 6;

fn cdr<'a, T: ros::Wire<'a>>(message: &T) -> Vec<u8> {
    to_bytes(message, Format::CdrLittleEndian)
}

fn header(stamp: f64) -> ros::Header<'static> {
    let ns = (stamp * 1e9).round() as u64;
    ros::Header {
        seq: 0,
        stamp: ros::Time {
            sec: (ns / 1_000_000_000) as i64,
            nanosec: (ns % 1_000_000_000) as u32,
        },
        frame_id: "eye".into(),
    }
}

/// Messages of a frame as sent by a driver: colour, and depth in millimetres.
fn messages(frame: &RgbdFrame, at: f64) -> (Vec<u8>, Vec<u8>) {
    let (width, height) = (frame.gray.width() as u32, frame.gray.height() as u32);
    let colour = ros::Image {
        header: header(at),
        height,
        width,
        encoding: "mono8".into(),
        is_bigendian: 0,
        step: width,
        data: frame.gray.data().into(),
    };
    let millimetres = frame.depth.data().iter().map(|z| (z * 1e3).round() as u16);
    let data: Vec<u8> = millimetres.flat_map(u16::to_le_bytes).collect();
    let depth = ros::Image {
        header: header(at + 0.0121),
        height,
        width,
        encoding: "16UC1".into(),
        is_bigendian: 0,
        step: 2 * width,
        data: data.into(),
    };
    (cdr(&colour), cdr(&depth))
}

fn info(camera: &Camera) -> Vec<u8> {
    let c = camera;
    cdr(&ros::CameraInfo {
        header: header(0.0),
        height: c.height,
        width: c.width,
        distortion_model: "plumb_bob".into(),
        d: vec![0.1, -0.2, 0.001, 0.0, 0.0],
        k: [c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0],
        ..ros::CameraInfo::default()
    })
}

fn entry(topic: &str, type_name: &'static str, time: f64, bytes: Vec<u8>) -> Entry {
    Entry {
        topic: topic.to_owned(),
        type_name,
        definition: || ros::definition::<ros::Image<'_>>(Version::Ros2),
        time: (time * 1e9).round() as u64,
        latched: false,
        bytes,
    }
}

/// Pairs and records the images of a walk; returns the resulting frames.
fn record(path: &Path) -> Vec<RgbdFrame> {
    let (recording, recorder) = Recording::begin(path).unwrap();
    let frames = record_into(&recorder);
    drop(recorder);
    recording.finish().unwrap();
    frames
}

fn record_into(recorder: &Recorder) -> Vec<RgbdFrame> {
    let simulator = Simulator::new(&SimulatorConfig {
        scene: "xyz".to_owned(),
        frames: Some(FRAMES),
        camera: Camera::pinhole(80, 60, [67.0, 67.0, 39.5, 29.5]),
        ..SimulatorConfig::default()
    })
    .unwrap();
    let info_bytes = info(simulator.camera());
    for topic in [COLOUR, DEPTH] {
        let topic = camera_info_topic(topic);
        let name = ros::CameraInfo::NAME;
        recorder.write(entry(&topic, name, 100.0, info_bytes.clone()));
    }
    let mut pairing = Pairing::new(0.02);
    let (mut incoming, mut frames) = (None, Vec::new());
    for i in 0..FRAMES {
        let at = 100.000_001_7 + i as f64 / 30.0;
        let (colour, depth) = messages(&simulator.frame(i), at);
        pairing.take(Stream::Colour, at, colour);
        if i != 3 {
            pairing.take(Stream::Depth, at + 0.0121, depth);
        }
        while let Some(pair) = pairing.next_pair() {
            let read = |bytes| ImageMessage::read(bytes, false).unwrap();
            let (colour, depth) = (read(&pair.colour.1), read(&pair.depth.1));
            let image = ros::Image::NAME;
            recorder.write(entry(COLOUR, image, pair.colour.0, pair.colour.1.clone()));
            recorder.write(entry(DEPTH, image, pair.colour.0, pair.depth.1.clone()));
            let made = incoming.get_or_insert_with(|| first(&colour, &depth, &info_bytes));
            let stamps =
                [&colour, &depth].map(|m| stillpoint::recordings::stamp_seconds(m.header().stamp));
            let id = FrameId(frames.len() as u32);
            let frame = made.frame(id, (stamps[0], stamps[1]), &colour, &depth, false);
            frames.push(frame.unwrap());
        }
    }
    frames
}

fn first(colour: &ImageMessage<'_>, depth: &ImageMessage<'_>, info: &[u8]) -> Incoming {
    let info: ros::CameraInfo<'_> = ros::from_bytes(info, Format::CdrLittleEndian).unwrap();
    let topic = |topic, message| IncomingTopic {
        topic,
        message,
        info: Some(&info),
    };
    Incoming::new(
        &topic(COLOUR, colour),
        &topic(DEPTH, depth),
        &Transforms::default(),
        &OpenOptions::default(),
    )
    .unwrap()
}

#[test]
fn replay_gives_the_tracked_frames() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("walk.mcap");
    let tracked = record(&path);
    // The last image waits for one that never comes, and the one without depth gives no frame.
    assert!(tracked.len() >= FRAMES - 2, "{}", tracked.len());
    let input = open(&path, &OpenOptions::default()).unwrap();
    let mut source = input.frames(&FrameOptions::default()).unwrap();
    for expected in &tracked {
        let found = source.next_frame().unwrap().unwrap();
        assert_eq!(
            (found.id, found.stamp, found.depth_stamp),
            (expected.id, expected.stamp, expected.depth_stamp)
        );
        assert_eq!(found.gray.data(), expected.gray.data());
        assert_eq!(found.depth.data(), expected.depth.data());
    }
    assert!(source.next_frame().is_none());
    let camera = input.camera().camera;
    assert_eq!((camera.fx, camera.distortion.k1), (67.0, 0.1));
}

#[test]
fn replay_gives_the_received_odometry() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("walk.mcap");
    let (recording, recorder) = Recording::begin(&path).unwrap();
    record_into(&recorder);
    let mut mount = ros::TransformStamped::default();
    mount.header.frame_id = "base_link".into();
    mount.child_frame_id = "eye".into();
    mount.transform.translation.x = 0.1;
    mount.transform.rotation.w = 1.0;
    let message = ros::TfMessage {
        transforms: vec![mount],
    };
    let mut transforms = Transforms::default();
    transforms.add(&message.transforms[0]);
    let latched = Entry {
        latched: true,
        ..entry("/tf_static", ros::TfMessage::NAME, 100.0, cdr(&message))
    };
    recorder.write(latched);
    let (mut told, mut frames) = (Vec::new(), None);
    for k in 0..12 {
        let at = 99.950_000_3 + 0.02 * f64::from(k);
        let mut m = ros::Odometry {
            header: header(at),
            child_frame_id: "/base_link".into(),
            ..ros::Odometry::default()
        };
        m.header.frame_id = "odom".into();
        m.pose.pose.position.x = 0.1 * f64::from(k);
        m.pose.pose.orientation.w = 1.0;
        m.pose.covariance.0[0] = 0.001 * f64::from(k);
        let bytes = cdr(&m);
        let rolled = Rolled::read(&bytes).unwrap();
        let name = ros::Odometry::NAME;
        recorder.write(entry("/odom", name, at, bytes));
        told.push(rolled.sample);
        frames = Some(rolled.frames);
    }
    drop(recorder);
    recording.finish().unwrap();
    let options = OpenOptions {
        odometry_topic: Some("/odom".into()),
        ..OpenOptions::default()
    };
    let input = open(&path, &options).unwrap();
    let model = mounted(&transforms, "eye", &frames.unwrap());
    assert!(model.is_some() && input.odometry() == model);
    let mut source = input.frames(&FrameOptions::default()).unwrap();
    let mut found = Vec::new();
    while source.next_frame().is_some() {
        found.extend(source.take_odometry());
    }
    assert!(found.len() > 6);
    assert_eq!(found, told[..found.len()]);
}

#[test]
fn recording_does_not_overwrite_files() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("walk.mcap");
    std::fs::write(&path, "something").unwrap();
    let told = Recording::begin(&path).err().unwrap();
    assert!(told.contains("exists"), "{told}");
}
