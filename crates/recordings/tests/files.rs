//! Recording files: intact, truncated, and damaged.

use crate::writers::*;
use std::path::{Path, PathBuf};
use stillpoint_geometry::Camera;
use stillpoint_imaging::{DepthImage, FrameId, FrameSource, GrayImage, RgbdFrame};
use stillpoint_recordings::{
    FrameOptions, Input, McapRecorder, OpenOptions, TRUTH_TOPIC, info, open,
};

const FRAMES: usize = 10;

pub(crate) fn put(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// Values taken from a source after each of its frames, from one on.
pub(crate) fn with_each_frame<T>(
    input: &Input,
    start: usize,
    take: impl Fn(&mut dyn FrameSource) -> T,
) -> Vec<T> {
    let options = FrameOptions {
        start,
        ..FrameOptions::default()
    };
    let mut source = input.frames(&options).unwrap();
    let mut all = Vec::new();
    while let Some(frame) = source.next_frame() {
        frame.unwrap();
        all.push(take(&mut source));
    }
    all
}

pub(crate) fn frames(input: &Input) -> Vec<RgbdFrame> {
    let mut source = input.frames(&FrameOptions::default()).unwrap();
    std::iter::from_fn(|| source.next_frame())
        .map(Result::unwrap)
        .collect()
}

/// All ways to write the same frames.
pub(crate) fn variants(messages: &[Sent]) -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("plain.mcap", mcap(messages, None)),
        ("chunks.mcap", mcap(messages, Some((7, false)))),
        ("lz4.mcap", mcap(messages, Some((7, true)))),
        ("plain.bag", bag(messages, "none")),
        ("lz4.bag", bag(messages, "lz4")),
        ("bz2.bag", bag(messages, "bz2")),
    ]
}

#[test]
fn frames_match_the_written_ones() {
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes) in variants(&camera("/camera", FRAMES)) {
        let path = put(dir.path(), name, &bytes);
        let input = open(&path, &OpenOptions::default()).unwrap();
        assert!(
            input.warnings().is_empty(),
            "{name}: {:?}",
            input.warnings()
        );
        assert_eq!(input.camera().camera.fx, 30.0);
        let found = frames(&input);
        assert_eq!(found.len(), FRAMES, "{name}");
        for (k, frame) in found.iter().enumerate() {
            assert_eq!(frame.id.0 as usize, k);
            assert!(
                (frame.stamp - 5.0 - k as f64 / 30.0).abs() < 1e-6,
                "{name}: {}",
                frame.stamp
            );
            for (x, y) in [(0, 0), (31, 0), (17, 23)] {
                assert_eq!(frame.gray.at(x, y), grey(k, x as u32, y as u32), "{name}");
                let z = f64::from(depth_mm(k, x as u32, y as u32)) / 1000.0;
                assert_eq!(frame.depth.at(x, y), z as f32, "{name}");
            }
        }
    }
}

/// A clock may start at zero; some drivers leave zero in every stamp.
#[test]
fn first_stamp_of_zero_is_valid() {
    let dir = tempfile::tempdir().unwrap();
    let from_zero = |k: usize| k as u64 * 40_000_000;
    for (name, bytes) in variants(&stamped_camera("/camera", FRAMES, from_zero)) {
        let input = open(&put(dir.path(), name, &bytes), &OpenOptions::default()).unwrap();
        assert!(
            input.warnings().is_empty(),
            "{name}: {:?}",
            input.warnings()
        );
        for (k, (stamp, depth)) in input.stamps().into_iter().enumerate() {
            assert_eq!((stamp, depth), (k as f64 * 0.04, k as f64 * 0.04), "{name}");
        }
    }
    let bytes = mcap(&stamped_camera("/camera", FRAMES, |_| 0), None);
    let input = open(
        &put(dir.path(), "none.mcap", &bytes),
        &OpenOptions::default(),
    )
    .unwrap();
    let said = input.warnings().join(" ");
    assert!(said.contains("10 of 10 images have no stamp"), "{said}");
    assert!((input.stamps()[0].0 - 5.002).abs() < 1e-9);
}

#[test]
fn truncated_files_are_used_up_to_the_cut() {
    const MANY: usize = 40;
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes) in variants(&camera("/camera", MANY)) {
        for part in [4, 5, 6] {
            let path = put(dir.path(), name, &bytes[..bytes.len() * part / 8]);
            let input = open(&path, &OpenOptions::default()).unwrap();
            let said = input.warnings().join("\n");
            assert!(said.contains("cut off"), "{name}: {said}");
            let found = frames(&input).len();
            // All frames before the cut, except for a few where a block is compressed as a whole.
            let whole = (MANY * part / 8).saturating_sub(6);
            assert!(
                (whole.max(1)..MANY).contains(&found),
                "{name}: {found} of {part}/8"
            );
        }
    }
}

#[test]
fn recording_with_two_cameras_needs_a_topic() {
    let dir = tempfile::tempdir().unwrap();
    let mut both = camera("/front", 4);
    both.extend(camera("/rear", 4));
    let path = put(dir.path(), "two.mcap", &mcap(&both, None));
    let refused = open(&path, &OpenOptions::default())
        .unwrap_err()
        .to_string();
    for part in [
        "/front/color/image_raw",
        "/rear/color/image_raw",
        "--color-topic",
    ] {
        assert!(refused.contains(part), "{refused}");
    }
    let named = OpenOptions {
        colour_topic: Some("/rear/color/image_raw".into()),
        ..OpenOptions::default()
    };
    let said = open(&path, &named).unwrap().guesses().join("\n");
    assert!(said.contains("/rear/aligned_depth_to_color"), "{said}");
}

