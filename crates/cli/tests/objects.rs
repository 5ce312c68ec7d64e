//! `run --objects`, then `eval --objects`.

use crate::common::{check, program, simulate, stdout, stillpoint};
use serde_json::Value;
use std::path::Path;

/// The score of `eval --objects` for tracks and boxes, with further arguments.
fn score(tracks: &Path, boxes: &Path, arguments: &[&str]) -> Value {
    let output = program()
        .args(["eval", "--json"])
        .args(arguments)
        .arg("--objects")
        .args([tracks, boxes])
        .output()
        .unwrap();
    check(&output, 0, &[]);
    let json: Value = serde_json::from_str(&stdout(&output)).unwrap();
    // With trajectories the score is a part of the output.
    json.get("objects").unwrap_or(&json)["score"].clone()
}

fn number(score: &Value, name: &str) -> f64 {
    let found = score[name].as_f64();
    found.unwrap_or_else(|| panic!("no {name} in {score}"))
}

/// The table with a new id for each object after a stamp, as from a tracker that loses its identities.
fn forgetful(table: &str, after: f64) -> String {
    let mut lines: Vec<String> = Vec::new();
    for line in table.lines() {
        let cells: Vec<&str> = line.split(',').collect();
        match cells[0].parse::<f64>() {
            Ok(stamp) if stamp > after => {
                let id: u32 = cells[1].parse().unwrap();
                lines.push(format!("{stamp:.6},{},{}", id + 100, cells[2..].join(",")));
            }
            _ => lines.push(line.to_owned()),
        }
    }
    lines.join("\n")
}

#[test]
fn tracked_people_are_scored_against_boxes() {
    let dir = tempfile::tempdir().unwrap();
    let (scene, out) = (dir.path().join("scene"), dir.path().join("out"));
    simulate(&scene, "walking_xyz", 90);
    let tracks = dir.path().join("objects.csv");
    let output = program()
        .args(["-q", "run"])
        .arg(&scene)
        .arg("--detector")
        .arg(format!(
            "scripted:{}",
            scene.join("detections.csv").display()
        ))
        .arg("--objects")
        .arg(&tracks)
        .arg("--out")
        .arg(&out)
        .output()
        .unwrap();
    check(&output, 0, &[]);
    let boxes = scene.join("boxes.csv");
    let good = score(&tracks, &boxes, &[]);
    assert!(number(&good, "mota") > 0.8, "{good}");
    assert!(number(&good, "idf1") > 0.85, "{good}");
    assert!(number(&good, "hota") > 0.6, "{good}");
    assert_eq!(number(&good, "id_switches"), 0.0, "{good}");
    // Speeds need no trajectory; positions in the boxes' world do.
    assert!(number(&good, "speed_error_median") < 0.2, "{good}");
    assert!(good["position_error_median"].is_null(), "{good}");
    let truth = scene.join("groundtruth.txt");
    let found = out.join("trajectory.txt");
    let both = [truth.to_str().unwrap(), found.to_str().unwrap()];
    let placed = score(&tracks, &boxes, &both);
    assert!(number(&placed, "position_error_median") < 0.4, "{placed}");
    assert_eq!(placed["mota"], good["mota"]);

    // Control: new ids half-way leave the boxes equal, and change the identities.
    let worse = dir.path().join("forgetful.csv");
    let table = std::fs::read_to_string(&tracks).unwrap();
    // An object that was seen once may be a false alarm, and has no row.
    assert!(table.contains(",confirmed,") && !table.contains(",tentative,"));
    std::fs::write(&worse, forgetful(&table, 1.8)).unwrap();
    let worse = score(&worse, &boxes, &[]);
    assert_eq!(worse["right"], good["right"]);
    assert!(number(&worse, "id_switches") >= 1.0, "{worse}");
    assert!(
        number(&worse, "idf1") < number(&good, "idf1") - 0.1,
        "{worse}"
    );
    assert!(
        number(&worse, "hota") < number(&good, "hota") - 0.05,
        "{worse}"
    );

    // If everything is ignored, nothing is wrong; missing figures are reported.
    let none = score(&tracks, &boxes, &["--min-visible", "1e9"]);
    assert_eq!(number(&none, "truth_ids"), 0.0, "{none}");
    let missing = dir.path().join("nothing.csv");
    let arguments = ["eval", "--objects", missing.to_str().unwrap()];
    check(
        &stillpoint(arguments),
        2,
        &["--objects TRACKS.csv", "nothing.csv"],
    );
}
