//! The inertial sensor of a recording.

use crate::files::{frames, put, variants, with_each_frame};
use crate::writers::*;
use std::f64::consts::FRAC_PI_2;
use stillpoint_datasets::CameraChoice;
use stillpoint_geometry::{ImuModel, Se3, Vec3, so3};
use stillpoint_imaging::ImuSample;
use stillpoint_recordings::{Input, McapRecorder, OpenOptions, open};
use stillpoint_ros_messages::*;

const FRAMES: usize = 4;
const START: u64 = 5_000_000_000;

fn header(time: u64, frame: &str) -> Header<'static> {
    Header {
        seq: 0,
        stamp: Time {
            sec: (time / 1_000_000_000) as i64,
            nanosec: (time % 1_000_000_000) as u32,
        },
        frame_id: frame.to_owned().into(),
    }
}

/// Samples at a rate (Hz) from the time of the first frame on: angular rates grow by 1 per second, forces by 100.
fn samples(topic: &str, hz: u64, frame: &str) -> Vec<Sent> {
    let one = |k: u64| {
        let after = k * 1_000_000_000 / hz;
        let seconds = after as f64 * 1e-9;
        let mut m = Imu {
            header: header(START + after, frame),
            ..Imu::default()
        };
        m.angular_velocity.x = seconds;
        m.linear_acceleration.z = 100.0 * seconds;
        sent(topic, START + after + 1_000_000, &m)
    };
    (0..hz / 4).map(one).collect()
}

/// The sensor's x axis is the camera's y axis.
fn mount(parent: &str, child: &str) -> Sent {
    let mut t = TransformStamped::default();
    t.header.frame_id = parent.to_owned().into();
    t.child_frame_id = child.to_owned().into();
    t.transform.translation.x = 0.01;
    t.transform.rotation.z = 0.5_f64.sqrt();
    t.transform.rotation.w = 0.5_f64.sqrt();
    let transforms = vec![t];
    sent("/tf_static", 1, &TfMessage { transforms })
}

fn taken(input: &Input, start: usize) -> Vec<Vec<ImuSample>> {
    with_each_frame(input, start, |source| source.take_inertial())
}

#[test]
fn inertial_samples_come_with_the_following_frame() {
    let dir = tempfile::tempdir().unwrap();
    let mut all = camera("/camera", FRAMES);
    all.extend(samples("/camera/imu", 200, "camera_imu"));
    all.push(mount("camera_optical", "camera_imu"));
    for (name, bytes) in variants(&all) {
        let input = open(&put(dir.path(), name, &bytes), &OpenOptions::default()).unwrap();
        assert!(input.warnings().is_empty(), "{:?}", input.warnings());
        let model = input.imu().unwrap();
        let seen = model.camera_from_imu.transform(&Vec3::x());
        assert!((seen - Vec3::new(0.01, 1.0, 0.0)).norm() < 1e-9, "{name}");
        let said = input.guesses().join("\n");
        assert!(
            said.contains("inertial sensor: /camera/imu, 50 samples"),
            "{said}"
        );
        let taken = taken(&input, 0);
        // Frames are 33.3 ms apart and samples 5 ms: each frame has those up to it and one after it.
        let counts: Vec<usize> = taken.iter().map(Vec::len).collect();
        assert_eq!(counts, [1, 7, 7, 6], "{name}");
        for (k, sample) in taken.iter().flatten().enumerate() {
            let after = 0.005 * k as f64;
            assert!((sample.stamp - 5.0 - after).abs() < 1e-6, "{name}");
            assert!((sample.angular_rate[0] - after).abs() < 1e-9);
            assert!((sample.specific_force[2] - 100.0 * after).abs() < 1e-6);
        }
        // With a later start, samples begin shortly before it.
        let late = self::taken(&input, 3);
        let first = late[0][0].stamp;
        assert!(
            first >= 5.0 && late.len() == 1 && late[0].len() > 15,
            "{first}"
        );
    }
}

