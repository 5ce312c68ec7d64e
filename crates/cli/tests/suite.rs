//! `bench --suite` on folders laid out like the public data sets, made from simulated rooms.

use crate::common::{check, copy, files, program, simulate, stdout, stillpoint};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::LazyLock;
use stillpoint::datasets::{CameraModel, ColourFormat, Recorder};
use stillpoint::geometry::{Mat3, Se3, Vec3};
use stillpoint::imaging::FrameSource;
use stillpoint::simulator::{Simulator, SimulatorConfig};
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

fn row<'a>(report: &'a Value, name: &str) -> &'a Value {
    let rows = report["sequences"].as_array().unwrap();
    rows.iter().find(|r| r["name"] == name).unwrap()
}

fn figure(case: &Value, error: &str, statistic: &str) -> f64 {
    case["figures"][error][statistic]["median"]
        .as_f64()
        .unwrap_or_else(|| panic!("no {error} {statistic}: {}", case["figures"]))
}

/// The lines of the printed table that begin with a sequence's name, as cells.
fn lines(text: &str, name: &str) -> Vec<Vec<String>> {
    let lines = text
        .lines()
        .filter(|l| l.starts_with(&format!("| {name} ")));
    let cells = |l: &str| {
        let cells = l.trim_matches('|').split('|');
        cells.map(|c| c.trim().to_owned()).collect()
    };
    lines.map(cells).collect()
}

fn line(text: &str, name: &str) -> Vec<String> {
    let first = lines(text, name).into_iter().next();
    first.unwrap_or_else(|| panic!("no line {name} in {text}"))
}

/// The part of the report with published figures.
fn compared(text: &str) -> &str {
    text.split("Beside published figures.").nth(1).unwrap()
}

#[test]
fn tum_suite_compares_with_published_figures() {
    let dir = tempfile::tempdir().unwrap();
    let tum = dir.path().join("tum");
    copy(&room(), &tum.join("rgbd_dataset_freiburg3_walking_xyz"));
    let deep = tum.join("fr3/rgbd_dataset_freiburg3_sitting_rpy");
    copy(&room(), &deep);
    // Not part of the suite.
    copy(&room(), &tum.join("rgbd_dataset_freiburg1_xyz"));
    let out = dir.path().join("out");
    let output = suite("tum-dynamic", &tum, &out, &["--seeds", "2", "--seed", "5"]);
    check(
        &output,
        0,
        &["2 of 9 sequences found", "walking_xyz: as set, seed 6"],
    );

    let text = stdout(&output);
    assert_eq!(std::fs::read_to_string(out.join("suite.md")).unwrap(), {
        let end = text.find("\nwritten to").unwrap();
        text[..end].to_owned()
    });
    assert!(!text.contains("freiburg1"), "{text}");
    assert!(text.contains("2 seeds each (5 to 6)"), "{text}");
    let walking = line(&text, "walking_xyz");
    assert_eq!(walking[1..3], ["", "ran"]);
    assert_eq!(walking[4..6], ["-", "100.0 / 100.0"]);
    assert!(walking[12].contains(" / "), "{walking:?}");
    let missing = line(&text, "walking_halfsphere");
    assert_eq!(missing[1..6], ["", "not found", "-", "-", "-"]);

    // A row per published system, with every figure and its source, and ours below them.
    let published = compared(&text);
    let systems = lines(published, "walking_xyz");
    let names: Vec<&str> = systems.iter().map(|l| l[1].as_str()).collect();
    assert_eq!(
        names,
        [
            "ORB-SLAM2",
            "DS-SLAM",
            "RDS-SLAM",
            "Blitz-SLAM",
            "SG-SLAM",
            "published method",
            "Stillpoint"
        ]
    );
    assert_eq!(
        systems[1][2..],
        [
            "24.7",
            "16.1",
            "97.4",
            "33.3",
            "22.9",
            "0.83",
            "0.58",
            "76.46 (i7, P4000)",
            "[1] Table 1, Table 2, Table 3, quoting [3]"
        ]
    );
    assert_eq!(systems[5][10], "[1] Table 1, Table 2, Table 3");
    // Only the best error of a sequence is bold, which in this easy room is ours.
    let bold = |cell: &str| cell.starts_with("**");
    for column in [2, 5, 7] {
        let marked: Vec<bool> = systems.iter().map(|l| bold(&l[column])).collect();
        assert_eq!(marked, [false, false, false, false, false, false, true]);
    }
    let plain = |k: usize| systems[6][k].trim_matches('*').to_owned();
    let ours = [2, 3, 5, 6, 7, 8].map(plain);
    assert_eq!(ours[..], walking[6..12]);
    let less: f64 = systems[6][4].parse().unwrap();
    // Rounded to a tenth.
    assert!((98.0..=100.0).contains(&less), "{less}");
    assert_eq!(systems[0][4], "0.0");
    // Published figures are listed for missing sequences too; sequences without any have no rows.
    assert_eq!(lines(published, "walking_halfsphere").len(), 6);
    assert!(lines(published, "sitting_rpy").is_empty());
    for source in [
        "[6] Cheng et al.",
        "[1] \"A real-time visual SLAM",
        "Ours are medians over the seeds",
    ] {
        assert!(published.contains(source), "{source} not in {published}");
    }

    let report = json(&out);
    assert_eq!(report["seeds"], serde_json::json!([5, 6]));
    let walking = row(&report, "walking_xyz");
    assert_eq!(walking["state"], "ran");
    assert_eq!(walking["published"][4]["system"], "SG-SLAM");
    assert_eq!(walking["published"][4]["ate"]["rmse"], 0.0152);
    assert_eq!(walking["published"][4]["ate"]["table"], "Table 1");
    let case = &walking["cases"][0];
    assert_eq!(case["runs"].as_array().unwrap().len(), 2);
    for (error, limit) in [
        ("ate", 0.02),
        ("rpe_translation", 0.04),
        ("rpe_rotation_deg", 2.0),
    ] {
        let (rmse, sd) = (figure(case, error, "rmse"), figure(case, error, "sd"));
        assert!(0.0 < sd && sd < rmse && rmse < limit, "{error} {rmse} {sd}");
    }
    assert_eq!(row(&report, "sitting_rpy")["path"], deep.to_str().unwrap());
    assert_eq!(row(&report, "walking_rpy")["state"], "not_found");
    let runs = files(&out.join("runs"));
    assert_eq!(runs.len(), 4, "{runs:?}");
}

