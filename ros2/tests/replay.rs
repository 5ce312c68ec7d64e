//! What a node records is what it tracked: frames of a recording are those that were made of the messages as they came, in number, stamps and pixels.

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
use stillpoint_ros2::pairing::{Pairing, Stream};
use stillpoint_ros2::record::{Entry, Recording};

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

/// Messages of a frame as a driver sends them: colour, depth in millimetres.
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

/// Pairs and records the images of a walk as they come; gives the frames that were made of them.
fn record(path: &Path) -> Vec<RgbdFrame> {
    let simulator = Simulator::new(&SimulatorConfig {
        scene: "xyz".to_owned(),
        frames: Some(FRAMES),
        camera: Camera::pinhole(80, 60, [67.0, 67.0, 39.5, 29.5]),
        ..SimulatorConfig::default()
    })
    .unwrap();
    let info_bytes = info(simulator.camera());
    let (recording, recorder) = Recording::begin(path).unwrap();
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
        // One depth image is lost on its way.
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
    drop(recorder);
    recording.finish().unwrap();
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
fn a_recording_gives_the_frames_that_were_tracked() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("walk.mcap");
    let tracked = record(&path);
    // The last image waits for what does not come, and the one without depth is no frame.
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
    // The camera is the one of the messages.
    let camera = input.camera().camera;
    assert_eq!((camera.fx, camera.distortion.k1), (67.0, 0.1));
}

#[test]
fn a_recording_takes_the_place_of_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("walk.mcap");
    std::fs::write(&path, "something").unwrap();
    let told = Recording::begin(&path).err().unwrap();
    assert!(told.contains("exists"), "{told}");
}