#[test]
fn separate_accelerometer_topic_is_interpolated() {
    let dir = tempfile::tempdir().unwrap();
    let mut all = camera("/camera", FRAMES);
    all.extend(samples("/camera/gyro/sample", 200, "imu"));
    all.extend(samples("/camera/accel/sample", 60, "imu"));
    all.push(mount("camera_optical", "imu"));
    let input = open(
        &put(dir.path(), "two.mcap", &mcap(&all, Some((7, true)))),
        &OpenOptions::default(),
    )
    .unwrap();
    let said = input.guesses().join("\n");
    assert!(
        said.contains("/camera/gyro/sample with /camera/accel/sample"),
        "{said}"
    );
    let taken = taken(&input, 0);
    let all: Vec<&ImuSample> = taken.iter().flatten().collect();
    assert!(all.len() > 20);
    for sample in all {
        let after = sample.stamp - 5.0;
        assert!((sample.angular_rate[0] - after).abs() < 1e-6);
        // Interpolated, except at the start of the forces.
        assert!(
            (sample.specific_force[2] - 100.0 * after).abs() < 1e-4,
            "{sample:?}"
        );
    }
}

#[test]
fn realsense_recording_contains_the_inertial_mount() {
    let dir = tempfile::tempdir().unwrap();
    let device = "/device_0/sensor_1/Color_0";
    let mut all = camera("/camera", FRAMES);
    for m in &mut all {
        m.topic = match m.topic.as_str() {
            "/camera/color/image_raw" => format!("{device}/image/data"),
            "/camera/color/camera_info" => format!("{device}/info/camera_info"),
            _ => "/device_0/sensor_0/Depth_0/image/data".to_owned(),
        };
    }
    let pose = |x: f64| {
        let mut t = Transform::default();
        t.translation.x = x;
        t.rotation.w = 1.0;
        t
    };
    all.extend(samples("/device_0/sensor_2/Gyro_0/imu/data", 200, "0"));
    all.extend(samples("/device_0/sensor_2/Accel_0/imu/data", 100, "0"));
    all.push(sent("/device_0/sensor_2/Gyro_0/tf/0", 1, &pose(0.005)));
    all.push(sent(&format!("{device}/tf/0"), 1, &pose(0.015)));
    all.push(sent("/device_0/sensor_0/Depth_0/tf/0", 1, &pose(0.0)));
    let mut info = CameraInfo {
        height: HEIGHT,
        width: WIDTH,
        distortion_model: "plumb_bob".into(),
        d: vec![0.0; 5],
        ..CameraInfo::default()
    };
    info.k = [30.0, 0.0, 15.5, 0.0, 30.0, 11.5, 0.0, 0.0, 1.0];
    all.push(sent(
        "/device_0/sensor_0/Depth_0/info/camera_info",
        1,
        &info,
    ));
    let input = open(
        &put(dir.path(), "d435i.bag", &bag(&all, "lz4")),
        &OpenOptions::default(),
    )
    .unwrap();
    let x = input.imu().unwrap().camera_from_imu.translation.x;
    // The device's transforms are from its depth camera to each stream.
    assert!((x - 0.01).abs() < 1e-9, "{x}");
    assert!(taken(&input, 0).concat().len() > 20);
}

#[test]
fn unmounted_inertial_sensor_is_reported_and_ignored() {
    let dir = tempfile::tempdir().unwrap();
    let mut all = camera("/camera", FRAMES);
    all.extend(samples("/robot/imu", 100, "base_imu"));
    let path = put(dir.path(), "unmounted.mcap", &mcap(&all, None));
    let input = open(&path, &OpenOptions::default()).unwrap();
    let said = input.warnings().join("\n");
    assert!(
        said.contains("/robot/imu") && said.contains("/tf_static"),
        "{said}"
    );
    assert!(input.imu().is_none() && taken(&input, 0).concat().is_empty());
    assert_eq!(frames(&input).len(), FRAMES);

    // The mounting from a camera file.
    let file = put(
        dir.path(),
        "camera.toml",
        b"width = 32\nheight = 24\nfx = 30.0\nfy = 30.0\ncx = 15.5\ncy = 11.5\ndepth_scale = 1000.0\n[imu]\nrotation = [0.0, 0.0, 0.0, 1.0]\ngyro_noise = 0.001\n",
    );
    let with = OpenOptions {
        camera: Some(CameraChoice::from_argument(file.to_str().unwrap())),
        ..OpenOptions::default()
    };
    let input = open(&path, &with).unwrap();
    assert_eq!(input.imu().unwrap().gyro_noise, 0.001);
    assert!(!taken(&input, 0).concat().is_empty());
    let off = OpenOptions {
        no_imu: true,
        ..with
    };
    let input = open(&path, &off).unwrap();
    assert!(input.imu().is_none() && taken(&input, 0).concat().is_empty());
}

