//! Registration of depth to the colour camera, and the camera to use.

use crate::files::*;
use crate::writers::*;
use stillpoint_datasets::CameraChoice;
use stillpoint_geometry::{Se3, Vec3};
use stillpoint_imaging::FrameId;
use stillpoint_recordings::{OpenOptions, Pair, RawFrames, open};
use stillpoint_ros_messages as ros;

/// Raw images of a driver: depth of a camera 50 mm beside, in millimetres.
#[test]
fn raw_images_are_registered_to_the_colour_camera() {
    let info = |width: u32, f: f64| ros::CameraInfo {
        width,
        height: 48,
        distortion_model: "Brown Conrady".into(),
        d: vec![0.0; 5],
        k: [f, 0.0, 31.5, 0.0, f, 23.5, 0.0, 0.0, 1.0],
        ..ros::CameraInfo::default()
    };
    let mut pair = Pair {
        name: "two".to_owned(),
        colour: info(64, 60.0),
        depth: info(64, 60.0),
        colour_from_depth: Some(Se3::new(Default::default(), Vec3::new(0.05, 0.0, 0.0))),
        depth_scale: None,
    };
    let raw = RawFrames::new(&pair).unwrap();
    assert_eq!(
        (raw.camera().camera.fx, raw.camera().depth_scale),
        (60.0, 1000.0)
    );
    let image = |encoding: &'static str, bytes: u32, data: Vec<u8>| ros::Image {
        width: 64,
        height: 48,
        encoding: encoding.into(),
        step: 64 * bytes,
        data: data.into(),
        ..ros::Image::default()
    };
    let colour = image("rgb8", 3, vec![100; 64 * 48 * 3]);
    // A wall at one metre; column 20 of the depth camera is three columns to the right in the colour camera.
    let mut wall = vec![1000_u16; 64 * 48];
    (0..48).for_each(|y| wall[y * 64 + 20] = 500);
    let wall: Vec<u8> = wall.iter().flat_map(|z| z.to_le_bytes()).collect();
    let depth = image("16UC1", 2, wall);
    let frame = raw
        .frame(FrameId(7), (1.0, 1.01), &colour, &depth, false)
        .unwrap();
    assert_eq!(
        (frame.id, frame.stamp, frame.depth_stamp),
        (FrameId(7), 1.0, 1.01)
    );
    assert_eq!(frame.depth.at(40, 10), 1.0);
    assert_eq!(frame.depth.at(26, 10), 0.5);
    assert!(frame.colour.is_none() && frame.gray.data().iter().all(|g| *g == 100));
    let small = ros::Image {
        width: 32,
        step: 64,
        ..depth.clone()
    };
    let refused = raw
        .frame(FrameId(8), (1.1, 1.1), &colour, &small, true)
        .unwrap_err();
    assert!(
        refused.contains("depth image: expected 64 x 48 px"),
        "{refused}"
    );
    pair.colour.k[0] = 0.0;
    let refused = RawFrames::new(&pair).unwrap_err();
    assert!(
        refused.contains("colour: expected a calibrated camera"),
        "{refused}"
    );
}

/// A nominal preset is worse than the recording's calibration; a measured one is the user's decision.
#[test]
fn own_calibration_overrides_a_nominal_preset() {
    let dir = tempfile::tempdir().unwrap();
    let path = put(dir.path(), "own.bag", &bag(&camera("/camera", 5), "none"));
    let of = |preset: &str| {
        let options = OpenOptions {
            camera: Some(CameraChoice::from_argument(preset)),
            ..OpenOptions::default()
        };
        open(&path, &options)
    };
    let own = open(&path, &OpenOptions::default()).unwrap();
    let nominal = of("realsense_d435").unwrap();
    assert_eq!(nominal.camera().camera, own.camera().camera);
    assert!(
        nominal
            .guesses()
            .iter()
            .any(|g| g.contains("realsense_d435")),
        "{:?}",
        nominal.guesses()
    );
    // The preset is used, since its other image size is reported.
    assert!(of("tum_fr1").unwrap_err().to_string().contains("tum_fr1"));
}
