//! Wheel odometry of a recording.

use crate::files::{frames, put, variants, with_each_frame};
use crate::writers::*;
use std::path::{Path, PathBuf};
use stillpoint_datasets::CameraChoice;
use stillpoint_geometry::{OdometryModel, Se3, Vec3, so3};
use stillpoint_imaging::OdometrySample;
use stillpoint_recordings::{Input, McapRecorder, OpenOptions, open};
use stillpoint_ros_messages::*;

const FRAMES: usize = 4;
const START: u64 = 5_000_000_000;
const CAMERA: &str =
    "width = 32\nheight = 24\nfx = 30.0\nfy = 30.0\ncx = 15.5\ncy = 11.5\ndepth_scale = 1000.0\n";

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

/// A base that moves at 1 m/s and turns at 0.5 rad/s, at 50 Hz from 0.1 s before the first frame on; its variances grow by 0.01 and 0.04
/// per second.
fn wheels(topic: &str, base: &str) -> Vec<Sent> {
    let one = |k: u64| {
        let after = 0.02 * k as f64;
        let time = START - 100_000_000 + 20_000_000 * k;
        let mut m = Odometry {
            header: header(time, "odom"),
            child_frame_id: base.to_owned().into(),
            ..Odometry::default()
        };
        m.pose.pose.position.x = after;
        m.pose.pose.orientation.z = (0.25 * after).sin();
        m.pose.pose.orientation.w = (0.25 * after).cos();
        for (axis, growth) in [(0, 0.005), (7, 0.01), (35, 0.04)] {
            m.pose.covariance.0[axis] = growth * after;
        }
        sent(topic, time + 1_000_000, &m)
    };
    (0..12).map(one).collect()
}

fn tf(topic: &str, time: u64, [parent, child]: [&str; 2], x: f64) -> Sent {
    let mut t = TransformStamped::default();
    t.header.frame_id = parent.to_owned().into();
    t.child_frame_id = child.to_owned().into();
    t.transform.translation.x = x;
    t.transform.rotation.w = 1.0;
    let transforms = vec![t];
    sent(topic, time, &TfMessage { transforms })
}

/// A camera on a robot: `base_link -> camera_link -> camera_optical`.
fn robot() -> Vec<Sent> {
    let mut all = camera("/camera", FRAMES);
    all.push(tf("/tf_static", 1, ["base_link", "camera_link"], 0.25));
    all.push(tf("/tf_static", 2, ["camera_link", "camera_optical"], 0.5));
    all
}

fn file(dir: &Path, name: &str, all: &[Sent]) -> PathBuf {
    put(dir, name, &mcap(all, None))
}

fn named(topic: &str) -> OpenOptions {
    OpenOptions {
        odometry_topic: Some(topic.into()),
        ..OpenOptions::default()
    }
}

fn opened(path: &Path, options: &OpenOptions) -> (Option<OdometryModel>, String, String) {
    let input = open(path, options).unwrap();
    let said = (input.guesses().join("\n"), input.warnings().join("\n"));
    if input.odometry().is_none() {
        assert!(taken(&input, 0).concat().is_empty() && !said.0.contains("odometry"));
    }
    (input.odometry(), said.0, said.1)
}

fn taken(input: &Input, start: usize) -> Vec<Vec<OdometrySample>> {
    with_each_frame(input, start, |source| source.take_odometry())
}

