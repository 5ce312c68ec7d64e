//! Bags of Orbbec's SDK, written as by its `RosbagWriter`: numbered topics, images with fields after their data, cameras at the end.

use crate::files::put;
use crate::writers::*;
use stillpoint_imaging::FrameSource;
use stillpoint_recordings::{FrameOptions, OpenOptions, open};
use stillpoint_ros_messages::*;

const SIZE: (u32, u32) = (64, 48);

/// An image with the SDK's additional fields: number, three times, metadata.
fn image(sensor: u32, time: u64, encoding: &'static str, step: u32, data: Vec<u8>) -> Sent {
    let mut header = Header::default();
    header.stamp.sec = (time / 1_000_000_000) as i64;
    header.stamp.nanosec = (time % 1_000_000_000) as u32;
    let image = Image {
        header,
        height: SIZE.1,
        width: SIZE.0,
        encoding: encoding.into(),
        is_bigendian: 0,
        step,
        data: data.into(),
    };
    let mut message = sent(
        &format!("/cam/sensor_{sensor}/frameType_{sensor}"),
        time,
        &image,
    );
    message.ros1.extend([7; 8 + 3 * 8 + 4 + 1]);
    message
}

fn profile(stream: u8, f: f32, apart: f32) -> Sent {
    let mut rotation_matrix = [0.0; 9];
    if stream == 3 {
        for i in [0, 4, 8] {
            rotation_matrix[i] = 1.0;
        }
    }
    let profile = ObStreamProfileInfo {
        stream_type: stream,
        rotation_matrix,
        translation_matrix: [apart, 0.0, 0.0],
        width: SIZE.0 as u16,
        height: SIZE.1 as u16,
        fps: 30,
        camera_intrinsic: [f, f, 31.5, 23.5],
        distortion_model: 4,
        ..ObStreamProfileInfo::default()
    };
    sent(
        &format!("/cam/streamProfileType_{stream}"),
        5_000_000_000,
        &profile,
    )
}

/// `frames` frames of a wall at one metre with a column at half a metre, seen by a depth camera 50 mm beside the colour camera, and by its
/// infrared camera.
pub(crate) fn messages(frames: u64) -> Vec<Sent> {
    let pixels = (SIZE.0 * SIZE.1) as usize;
    let mut wall = vec![1000_u16; pixels];
    (0..SIZE.1).for_each(|y| wall[(y * SIZE.0 + 20) as usize] = 500);
    let wall: Vec<u8> = wall.iter().flat_map(|z| z.to_le_bytes()).collect();
    let grey = image::GrayImage::from_pixel(SIZE.0, SIZE.1, image::Luma([90]));
    let mut jpeg = std::io::Cursor::new(Vec::new());
    grey.write_to(&mut jpeg, image::ImageFormat::Jpeg).unwrap();
    let mut all = Vec::new();
    for k in 0..frames {
        let time = 5_000_000_000 + k * 33_333_000;
        all.push(image(2, time, "mjpg", 0, jpeg.get_ref().clone()));
        all.push(image(3, time, "mono16", 2 * SIZE.0, wall.clone()));
        all.push(image(1, time, "mono8", SIZE.0, vec![50; pixels]));
    }
    all.push(profile(2, 60.0, 0.0));
    all.push(profile(3, 60.0, 50.0));
    let device = ObDeviceInfo {
        name: "Orbbec Femto Bolt".into(),
        ..ObDeviceInfo::default()
    };
    all.push(sent("/cam/deviceInfo", 5_000_000_000, &device));
    all
}

#[test]
fn orbbec_bags_are_read() {
    let dir = tempfile::tempdir().unwrap();
    for how in ["none", "lz4"] {
        let path = put(dir.path(), "orbbec.bag", &bag(&messages(4), how));
        let input = open(&path, &OpenOptions::default()).unwrap();
        assert!(input.warnings().is_empty(), "{:?}", input.warnings());
        let said = input.guesses().join("\n");
        for part in [
            "colour /cam/sensor_2/frameType_2 and depth /cam/sensor_3/frameType_3",
            "Orbbec Femto Bolt",
            "50.0 mm beside",
        ] {
            assert!(said.contains(part), "{said}");
        }
        assert_eq!(
            (input.camera().camera.fx, input.camera().depth_scale),
            (60.0, 1000.0)
        );
        let mut source = input.frames(&FrameOptions::default()).unwrap();
        let found: Vec<_> = std::iter::from_fn(|| source.next_frame())
            .map(Result::unwrap)
            .collect();
        assert_eq!(found.len(), 4);
        assert!(found[0].gray.at(10, 10).abs_diff(90) < 3);
        // Three columns to the right for the wall, six at half the distance.
        assert_eq!(found[0].depth.at(40, 10), 1.0);
        assert_eq!(found[0].depth.at(26, 10), 0.5);
        assert!((found[1].stamp - 5.033_333).abs() < 1e-9);
    }
}

/// A recording that was truncated before the description of its cameras.
#[test]
fn truncated_orbbec_bag_needs_a_camera() {
    let dir = tempfile::tempdir().unwrap();
    let path = put(dir.path(), "cut.bag", &bag(&messages(4)[..12], "none"));
    let refused = open(&path, &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("--camera") && refused.contains("/cam/sensor_2"),
        "{refused}"
    );
}