#[test]
fn cameras_own_inertial_sensor_is_preferred() {
    let dir = tempfile::tempdir().unwrap();
    let mut all = camera("/camera", FRAMES);
    all.extend(samples("/robot/imu", 100, "camera_imu"));
    all.extend(samples("/camera/imu", 100, "camera_imu"));
    all.push(mount("camera_optical", "camera_imu"));
    let path = put(dir.path(), "several.mcap", &mcap(&all, None));
    let said = |options: &OpenOptions| {
        let input = open(&path, options).unwrap();
        (input.guesses().join("\n"), input.warnings().join("\n"))
    };
    assert!(
        said(&OpenOptions::default())
            .0
            .contains("inertial sensor: /camera/imu")
    );
    let named = |topic: &str| OpenOptions {
        imu_topic: Some(topic.into()),
        ..OpenOptions::default()
    };
    assert!(
        said(&named("/robot/imu"))
            .0
            .contains("inertial sensor: /robot/imu")
    );
    let refused = open(&path, &named("/imu")).unwrap_err().to_string();
    assert!(
        refused.contains("--imu-topic") && refused.contains("/camera/imu"),
        "{refused}"
    );

    // Of two equal candidates none is used, and both are named.
    all.retain(|m| m.topic != "/camera/imu");
    all.extend(samples("/base/imu", 100, "camera_imu"));
    let path = put(dir.path(), "rivals.mcap", &mcap(&all, None));
    let input = open(&path, &OpenOptions::default()).unwrap();
    let said = input.warnings().join("\n");
    assert!(
        said.contains("/robot/imu, /base/imu") && input.imu().is_none(),
        "{said}"
    );
}

#[test]
fn recorded_inertial_samples_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let path = put(
        dir.path(),
        "source.mcap",
        &mcap(&camera("/camera", FRAMES), None),
    );
    let input = open(&path, &OpenOptions::default()).unwrap();
    let copy = dir.path().join("copy.mcap");
    let pose = Se3::new(
        so3::exp(&Vec3::new(0.0, FRAC_PI_2, 0.0)),
        Vec3::new(0.0, 0.02, 0.0),
    );
    let model = ImuModel {
        time_offset: 0.25,
        ..ImuModel::bmi055().mounted(pose)
    };
    let mut recorder = McapRecorder::create(&copy, &input.camera().camera).unwrap();
    recorder.add_imu(&model, 5.0).unwrap();
    let given: Vec<ImuSample> = (0..20)
        .map(|k| ImuSample {
            stamp: 4.75 + 0.005 * f64::from(k),
            angular_rate: [0.1 * f64::from(k), -0.2, 0.3],
            specific_force: [0.0, -9.8, f64::from(k)],
        })
        .collect();
    recorder.add_inertial(&given).unwrap();
    for frame in frames(&input) {
        recorder.add(&frame).unwrap();
    }
    recorder.finish().unwrap();
    let back = open(&copy, &OpenOptions::default()).unwrap();
    assert!(back.warnings().is_empty(), "{:?}", back.warnings());
    let read = back.imu().unwrap();
    assert_eq!(read.time_offset, 0.0, "stamps are on the camera's clock");
    let turn = read.camera_from_imu.rotation.angle_to(&pose.rotation);
    assert!(turn < 1e-9 && (read.camera_from_imu.translation - pose.translation).norm() < 1e-12);
    let taken = taken(&back, 0).concat();
    assert_eq!(taken.len(), given.len());
    for (a, b) in taken.iter().zip(&given) {
        assert!((a.stamp - b.stamp - 0.25).abs() < 1e-6);
        assert_eq!(
            (a.angular_rate, a.specific_force),
            (b.angular_rate, b.specific_force)
        );
    }
}