#[test]
fn odometry_samples_come_with_the_following_frame() {
    let dir = tempfile::tempdir().unwrap();
    let mut all = robot();
    all.extend(wheels("/odom", "base_link"));
    for (name, bytes) in variants(&all) {
        let input = open(&put(dir.path(), name, &bytes), &OpenOptions::default()).unwrap();
        assert!(input.warnings().is_empty(), "{:?}", input.warnings());
        let mount = Se3::new(so3::exp(&Vec3::zeros()), Vec3::new(0.75, 0.0, 0.0));
        assert_eq!(input.odometry(), Some(OdometryModel::mounted(mount)));
        let said = input.guesses().join("\n");
        let expected = "odometry: /odom of base_link, 12 samples, mounted as the transforms say; taken to be of wheels";
        assert!(said.contains(expected), "{said}");
        // Frames are 33.3 ms apart and samples 20 ms: each frame has those up to it and one after it.
        let counts: Vec<usize> = taken(&input, 0).iter().map(Vec::len).collect();
        assert_eq!(counts, [6, 2, 2, 1], "{name}");
        for (k, sample) in taken(&input, 0).iter().flatten().enumerate() {
            let after = 0.02 * k as f64;
            assert!((sample.stamp - 4.9 - after).abs() < 1e-6, "{name}");
            let turned = (0.25 * after).sin();
            assert_eq!(sample.position, [after, 0.0, 0.0]);
            assert_eq!(sample.orientation[..3], [0.0, 0.0, turned]);
            let sigmas = [(0.01 * after).sqrt(), (0.04 * after).sqrt()];
            assert_eq!(sample.sigmas, (k > 0).then_some(sigmas));
        }
        let late = taken(&input, 3);
        assert!(late.len() == 1 && late[0].len() == 11, "{late:?}");
    }
}

#[test]
fn odometry_needs_a_static_camera_mount() {
    let dir = tempfile::tempdir().unwrap();
    let mut all = camera("/camera", FRAMES);
    all.extend(wheels("/odom", "base_link"));
    // Neither a path through the measured motion nor one through a rotating mast is static.
    all.push(tf("/tf", 1, ["odom", "base_link"], 0.0));
    all.push(tf("/tf", 2, ["odom", "camera_optical"], 0.5));
    all.push(tf("/tf", 3, ["base_link", "mast"], 0.5));
    all.push(tf("/tf", 4, ["base_link", "mast"], 0.6));
    all.push(tf("/tf", 5, ["mast", "camera_optical"], 0.6));
    let path = file(dir.path(), "moving.mcap", &all);
    for options in [OpenOptions::default(), named("/odom")] {
        let (model, _, warned) = opened(&path, &options);
        assert!(model.is_none());
        for part in ["/odom", "base_link", "/tf_static", "[odometry]"] {
            assert!(warned.contains(part), "{warned}");
        }
    }
    let text = format!(
        "{CAMERA}[odometry]\nrotation = [0.0, 0.0, 0.0, 1.0]\ntranslation = [0.1, 0.0, 0.5]\nslip_per_metre = 0.1\n"
    );
    let camera = put(dir.path(), "camera.toml", text.as_bytes());
    let with = OpenOptions {
        camera: Some(CameraChoice::from_argument(camera.to_str().unwrap())),
        ..OpenOptions::default()
    };
    let (model, said, _) = opened(&path, &with);
    assert_eq!(model.unwrap().slip_per_metre, 0.1);
    assert!(said.contains("as the camera file says"), "{said}");
    let off = OpenOptions {
        no_odometry: true,
        ..with
    };
    let (model, _, warned) = opened(&path, &off);
    assert!(model.is_none() && !warned.contains("/odom"));
}

#[test]
fn doubtful_odometry_is_used_only_if_named() {
    let dir = tempfile::tempdir().unwrap();
    for (name, base) in [("/rgbd/visual_odom", "base_link"), ("/pose", "camera_link")] {
        let mut all = robot();
        all.extend(wheels(name, base));
        let path = file(dir.path(), &format!("{base}.mcap"), &all);
        let (model, _, warned) = opened(&path, &OpenOptions::default());
        assert!(model.is_none() && warned.contains(name), "{warned}");
        let (model, said, warned) = opened(&path, &named(name));
        assert!(model.is_some() && warned.is_empty(), "{warned}");
        assert!(!said.contains("taken to be of wheels"), "{said}");
        // Beside wheel odometry it is ignored.
        all.extend(wheels("/odom", "base_link"));
        let path = file(dir.path(), &format!("two_{base}.mcap"), &all);
        let (_, said, warned) = opened(&path, &OpenOptions::default());
        assert!(said.contains("odometry: /odom") && warned.is_empty());
    }
    // Of two candidates none is used, and both are named.
    let mut all = robot();
    all.extend(wheels("/odom", "base_link"));
    all.extend(wheels("/odometry/filtered", "base_link"));
    let path = file(dir.path(), "rivals.mcap", &all);
    let (model, _, warned) = opened(&path, &OpenOptions::default());
    assert!(model.is_none() && warned.contains("/odom, /odometry/filtered"));
    assert!(opened(&path, &named("/odometry/filtered")).0.is_some());
}