#[test]
fn suite_runs_with_ablation_and_live() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("rgbd_dataset_freiburg3_walking_rpy");
    simulate(&folder, "walking_rpy", 8);
    let out = dir.path().join("out");
    let more = [
        "--ablation",
        "--live",
        "--seeds",
        "1",
        "--detector",
        "scripted:{}/detections.csv",
    ];
    let output = suite("tum-dynamic", dir.path(), &out, &more);
    check(&output, 0, &["walking_rpy: O+G+D, seed 0", "live, seed 0"]);
    let report = json(&out);
    let cases = row(&report, "walking_rpy")["cases"].as_array().unwrap();
    let labels: Vec<&str> = cases
        .iter()
        .map(|c| c["variant"].as_str().unwrap())
        .collect();
    assert_eq!(
        labels,
        ["none", "O", "G", "O+G", "O+G+D", "default", "live"]
    );
    for case in cases {
        let live = case["variant"] == "live";
        assert_eq!(case["live"], live);
        assert_eq!(case["runs"][0]["live"].is_object(), live);
        assert_eq!(case["runs"][0]["detector"]["kind"], "scripted");
    }
    let text = stdout(&output);
    let ours = lines(&text, "walking_rpy");
    assert_eq!(ours[6][1], "live");
    let compared = lines(compared(&text), "walking_rpy");
    // The published ablation is between the other systems and our variants.
    assert_eq!(compared.len(), 6 + 5 + 7);
    assert_eq!(
        compared[6 + 1][1..4],
        ["published method, O", "43.4", "29.4"]
    );
    assert_eq!(compared[6 + 5 + 4][1], "Stillpoint, O+G+D");
    assert_eq!(compared[6 + 5 + 6][1], "Stillpoint, live");
    assert!(text.contains("Table 5 (its parts)"), "{text}");
    // Dropped frames of a live run are reported, and such a run cannot be the best.
    let live = &cases[6];
    let dropped = live["figures"]["dropped"]["worst"].as_f64().unwrap();
    let state = if dropped > 0.0 {
        "dropped frames"
    } else {
        "ran"
    };
    assert_eq!(ours[6][2], state);
    assert_eq!(ours[6][4], format!("{0:.1} / {0:.1}", 100.0 * dropped));
    assert_eq!(ours[5][4], "-");
    // --live needs --suite.
    let output = stillpoint(["bench", "--live", "sim:xyz"]);
    check(&output, 2, &["--suite"]);
}

#[test]
fn failing_sequence_does_not_stop_the_others() {
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
        &["--seeds", "1", "--max-frames", "5"],
    );
    check(
        &output,
        1,
        &["walking_xyz: as set: run failed", "rgb.txt:2"],
    );
    let text = stdout(&output);
    assert_eq!(line(&text, "walking_xyz")[2], "failed");
    assert!(text.contains("- walking_xyz: run failed"), "{text}");
    assert_eq!(line(&text, "walking_static")[2..4], ["ran", "5"]);
    let report = json(&out);
    let failed = row(&report, "walking_xyz");
    assert_eq!(failed["state"], "failed");
    let error = failed["cases"][0]["error"].as_str().unwrap();
    assert!(error.contains("rgb.txt:2"), "{error}");
    assert_eq!(row(&report, "walking_static")["state"], "ran");

    // Alone, it leaves nothing to report.
    let output = suite("tum-dynamic", &broken, &dir.path().join("alone"), &[]);
    check(&output, 2, &["rgb.txt:2"]);
}

