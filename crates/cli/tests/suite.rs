//! `bench --suite` on folders laid out like the public data sets, made from simulated rooms.

use crate::common::{check, copy, files, program, simulate, stdout, stillpoint};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::LazyLock;
use stillpoint::datasets::trajectory;
use stillpoint::geometry::{Mat3, Se3, Vec3};
use tempfile::TempDir;

/// A second and a half: RPE over 1 s has some pairs.
const FRAMES: usize = 45;

static ROOM: LazyLock<TempDir> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    simulate(&dir.path().join("room"), "halfsphere", FRAMES);
    dir
});

fn room() -> PathBuf {
    ROOM.path().join("room")
}

fn suite(name: &str, folder: &Path, out: &Path, more: &[&str]) -> Output {
    program()
        .args(["bench", "--suite", name, "--out"])
        .arg(out)
        .arg(folder)
        .args(more)
        .output()
        .unwrap()
}

fn json(out: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(out.join("suite.json")).unwrap()).unwrap()
}

/// The row of a sequence.
fn row<'a>(report: &'a Value, name: &str) -> &'a Value {
    let rows = report["sequences"].as_array().unwrap();
    rows.iter().find(|r| r["name"] == name).unwrap()
}

/// The median of a figure.
fn figure(row: &Value, error: &str, statistic: &str) -> f64 {
    row["figures"][error][statistic]["median"]
        .as_f64()
        .unwrap_or_else(|| panic!("no {error} {statistic}: {}", row["figures"]))
}

/// The line of the printed table that begins with a sequence's name, as cells.
fn line(text: &str, name: &str) -> Vec<String> {
    let line = text
        .lines()
        .find(|l| l.starts_with(&format!("| {name} ")))
        .unwrap_or_else(|| panic!("no line {name} in {text}"));
    let cells = line.trim_matches('|').split('|');
    cells.map(|c| c.trim().to_owned()).collect()
}

#[test]
fn a_folder_like_tum_gives_a_table_beside_published_figures() {
    let dir = tempfile::tempdir().unwrap();
    let tum = dir.path().join("tum");
    copy(&room(), &tum.join("rgbd_dataset_freiburg3_walking_xyz"));
    let deep = tum.join("fr3/rgbd_dataset_freiburg3_sitting_rpy");
    copy(&room(), &deep);
    // Not of the suite.
    copy(&room(), &tum.join("rgbd_dataset_freiburg1_xyz"));
    let out = dir.path().join("out");
    let output = suite("tum-dynamic", &tum, &out, &["--runs", "2"]);
    check(&output, 0, &["2 of 9 sequences found"]);

    let text = stdout(&output);
    assert_eq!(std::fs::read_to_string(out.join("suite.md")).unwrap(), {
        let end = text.find("\nwritten to").unwrap();
        text[..end].to_owned()
    });
    assert!(!text.contains("freiburg1"), "{text}");
    let walking = line(&text, "walking_xyz");
    assert_eq!(walking[1], "ran");
    assert_eq!(walking[3], "100.0 / 100.0");
    assert_eq!(walking[10..], ["15.1"]);
    let rpy = line(&text, "sitting_rpy");
    assert_eq!(rpy[10..], ["-"]);
    let missing = line(&text, "walking_halfsphere");
    assert_eq!(missing[1..4], ["not found", "-", "-"]);
    assert_eq!(missing[10..], ["25.8"]);
    // Every published figure with its system and source.
    let published = text.split("Published:").nth(1).unwrap();
    assert_eq!(
        line(published, "walking_xyz")[1..],
        ["952.8", "24.7", "57.1", "15.3", "15.2", "15.1"]
    );
    assert!(published.contains("SG-SLAM [6] "), "{published}");
    for source in [
        "[6] Cheng et al.",
        "[1] \"A real-time visual SLAM",
        "best of several runs",
    ] {
        assert!(published.contains(source), "{source} not in {published}");
    }

    let report = json(&out);
    let walking = row(&report, "walking_xyz");
    assert_eq!(walking["state"], "ran");
    assert_eq!(walking["runs"].as_array().unwrap().len(), 2);
    assert_eq!(walking["figures"]["identical"], true);
    assert_eq!(walking["published"][4]["system"], "SG-SLAM");
    assert_eq!(walking["published"][4]["ate_rmse"], 0.0152);
    for (error, limit) in [
        ("ate", 0.02),
        ("rpe_translation", 0.04),
        ("rpe_rotation_deg", 2.0),
    ] {
        let (rmse, sd) = (figure(walking, error, "rmse"), figure(walking, error, "sd"));
        assert!(0.0 < sd && sd < rmse && rmse < limit, "{error} {rmse} {sd}");
    }
    assert_eq!(row(&report, "sitting_rpy")["path"], deep.to_str().unwrap());
    assert_eq!(row(&report, "walking_rpy")["state"], "not_found");
    let runs = files(&out.join("runs"));
    assert_eq!(runs.len(), 4, "{runs:?}");
}

