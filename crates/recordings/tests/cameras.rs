//! Unusual camera descriptions: used if complete, else refused with a message.

use crate::edited::*;
use crate::writers::*;
use stillpoint_recordings::{Input, OpenOptions};
use stillpoint_ros_messages::*;

fn k(input: &Input) -> [f64; 4] {
    let c = input.camera().camera;
    [c.fx, c.fy, c.cx, c.cy]
}

const K: [f64; 4] = [30.0, 30.0, 15.5, 11.5];

#[test]
fn first_camera_info_with_a_calibration_is_used() {
    let late = Recorded::new().infos(|i, info| {
        if i < 3 {
            info.k = [0.0; 9];
        }
    });
    let input = late.open();
    assert_eq!(k(&input), K);
    assert!(
        said(&input).contains("first 3 camera infos"),
        "{}",
        said(&input)
    );
    // Values are set one after the other.
    let partly = Recorded::new().infos(|i, info| match i {
        0 => info.k = [0.0; 9],
        1 => info.k[4] = 0.0,
        2 => info.k[2] = 0.0,
        _ => {}
    });
    let input = partly.open();
    assert_eq!(k(&input), K);
    assert!(said(&input).contains("first 3 camera infos"));
    Recorded::new()
        .infos(|_, info| info.k = [0.0; 9])
        .refused(&["a calibrated camera", "fx = 0.0", "--camera"]);
    let projected = Recorded::new().infos(|_, info| {
        info.k = [0.0; 9];
        (info.p[0], info.p[5], info.p[2], info.p[6]) = (31.0, 31.5, 15.0, 11.0);
    });
    let input = projected.open();
    assert_eq!(k(&input), [31.0, 31.5, 15.0, 11.0]);
    assert!(said(&input).contains("projection matrix P"));
}

#[test]
fn implausible_calibrations_are_refused_before_the_run() {
    for (figures, parts) in [
        ([30.0, 30.0, 0.0, 0.0], ["cx = 0.0", "3 to 28 px"]),
        ([30.0, 30.0, 15.5, 23.0], ["cy = 23.0", "principal point"]),
        ([30.0, 1.0, 15.5, 11.5], ["fy = 1.0", "factor of 2"]),
        ([1e-300, 1e-300, 15.5, 11.5], ["fx = 1e-300", "focal"]),
        (
            [30.0, 30.0, -1e6, 11.5],
            ["cx = -1000000.0", "principal point"],
        ),
        ([30.0, 0.0, 0.0, 0.0], ["fy = 0.0", "calibrated"]),
    ] {
        let bad = Recorded::new().infos(|_, info| {
            let [fx, fy, cx, cy] = figures;
            info.k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
        });
        bad.refused(&parts);
        bad.refused(&["camera info of /camera/color/image_raw", "--camera"]);
    }
    Recorded::new()
        .infos(|_, info| {
            info.distortion_model = "equidistant".into();
            info.d = vec![10.0, -20.0, 30.0, -40.0];
        })
        .refused(&["lens model that can be inverted", "10.0, -20.0"]);
}

#[test]
fn binning_is_applied_and_invalid_regions_are_reported() {
    let binned = Recorded::new().infos(|_, info| {
        (info.width, info.height) = (64, 48);
        info.k = [60.0, 0.0, 31.0, 0.0, 60.0, 23.0, 0.0, 0.0, 1.0];
        (info.binning_x, info.binning_y) = (2, 2);
    });
    assert_eq!(k(&binned.open()), K);
    let beyond = Recorded::new().infos(|_, info| {
        info.k[2] = 23.5;
        info.k[5] = 15.5;
        info.roi = RegionOfInterest {
            x_offset: 8,
            y_offset: 4,
            width: 32,
            height: 24,
            ..RegionOfInterest::default()
        };
    });
    let input = beyond.open();
    assert_eq!(k(&input), K);
    let said = input.warnings().join("\n");
    assert!(
        said.contains("region of interest") && said.contains("does not fit"),
        "{said}"
    );
}

#[test]
fn camera_info_is_found_by_frame_and_size() {
    let throttled = || {
        Recorded::new()
            .rename(COLOUR, "/throttled_image")
            .rename(INFO, "/throttled_camera_info")
            .rename(DEPTH, "/throttled_image_depth")
    };
    let input = throttled().open();
    assert_eq!(k(&input), K);
    assert!(
        said(&input).contains("/throttled_camera_info"),
        "{}",
        said(&input)
    );
    // One with another frame is ignored.
    let mut other = throttled();
    let of = |frame: &'static str, fx: f64| {
        let mut info = CameraInfo {
            width: WIDTH,
            height: HEIGHT,
            k: [fx, 0.0, 15.5, 0.0, fx, 11.5, 0.0, 0.0, 1.0],
            ..CameraInfo::default()
        };
        info.header.frame_id = frame.into();
        info
    };
    other
        .messages
        .push(sent("/other_info", 1, &of("rear", 25.0)));
    assert_eq!(k(&other.open()), K);
    // With two equal candidates the user must decide.
    other
        .messages
        .push(sent("/second_info", 1, &of("camera_optical", 40.0)));
    other.refused(&[
        "several",
        "/throttled_camera_info",
        "/second_info",
        "--info-topic",
    ]);
    let named = |topic: &str| OpenOptions {
        info_topic: Some(topic.into()),
        ..OpenOptions::default()
    };
    assert_eq!(k(&other.open_with(named("/second_info")).unwrap())[0], 40.0);
    let refused = other.open_with(named("/none")).unwrap_err();
    assert!(
        refused.contains("--info-topic") && refused.contains("/other_info"),
        "{refused}"
    );
    let mut without = throttled();
    without
        .messages
        .retain(|m| m.topic != "/throttled_camera_info");
    without.refused(&["a camera info beside /throttled_image", "--info-topic"]);
}
