//! Clocks that are set back during a recording.

use crate::files::{frames, put, variants};
use crate::writers::*;
use std::path::{Path, PathBuf};
use stillpoint_datasets::StampedPose;
use stillpoint_recordings::{OpenOptions, open};

const FRAMES: usize = 24;

fn written(folder: &Path, messages: &[Sent]) -> Vec<PathBuf> {
    let files = variants(messages);
    let put = |(name, bytes): &(&str, Vec<u8>)| put(folder, name, bytes);
    #[cfg_attr(not(feature = "sqlite"), expect(unused_mut))]
    let mut all: Vec<PathBuf> = files.iter().map(put).collect();
    #[cfg(feature = "sqlite")]
    {
        let path = folder.join("a.db3");
        drop(crate::sqlite::write(&path, messages));
        all.push(path);
    }
    all
}

/// Set back by half a second from frame 13 on.
fn set_back(k: usize) -> u64 {
    arrived(k) - if k < 12 { 0 } else { 500_000_000 }
}

/// The recording computer's clock is set back by half a second: header stamps are older from there on, whatever the times of arrival are.
#[test]
fn message_order_is_kept_after_a_backward_clock_jump() {
    for arrives in [true, false] {
        let dir = tempfile::tempdir().unwrap();
        let mut messages = stamped_camera("/camera", FRAMES, set_back);
        let each = messages.len() / FRAMES;
        for (i, sent) in messages.iter_mut().enumerate().filter(|_| arrives) {
            sent.time = arrived(i / each);
        }
        for path in written(dir.path(), &messages) {
            let name = path.display();
            let input = open(&path, &OpenOptions::default()).unwrap();
            let said = input.warnings().join("; ");
            assert!(
                said.contains("message 13: stamps go back by 0.467 s"),
                "{name}: {said}"
            );
            assert_eq!(input.set_back().len(), 1, "{name}");
            let found = frames(&input);
            assert_eq!(found.len(), FRAMES, "{name}");
            for (k, frame) in found.iter().enumerate() {
                assert_eq!(frame.gray.at(3, 2), grey(k, 3, 2), "{name} {k}");
                assert!(
                    (frame.stamp - 5.0 - k as f64 / 30.0).abs() < 1e-3,
                    "{name} {k}"
                );
                assert!((frame.depth_stamp - frame.stamp).abs() < 0.02, "{name} {k}");
            }
        }
    }
}

/// Ground truth of a file with camera and odometry, and its remarks.
fn truth(path: &Path) -> (Vec<StampedPose>, String) {
    let options = OpenOptions {
        truth_topic: Some("/odom".into()),
        ..OpenOptions::default()
    };
    let input = open(path, &options).unwrap();
    let (poses, said) = input.ground_truth_said().unwrap().unwrap();
    (poses, said.join("; "))
}

#[test]
fn ground_truth_order_is_kept_after_a_clock_jump() {
    // Only the odometry's clock is set back, or the common one.
    for camera in [arrived, set_back] {
        let dir = tempfile::tempdir().unwrap();
        let mut messages = stamped_camera("/camera", FRAMES, camera);
        messages.extend(stamped_odometry(FRAMES, set_back));
        for path in written(dir.path(), &messages) {
            let name = path.display();
            let (poses, said) = truth(&path);
            assert!(
                said.contains("/odom, pose 13: stamps go back by 0.467 s"),
                "{name}: {said}"
            );
            assert_eq!(poses.len(), FRAMES, "{name}");
            for (k, pose) in poses.iter().enumerate() {
                assert_eq!(pose.world_from_camera.translation.x, k as f64, "{name}");
                assert!(
                    (pose.stamp - 5.0 - k as f64 / 30.0).abs() < 1e-3,
                    "{name} {k}"
                );
            }
        }
    }
}

#[test]
fn repeated_or_late_ground_truth_stamps_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let stamp = |k: usize| match k {
        5 => arrived(4),
        9 => arrived(10),
        10 => arrived(9),
        k => arrived(k),
    };
    let mut messages = camera("/camera", FRAMES);
    messages.extend(stamped_odometry(FRAMES, stamp));
    for path in written(dir.path(), &messages) {
        let name = path.display();
        let (poses, said) = truth(&path);
        assert_eq!(poses.len(), FRAMES - 1, "{name}");
        assert_eq!(poses[8].world_from_camera.translation.x, 10.0, "{name}");
        assert!(
            said.contains("repeat a stamp and are left out: 1")
                && said.contains("come late by their stamps, all of which are sorted: 1"),
            "{name}: {said}"
        );
    }
    // Ordered poses give no remark.
    let mut messages = camera("/camera", FRAMES);
    messages.extend(odometry(FRAMES));
    let path = put(dir.path(), "well.mcap", &mcap(&messages, None));
    assert_eq!(truth(&path).1, "");
}