/// A room as Bonn's camera would have recorded it.
fn bonn(folder: &Path) {
    let model = CameraModel::preset("bonn").unwrap();
    let simulator = Simulator::new(&SimulatorConfig {
        scene: "halfsphere".to_owned(),
        frames: Some(FRAMES),
        camera: model.camera,
        ..SimulatorConfig::default()
    });
    let simulator = simulator.unwrap();
    let format = ColourFormat::Png;
    let mut recorder = Recorder::create(folder, simulator.camera(), "bonn", format).unwrap();
    let poses = simulator.ground_truth();
    let mut source = simulator.source().with_colour();
    for (_, pose) in poses {
        let frame = source.next_frame().unwrap().unwrap();
        let pose = marker_pose(&pose);
        recorder.add(&frame, Some(&pose)).unwrap();
    }
    recorder.finish().unwrap();
    // The data set has no such file.
    std::fs::remove_file(folder.join("camera.toml")).unwrap();
}

#[test]
fn bonn_suite_uses_marker_transform_and_both_depth_scales() {
    let dir = tempfile::tempdir().unwrap();
    let crowd = dir.path().join("bonn/rgbd_bonn_crowd");
    bonn(&crowd);
    let file = crowd.join("groundtruth.txt");
    let out = dir.path().join("out");
    let output = suite("bonn", dir.path(), &out, &["--runs", "1"]);
    check(&output, 0, &["1 of 26 sequences found"]);
    let text = stdout(&output);
    let ours = lines(&text, "crowd");
    assert_eq!([&ours[0][1], &ours[1][1]], ["bonn", "bonn_calibrated"]);
    let systems = lines(compared(&text), "crowd");
    let names: Vec<&str> = systems.iter().map(|l| l[1].as_str()).collect();
    assert_eq!(
        names,
        [
            "ORB-SLAM2",
            "StaticFusion",
            "ReFusion",
            "YOLO-SLAM",
            "SG-SLAM",
            "published method",
            "Stillpoint, bonn",
            "Stillpoint, bonn_calibrated"
        ]
    );
    assert_eq!(systems[1][2..4], ["3586.0", "-"]);
    assert_eq!(systems[5][2..4], ["19.0", "9.0"]);
    let report = json(&out);
    let cases = row(&report, "crowd")["cases"].as_array().unwrap();
    let [nominal, calibrated] = [&cases[0], &cases[1]];
    // A single run cannot be compared.
    assert_eq!(nominal["figures"]["identical"], Value::Null);
    assert_eq!(nominal["runs"][0]["input"]["layout"], "Bonn");
    let rpe = figure(nominal, "rpe_translation", "rmse");
    assert!(rpe < 0.04 && figure(nominal, "rpe_rotation_deg", "rmse") < 2.0);
    let ate = figure(nominal, "ate", "rmse");
    assert!(ate < 0.02, "{ate}");
    // The room was recorded with the nominal factor: with the other one everything is 5.9 % too large.
    let large = figure(calibrated, "rpe_translation", "rmse");
    assert!(large > 2.0 * rpe, "{large} {rpe}");
    // Control: the marker's own poses do not fit.
    let estimate = out.join("runs/crowd-bonn-as-set-1/trajectory.txt");
    let output = program()
        .args(["eval", "--json"])
        .args([&file, &estimate])
        .output()
        .unwrap();
    check(&output, 0, &[]);
    let marker: Value = serde_json::from_slice(&output.stdout).unwrap();
    let marker = marker["rpe"]["translation"]["rmse"].as_f64().unwrap();
    assert!(marker > 5.0 * rpe, "{marker} {rpe}");

    // A camera given by the user is the only one.
    let out = dir.path().join("named");
    let more = ["--runs", "1", "--camera", "bonn", "--max-frames", "5"];
    check(&suite("bonn", dir.path(), &out, &more), 0, &[]);
    assert_eq!(
        row(&json(&out), "crowd")["cases"].as_array().unwrap().len(),
        1
    );
}

/// The pose that the data set would state for a camera: `T_ros T T_m^-1 T_ros`, the inverse of the published conversion `T = T_ros T_gt
/// T_ros T_m` (`T_ros` is its own inverse), with the rotation in `T_m`.
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
fn invalid_suite_input_is_reported_before_any_run() {
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