#[test]
fn a_sequence_that_fails_does_not_stop_the_others() {
    let dir = tempfile::tempdir().unwrap();
    let broken = dir.path().join("fr3_walking_xyz");
    copy(&room(), &broken);
    std::fs::write(broken.join("rgb.txt"), "1.0 rgb/a.png\nnonsense\n").unwrap();
    copy(&room(), &dir.path().join("fr3_walking_static"));
    let out = dir.path().join("out");
    let output = suite(
        "tum-dynamic",
        dir.path(),
        &out,
        &["--runs", "1", "--max-frames", "5"],
    );
    check(&output, 1, &["walking_xyz: run failed", "rgb.txt:2"]);
    let text = stdout(&output);
    assert_eq!(line(&text, "walking_xyz")[1], "failed");
    assert!(text.contains("- walking_xyz: run failed"), "{text}");
    assert_eq!(line(&text, "walking_static")[1..3], ["ran", "5"]);
    let report = json(&out);
    let failed = row(&report, "walking_xyz");
    assert_eq!(failed["state"], "failed");
    assert!(failed["error"].as_str().unwrap().contains("rgb.txt:2"));
    assert_eq!(row(&report, "walking_static")["state"], "ran");

    // Alone, nothing is left to report.
    let output = suite("tum-dynamic", &broken, &dir.path().join("alone"), &[]);
    check(&output, 2, &["rgb.txt:2"]);
}

#[test]
fn bonn_is_scored_against_the_camera_behind_the_marker() {
    let dir = tempfile::tempdir().unwrap();
    let crowd = dir.path().join("bonn/rgbd_bonn_crowd");
    copy(&room(), &crowd);
    let file = crowd.join("groundtruth.txt");
    let mut poses = trajectory::read(&file).unwrap();
    for p in &mut poses {
        p.world_from_camera = marker_pose(&p.world_from_camera);
    }
    std::fs::write(&file, trajectory::format(&poses)).unwrap();
    let out = dir.path().join("out");
    let output = suite("bonn", dir.path(), &out, &["--runs", "1"]);
    check(&output, 0, &["1 of 26 sequences found"]);
    let text = stdout(&output);
    assert_eq!(line(&text, "crowd")[10..], ["19.0"]);
    let report = json(&out);
    let crowd = row(&report, "crowd");
    // One run cannot say that runs are the same.
    assert_eq!(crowd["figures"]["identical"], Value::Null);
    assert_eq!(crowd["runs"][0]["input"]["layout"], "Bonn");
    let rpe = figure(crowd, "rpe_translation", "rmse");
    assert!(rpe < 0.04 && figure(crowd, "rpe_rotation_deg", "rmse") < 2.0);
    assert!(figure(crowd, "ate", "rmse") < 0.02);
    // Control: the marker's own poses are far from that.
    let estimate = out.join("runs/crowd-1/trajectory.txt");
    let output = program()
        .args(["eval", "--json"])
        .args([&file, &estimate])
        .output()
        .unwrap();
    check(&output, 0, &[]);
    let marker: Value = serde_json::from_slice(&output.stdout).unwrap();
    let marker = marker["rpe"]["translation"]["rmse"].as_f64().unwrap();
    assert!(marker > 5.0 * rpe, "{marker} {rpe}");
}

/// The pose that the data set would state for a camera: `T_ros T T_m^-1 T_ros`, the inverse of the published conversion
/// `T = T_ros T_gt T_ros T_m` (`T_ros` is its own inverse), with the rotation in `T_m`.
fn marker_pose(world_from_camera: &Se3) -> Se3 {
    let ros = Mat3::new(-1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0);
    let marker = Mat3::new(
        1.0157, 0.1828, -0.2389, 0.0009, -0.8431, -0.6413, -0.3009, 0.6147, -0.8085,
    );
    let svd = marker.svd(true, true);
    let rotation = svd.u.unwrap() * svd.v_t.unwrap();
    let ros = Se3::from_matrix(&ros, Vec3::zeros());
    let marker = Se3::from_matrix(&rotation, Vec3::new(0.0113, -0.0098, 0.0111));
    ros * *world_from_camera * marker.inverse() * ros
}

#[test]
fn what_cannot_be_used_is_said_before_anything_runs() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let output = suite("bonn", dir.path(), &out, &[]);
    check(&output, 2, &["rgbd_bonn_crowd", "found none"]);
    let output = suite("bonn", &dir.path().join("no"), &out, &[]);
    check(&output, 2, &["found nothing"]);
    let output = suite("kitti", dir.path(), &out, &[]);
    check(&output, 2, &["tum-dynamic", "bonn"]);
    check(&stillpoint(["bench", "--suite", "bonn"]), 2, &["PATH"]);
    assert!(!out.exists());
}