#[test]
fn ground_truth_and_own_output_are_not_used_as_prior() {
    let dir = tempfile::tempdir().unwrap();
    let mut all = robot();
    all.extend(wheels("/stillpoint/odometry", "base_link"));
    let path = file(dir.path(), "own.mcap", &all);
    let (model, _, warned) = opened(&path, &OpenOptions::default());
    assert!(model.is_none() && warned.is_empty(), "{warned}");
    let refused = |path: &Path, options: &OpenOptions| open(path, options).unwrap_err().to_string();
    let e = refused(&path, &named("/stillpoint/odometry"));
    assert!(
        e.contains("--odometry-topic") && e.contains("own") && e.contains("topics none"),
        "{e}"
    );
    all.extend(wheels("/odom", "base_link"));
    let path = file(dir.path(), "both.mcap", &all);
    assert!(opened(&path, &OpenOptions::default()).0.is_some());
    let truth = |topic: Option<&str>| OpenOptions {
        truth_topic: Some("/odom".into()),
        odometry_topic: topic.map(Into::into),
        ..OpenOptions::default()
    };
    let input = open(&path, &truth(None)).unwrap();
    assert!(input.odometry().is_none() && input.ground_truth().unwrap().is_some());
    assert!(refused(&path, &truth(Some("/odom"))).contains("nor the ground truth"));
    assert!(refused(&path, &named("/tf")).contains("topics /odom"));
}

#[test]
fn recorded_odometry_round_trips() {
    let dir = tempfile::tempdir().unwrap();
    let source = file(dir.path(), "source.mcap", &camera("/camera", FRAMES));
    let input = open(&source, &OpenOptions::default()).unwrap();
    let copy = dir.path().join("copy.mcap");
    let turned = so3::exp(&Vec3::new(-0.5, 0.5, -0.7));
    let pose = Se3::new(turned, Vec3::new(0.2, 0.0, 0.5));
    let model = OdometryModel {
        time_offset: 0.25,
        ..OdometryModel::mounted(pose)
    };
    let mut recorder = McapRecorder::create(&copy, &input.camera().camera).unwrap();
    recorder.add_base(&model, 5.0).unwrap();
    let given: Vec<OdometrySample> = (0..10)
        .map(|k| OdometrySample {
            stamp: 4.75 + 0.02 * f64::from(k),
            position: [0.1 * f64::from(k), -0.2, 0.3],
            orientation: [0.0, 0.6, 0.0, -0.8],
            sigmas: (k > 2).then_some([0.25, 0.5]),
        })
        .collect();
    assert_eq!(recorder.add_odometry(&given).unwrap(), given.len());
    let before = OdometrySample {
        stamp: -0.5,
        ..given[0]
    };
    assert_eq!(recorder.add_odometry(&[before]).unwrap(), 0);
    for frame in frames(&input) {
        recorder.add(&frame).unwrap();
    }
    recorder.finish().unwrap();
    let back = open(&copy, &OpenOptions::default()).unwrap();
    assert!(back.warnings().is_empty(), "{:?}", back.warnings());
    let read = back.odometry().unwrap();
    assert_eq!(read.time_offset, 0.0, "stamps are on the camera's clock");
    let turn = read.base_from_camera.rotation.angle_to(&pose.rotation);
    assert!(turn < 1e-9 && read.base_from_camera.translation == pose.translation);
    let taken = taken(&back, 0).concat();
    assert_eq!(taken.len(), 6, "up to the last frame, and one behind it");
    for (a, b) in taken.iter().zip(&given) {
        assert!((a.stamp - b.stamp - 0.25).abs() < 1e-6);
        assert_eq!((a.position, a.orientation), (b.position, b.orientation));
        assert_eq!(a.sigmas, b.sigmas);
    }
}
