//! `bench --ablation` on a simulated scene and on folders.

use crate::common::{check, copy, files, program, simulate, stdout};
use serde_json::Value;
use std::path::Path;
use std::process::Output;

fn ablation(path: &str, out: &Path, more: &[&str]) -> Output {
    program()
        .args(["bench", "--ablation", path, "--out"])
        .arg(out)
        .args(more)
        .output()
        .unwrap()
}

fn json(out: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(out.join("ablation.json")).unwrap()).unwrap()
}

/// The lines of the printed tables that begin with a sequence's name, as cells.
fn lines(text: &str, name: &str) -> Vec<Vec<String>> {
    let lines = text
        .lines()
        .filter(|l| l.starts_with(&format!("| {name} ")));
    lines
        .map(|l| {
            l.trim_matches('|')
                .split('|')
                .map(|c| c.trim().to_owned())
                .collect()
        })
        .collect()
}

fn labels(report: &Value) -> Vec<&str> {
    let variants = report["sequences"][0]["variants"].as_array().unwrap();
    variants
        .iter()
        .map(|v| v["variant"].as_str().unwrap())
        .collect()
}

#[test]
fn ablation_runs_six_configurations_of_a_scene() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let frames = ["--runs", "2", "--max-frames", "8", "--seed", "5"];
    let output = ablation("sim:walking_xyz", &out, &frames);
    check(
        &output,
        0,
        &["simulating scene walking_xyz, seed 5", "O+G+D, seed 6"],
    );

    let text = stdout(&output);
    assert_eq!(std::fs::read_to_string(out.join("ablation.md")).unwrap(), {
        let end = text.find("\nwritten to").unwrap();
        text[..end].to_owned()
    });
    assert!(text.contains("2 seeds each (5 to 6)"), "{text}");
    assert!(text.contains("30 % of the people missed"), "{text}");
    let ours = lines(&text, "sim:walking_xyz");
    // The overview, then a line per configuration.
    assert_eq!(ours.len(), 7, "{text}");
    assert_eq!(ours[0].len(), 7, "{text}");
    let published = lines(&text, "walking_xyz as published");
    assert_eq!(
        published[0][1..],
        ["952.8", "16.2", "321.1", "17.8", "15.1", ""]
    );

    assert!(
        text.contains("Table 5 of [1]") && text.contains("10.1007/s11554-024-01527-4"),
        "{text}"
    );

    let report = json(&out);
    assert_eq!(
        labels(&report),
        ["none", "O", "G", "O+G", "O+G+D", "default"]
    );
    assert_eq!(report["seeds"], serde_json::json!([5, 6]));
    let row = &report["sequences"][0];
    for (variant, line) in row["variants"].as_array().unwrap().iter().zip(&ours[1..]) {
        let runs = variant["runs"].as_array().unwrap();
        assert_eq!(runs.len(), 2, "{variant}");
        assert_eq!(runs[0]["frames"], 8);
        assert_eq!(runs[0]["detector"]["kind"], "scripted");
        let figures = &variant["figures"];
        let error = |s: &str| figures["ate"][s]["median"].as_f64().unwrap() * 1e3;
        assert!(
            0.0 < error("sd") && error("sd") < error("rmse"),
            "{figures}"
        );
        assert_eq!(line[1], variant["variant"].as_str().unwrap());
        assert_eq!(line[5], format!("{:.1}", error("sd")));
    }
    // Each run uses its configuration.
    let rejected = |k: usize| row["variants"][k]["rejected"].as_f64().unwrap();
    assert_eq!(rejected(0), 0.0);
    for k in [1, 3, 4, 5] {
        assert!(rejected(k) > 0.0, "configuration {k} rejected nothing");
    }
    assert!(rejected(1) > rejected(2), "boxes reject more than lines");
    assert!(text.contains("the seed changes nothing for none"), "{text}");
    let config =
        std::fs::read_to_string(out.join("runs/sim_walking_xyz-O+G-2/config.toml")).unwrap();
    for line in ["seed = 6", "preset = \"paper\"", "parts = \"O+G\""] {
        assert!(
            config.lines().any(|l| l.trim() == line),
            "{line} not in {config}"
        );
    }
    // The simulated frames were removed.
    let names: Vec<String> = files(&out)
        .iter()
        .map(|p| p.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    assert_eq!(names, ["ablation.json", "ablation.md", "runs"]);
}

#[test]
fn ablation_handles_missing_detectors_and_broken_folders() {
    let dir = tempfile::tempdir().unwrap();
    let room = dir.path().join("rgbd_dataset_freiburg3_walking_rpy");
    simulate(&room, "walking_rpy", 8);
    let broken = dir.path().join("broken");
    copy(&room, &broken);
    std::fs::write(broken.join("rgb.txt"), "1.0 rgb/a.png\nnonsense\n").unwrap();
    let out = dir.path().join("out");
    let broken = broken.to_str().unwrap();
    let more = [room.to_str().unwrap(), "--runs", "1"];
    let output = ablation(broken, &out, &more);
    check(&output, 1, &["broken: none: run failed", "rgb.txt:2"]);
    let text = stdout(&output);
    assert_eq!(lines(&text, "broken")[0][1], "failed", "{text}");
    assert!(
        text.contains("without a detector O, O+G and O+G+D are"),
        "{text}"
    );
    let report = json(&out);
    assert_eq!(labels(&report), ["none", "G", "default"]);
    let row = &report["sequences"][1];
    assert_eq!(row["published"]["ate"][1], 0.0434);
    assert_eq!(row["variants"][2]["figures"]["tracked"]["worst"], 1.0);

    // With the script in the folder.
    let out = dir.path().join("scripted");
    let script = ["--runs", "1", "--detector", "scripted:{}/detections.csv"];
    check(&ablation(room.to_str().unwrap(), &out, &script), 0, &[]);
    let report = json(&out);
    assert_eq!(labels(&report).len(), 6);
    let runs = &report["sequences"][0]["variants"][1]["runs"];
    let script = room.join("detections.csv");
    assert_eq!(runs[0]["detector"]["name"], script.to_str().unwrap());
}

#[test]
fn invalid_input_is_reported_before_any_run() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let output = ablation("sim:walking_xy", &out, &[]);
    check(&output, 2, &["did you mean \"walking_xyz\"?"]);
    check(&ablation("/no/such", &out, &[]), 2, &["found nothing"]);
    let twice = ["--set", "static_filter.preset=of"];
    check(
        &ablation("sim:xyz", &out, &twice),
        2,
        &["static_filter.preset"],
    );
    assert!(!out.exists());
}

#[test]
fn bench_runs_simulated_scenes() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let output = program()
        .args(["bench", "sim:xyz", "sim:walking_static", "--runs", "1"])
        .args(["--max-frames", "4", "--out"])
        .arg(&out)
        .output()
        .unwrap();
    check(&output, 0, &["sim:walking_static: run 1 of 1"]);
    let report = std::fs::read(out.join("bench.json")).unwrap();
    let report: Value = serde_json::from_slice(&report).unwrap();
    for (k, scene, detector) in [
        (0, "sim:xyz", "none"),
        (1, "sim:walking_static", "scripted"),
    ] {
        let sequence = &report["sequences"][k];
        assert_eq!(
            (&sequence["name"], &sequence["path"]),
            (&scene.into(), &scene.into())
        );
        assert_eq!(sequence["runs"][0]["detector"]["kind"], detector);
    }
}