#[test]
fn ground_truth_is_given_for_the_camera() {
    let dir = tempfile::tempdir().unwrap();
    let mut all = camera("/camera", 4);
    all.extend(odometry(4));
    for (name, bytes) in variants(&all) {
        let path = put(dir.path(), name, &bytes);
        assert!(
            open(&path, &OpenOptions::default())
                .unwrap()
                .ground_truth()
                .unwrap()
                .is_none()
        );
        let named = OpenOptions {
            truth_topic: Some("/odom".into()),
            ..OpenOptions::default()
        };
        let poses = open(&path, &named)
            .unwrap()
            .ground_truth()
            .unwrap()
            .unwrap();
        assert_eq!(poses.len(), 4, "{name}");
        let t = poses[2].world_from_camera.translation;
        assert_eq!((t.x, t.z), (2.0, 0.5), "{name}");
        let wrong = OpenOptions {
            truth_topic: Some("/odometry".into()),
            ..OpenOptions::default()
        };
        let refused = open(&path, &wrong).unwrap_err().to_string();
        assert!(
            refused.contains("--truth-topic") && refused.contains("/odom"),
            "{refused}"
        );
    }
}

#[test]
fn unknown_files_are_refused_with_a_reason() {
    let dir = tempfile::tempdir().unwrap();
    for (bytes, part) in [
        (&b""[..], "an empty file"),
        (b"#ROSBAG V1.2\n", "rosbag fix"),
        (b"hello world, this is text", "a file of another format"),
    ] {
        let path = put(dir.path(), "file", bytes);
        let refused = open(&path, &OpenOptions::default())
            .unwrap_err()
            .to_string();
        assert!(
            refused.contains(part) && refused.contains("expected"),
            "{refused}"
        );
    }
    let path = put(dir.path(), "file", &mcap(&[], None));
    let refused = open(&path, &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(refused.contains("no image topics"), "{refused}");
}

#[test]
fn recorded_file_round_trips() {
    let dir = tempfile::tempdir().unwrap();
    let mut all = camera("/camera", 5);
    all.extend(odometry(5));
    let path = put(dir.path(), "source.bag", &bag(&all, "lz4"));
    let named = |topic: &str| OpenOptions {
        truth_topic: Some(topic.into()),
        ..OpenOptions::default()
    };
    let input = open(&path, &named("/odom")).unwrap();
    let colours = FrameOptions {
        keep_colour: true,
        ..FrameOptions::default()
    };
    let all = |input: &Input| {
        let mut source = input.frames(&colours).unwrap();
        std::iter::from_fn(move || source.next_frame())
            .map(Result::unwrap)
            .collect::<Vec<_>>()
    };
    let copy = dir.path().join("copy.mcap");
    let mut recorder = McapRecorder::create(&copy, &input.camera().camera).unwrap();
    all(&input).iter().for_each(|f| recorder.add(f).unwrap());
    for pose in input.ground_truth().unwrap().unwrap() {
        recorder.add_truth(&pose).unwrap();
    }
    assert!(!copy.exists(), "not before it is whole");
    recorder.finish().unwrap();
    let back = open(&copy, &named(TRUTH_TOPIC)).unwrap();
    assert!(back.warnings().is_empty(), "{:?}", back.warnings());
    assert_eq!(back.camera().camera, input.camera().camera);
    let (ours, others) = (all(&back), all(&input));
    assert_eq!(ours.len(), 5);
    for (a, b) in ours.iter().zip(&others) {
        assert!((a.stamp - b.stamp).abs() < 1e-6 && (a.depth_stamp - b.depth_stamp).abs() < 1e-6);
        assert_eq!(
            a.colour.as_ref().unwrap().data(),
            b.colour.as_ref().unwrap().data()
        );
        assert_eq!(a.depth.data(), b.depth.data());
    }
    let poses = back.ground_truth().unwrap().unwrap();
    assert_eq!(poses[3].world_from_camera.translation.x, 3.0);
    assert!(
        McapRecorder::create(&copy, &input.camera().camera).is_err(),
        "nothing is overwritten"
    );
    let found = info(&copy).unwrap();
    assert_eq!(
        (found.format, found.topics.len(), found.topics[0].messages),
        ("MCAP", 5, 5)
    );
}

/// A camera whose depth is half a frame late, then half a frame early: by stamps alone each image would be nearer to another one, and one
/// would be left over.
#[test]
fn recorded_image_pairs_stay_paired() {
    let dir = tempfile::tempdir().unwrap();
    let camera = Camera::pinhole(64, 48, [60.0, 60.0, 31.5, 23.5]);
    let path = dir.path().join("pairs.mcap");
    let mut recorder = McapRecorder::create(&path, &camera).unwrap();
    let mut stamps = Vec::new();
    for i in 0..60_u32 {
        let stamp = 1.0 + f64::from(i) * 0.033_333;
        let depth_stamp = stamp + if i < 30 { 0.016_75 } else { -0.016_5 };
        stamps.push((stamp, depth_stamp));
        recorder
            .add(&RgbdFrame {
                id: FrameId(i),
                stamp,
                depth_stamp,
                gray: GrayImage::new(64, 48),
                colour: None,
                depth: DepthImage::from_vec(64, 48, vec![1.0 + i as f32; 64 * 48]).unwrap(),
            })
            .unwrap();
    }
    recorder.finish().unwrap();
    let input = open(&path, &OpenOptions::default()).unwrap();
    let found = input.stamps();
    assert_eq!(found.len(), 60, "{:?}", input.guesses());
    for (i, (a, b)) in found.iter().zip(&stamps).enumerate() {
        assert!(
            (a.0 - b.0).abs() < 1e-6 && (a.1 - b.1).abs() < 1e-6,
            "frame {i}: {a:?} {b:?}"
        );
    }
}
