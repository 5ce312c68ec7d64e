//! Compares errors of whole runs over recordings with the table `crates/testdata/ate.csv`. Runs with true boxes are in the library's tests,
//! which read the frames once for several presets.
//!
//! Runs have up to 334 frames, to bound the time of the gate. The network processes every fifth frame, since it takes ten times as long as
//! everything else.

use crate::common::program;
use std::path::Path;
use stillpoint_testdata::ate::{self, Figures};

/// The detector model, if available.
const MODEL: &str = "models/yolox_nano_416.onnx";
const NETWORK: &str = "yolox_nano_416 every 5";

/// Runs with a preset of the static filter and returns the ATE of the final poses; where the camera stands still and alignment is
/// undefined, their distance from the first pose.
#[track_caller]
fn run(recording: &Path, preset: &str, more: &[&str]) -> Figures {
    let dir = tempfile::tempdir().unwrap();
    let output = program()
        .args(["-q", "run", "--no-report"])
        .args(["--out", dir.path().to_str().unwrap()])
        .args(["--set", &format!("static_filter.preset={preset}")])
        .args(more)
        .arg(recording)
        .output()
        .unwrap();
    let summary = std::fs::read(dir.path().join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
    let accuracy = &summary["accuracy"]["final"];
    let [ate, drift] = ["ate", "drift"].map(|figure| accuracy[figure]["rmse"].as_f64());
    let [frames, posed] = ["frames", "tracked"].map(|n| summary[n].as_u64().unwrap() as usize);
    // Code 1 means lost frames, which occur among people without the filter. The default preset loses none.
    let code = i32::from(posed < frames && preset != "default");
    assert_eq!(output.status.code(), Some(code), "{posed} {output:?}");
    Figures {
        error_mm: 1e3 * ate.or(drift).unwrap(),
        frames,
        posed,
    }
}

/// Checks runs without a detector; returns their errors, mm.
fn hold_alone<const N: usize>(name: &str, presets: [&str; N]) -> Option<[f64; N]> {
    let recording = stillpoint_testdata::recording(name)?;
    Some(presets.map(|preset| {
        let found = run(&recording, preset, &["--detector", "none"]);
        ate::hold(name, "none", preset, found);
        found.error_mm
    }))
}

fn hold_detected(name: &str, presets: &[&str]) {
    let found = stillpoint_testdata::recording(name).zip(stillpoint_testdata::beside(MODEL));
    let Some((recording, model)) = found else {
        return;
    };
    let detector = ["--detector", model.to_str().unwrap(), "--runtime", "rten"];
    let more = [&detector[..], &["--set", "detector.stride=5"]].concat();
    for preset in presets {
        ate::hold(name, NETWORK, preset, run(&recording, preset, &more));
    }
}

/// In a static scene the filter costs little: bounds its error by this factor of the error without it.
fn hold_still(name: &str, most: f64) {
    let Some([filtered, off]) = hold_alone(name, ["default", "off"]) else {
        return;
    };
    assert!(
        filtered < most * off,
        "{name}: {filtered} mm, {off} mm without the filter"
    );
}

#[test]
fn ate_of_fr1_xyz() {
    hold_still("fr1_xyz", 1.05);
    hold_detected("fr1_xyz", &["default"]);
}

#[test]
fn ate_of_fr1_xyz_walkers() {
    hold_alone("fr1_xyz_walkers", ["default", "off"]);
    hold_detected("fr1_xyz_walkers", &["default"]);
}

#[test]
fn ate_of_fr1_rpy_walkers() {
    hold_alone("fr1_rpy_walkers", ["default", "off"]);
    hold_detected("fr1_rpy_walkers", &["default"]);
}

/// A regression check: depth is not registered to colour here, which causes most of the error.
#[test]
fn ate_of_kitchen() {
    hold_alone("kitchen", ["default"]);
}

#[test]
fn ate_of_tartanair_office() {
    // Six seeds have 1.38 (4.4 to 9.7 mm, 3.9 without the filter); the cause is not known (decision 65).
    hold_still("tartanair_office", 1.5);
}

#[test]
fn drift_of_corridor_fixed() {
    hold_alone("corridor_fixed", ["default", "off", "paper"]);
    hold_detected("corridor_fixed", &["default"]);
}

#[test]
fn drift_of_lab_fixed() {
    hold_alone("lab_fixed", ["default", "off"]);
    hold_detected("lab_fixed", &["default", "paper"]);
}

/// Runs that begin among people: without a detector nothing tells at first which of the many moving regions is the room. With wide gates
/// alone these two were off by 96 and 175 mm.
#[test]
fn run_starting_among_people_follows_the_room() {
    let Some(recording) = stillpoint_testdata::recording("fr1_xyz_walkers") else {
        return;
    };
    for start in ["150", "170"] {
        let more = ["--detector", "none", "--start", start];
        let found = run(&recording, "default", &more);
        ate::hold(
            &format!("fr1_xyz_walkers from frame {start}"),
            "none",
            "default",
            found,
        );
    }
}
