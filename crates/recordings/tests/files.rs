//! Recordings in files: whole, cut off, and damaged.

use crate::writers::*;
use std::path::{Path, PathBuf};
use stillpoint_imaging::{FrameSource, RgbdFrame};
use stillpoint_recordings::{
    FrameOptions, Input, McapRecorder, OpenOptions, TRUTH_TOPIC, info, open,
};

const FRAMES: usize = 10;

fn put(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn frames(input: &Input) -> Vec<RgbdFrame> {
    let mut source = input.frames(&FrameOptions::default()).unwrap();
    std::iter::from_fn(|| source.next_frame())
        .map(Result::unwrap)
        .collect()
}

/// Every way to write the same frames.
fn variants(messages: &[Sent]) -> Vec<(&'static str, Vec<u8>)> {
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
fn frames_are_those_that_were_written() {
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

#[test]
fn what_is_before_a_cut_is_used() {
    const MANY: usize = 40;
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes) in variants(&camera("/camera", MANY)) {
        for part in [4, 5, 6] {
            let path = put(dir.path(), name, &bytes[..bytes.len() * part / 8]);
            let input = open(&path, &OpenOptions::default()).unwrap();
            let said = input.warnings().join("\n");
            assert!(said.contains("cut off"), "{name}: {said}");
            let found = frames(&input).len();
            // Whole frames of the part; blocks of a few are lost where a block is compressed as one.
            let whole = (MANY * part / 8).saturating_sub(6);
            assert!(
                (whole.max(1)..MANY).contains(&found),
                "{name}: {found} of {part}/8"
            );
        }
    }
}

#[test]
fn no_mutation_panics_or_takes_long() {
    // Fixed seeds: a byte here and there, a block moved, a cut.
    let dir = tempfile::tempdir().unwrap();
    let mut state = 1_u64;
    let mut random = |below: usize| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for (name, whole) in variants(&camera("/camera", 3)) {
        for _ in 0..200 {
            let mut bytes = whole.clone();
            for _ in 0..1 + random(8) {
                let at = random(bytes.len());
                match random(4) {
                    0 => bytes[at] = random(256) as u8,
                    1 => bytes[at] = 0xff,
                    2 => bytes[at] ^= 1 << random(8),
                    _ => {
                        let end = (at + random(16)).min(bytes.len());
                        bytes[at..end].fill(random(2) as u8 * 0xff);
                    }
                }
            }
            if random(4) == 0 {
                bytes.truncate(1 + random(whole.len()));
            }
            let path = put(dir.path(), name, &bytes);
            if let Ok(input) = open(&path, &OpenOptions::default()) {
                let mut source = input.frames(&FrameOptions::default()).unwrap();
                while source.next_frame().is_some() {}
            }
        }
    }
}

#[test]
fn two_cameras_need_a_name() {
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
fn ground_truth_is_that_of_the_camera() {
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
fn other_files_are_refused_in_words() {
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
fn what_is_recorded_reads_back() {
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
