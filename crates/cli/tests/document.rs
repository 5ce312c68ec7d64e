//! `bench --document` on one scene and one folder, as the project's own benchmarks are made.

use crate::common::{check, program, simulate, stdout, stillpoint};
use serde_json::Value;

/// The part of a document below a heading.
fn part<'a>(text: &'a str, heading: &str) -> &'a str {
    let from = text
        .find(&format!("## {heading}\n"))
        .unwrap_or_else(|| panic!("no {heading} in {text}"));
    let part = &text[from + 3..];
    part.split("\n## ").next().unwrap()
}

#[test]
fn a_document_holds_what_was_measured_and_how() {
    let dir = tempfile::tempdir().unwrap();
    // Peers are shown beside the recording of this name.
    let recording = dir.path().join("kitchen");
    simulate(&recording, "halfsphere", 40);
    let out = dir.path().join("out");
    let output = program()
        .args(["bench", "--document"])
        .arg(&recording)
        .args(["sim:walking_static", "--runs", "1", "--max-frames", "90"])
        .args(["--detector", "none", "--opencv-ms", "4.9", "--out"])
        .arg(&out)
        .output()
        .unwrap();
    check(&output, 0, &["sim:walking_static: O+G+D, seed 0"]);
    let text = std::fs::read_to_string(out.join("benchmarks.md")).unwrap();
    assert!(stdout(&output).starts_with(&text), "{text}");
    for line in [
        "stillpoint bench --document",
        "| commit | ",
        "| date | 20",
        "took 4.90 ms on this machine",
    ] {
        assert!(text.contains(line), "{line} not in {text}");
    }
    // The scene has the simulator's detections, the recording has none.
    let accuracy = part(&text, "Accuracy");
    let cells = |name: &str| {
        let line = accuracy
            .lines()
            .find(|l| l.starts_with(&format!("| {name} ")));
        let cells = line.unwrap().trim_matches('|').split('|');
        cells.map(|c| c.trim().to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(cells("kitchen")[4], "-");
    // Somebody walks past, and takes the camera along unless the filter is on.
    let [off, on] = [2, 4].map(|k| cells("sim:walking_static")[k].parse::<f64>().unwrap());
    assert!(on < off, "{accuracy}");
    assert!(accuracy.contains("Detector none: kitchen"), "{accuracy}");
    let ablation = part(&text, "Ablation of the static filter");
    assert!(
        ablation.contains("| walking_static as published |") && ablation.contains("Table 5 of [1]")
    );
    // Nothing moves in the recording.
    assert!(!ablation.contains("| kitchen"), "{ablation}");
    assert_eq!(
        part(&text, "Time and memory")
            .matches("\n| kitchen ")
            .count(),
        2
    );
    let peers = part(&text, "Other systems on the same recordings");
    assert!(
        peers.contains("SG-SLAM") && !peers.contains("fr1_xyz"),
        "{peers}"
    );
    let json: Value =
        serde_json::from_slice(&std::fs::read(out.join("benchmarks.json")).unwrap()).unwrap();
    assert!(json["unit_ms"][1].as_f64().unwrap() > 0.0);
    assert_eq!(
        json["sequences"][1]["row"]["variants"]
            .as_array()
            .unwrap()
            .len(),
        7
    );
    // Not by what is lost in printing: the unrounded errors are far apart.
    let variants = json["sequences"][1]["row"]["variants"].as_array().unwrap();
    let rmse = |name: &str| {
        let found = variants.iter().find(|v| v["variant"] == name).unwrap();
        found["figures"]["ate"]["rmse"]["median"].as_f64().unwrap()
    };
    let (off, on) = (rmse("none"), rmse("default"));
    assert!(on < off / 4.0, "filter off {off} m, on {on} m");
}

#[test]
fn what_cannot_be_measured_is_said_before_anything_runs() {
    for (arguments, part) in [
        (vec!["--document", "--ablation"], "cannot be used with"),
        (vec!["--document", "/no/such"], "found nothing"),
        (vec!["--document", "--opencv-ms", "0"], "above 0"),
        (vec!["sim:xyz", "--opencv-ms", "5"], "--document"),
    ] {
        check(&stillpoint([vec!["bench"], arguments].concat()), 2, &[part]);
    }
}
