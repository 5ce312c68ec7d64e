//! Compares the figures in README with those of `demo`, stored in `docs/images/demo.json` with the picture that shows them. After an
//! intended change, renew both by `STILLPOINT_BLESS=1 cargo test -p stillpoint-cli --test all readme`, and then README's table.

use crate::common::{check, program, stdout};
use serde_json::{Value, json};
use std::path::PathBuf;
use stillpoint::datasets::trajectory;
use stillpoint::evaluation::{EvalOptions, Score, TimedPose, score};
use stillpoint::simulator::{Simulator, SimulatorConfig};

/// Rows of the demo's table that are the same on every machine.
const ROWS: [&str; 6] = [
    "ATE RMSE (mm)",
    "ATE SD (mm)",
    "largest ATE (mm)",
    "frames with a pose",
    "keypoints rejected",
    "landmarks",
];
/// ORB-SLAM3's trajectory on the frames of the demo (`simulate --scene walking_xyz --frames 300`, pyorbslam3 0.1.1), which is not
/// reproducible.
const PEER: &str = "docs/images/orbslam3.txt";
const BLESS: &str = "STILLPOINT_BLESS=1 cargo test -p stillpoint-cli --test all readme";

/// The name of a row, and its figures with the filter off and on.
type Row = [String; 3];

fn root(name: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "../..", name].iter().collect()
}

/// The cells of a line: separated by bars in Markdown, by wide gaps in printed tables.
fn cells(line: &str) -> Vec<String> {
    let plain = |cell: &str| cell.trim().replace(['*', '`'], "");
    match line.trim().strip_prefix('|') {
        Some(rest) => rest.trim_end_matches('|').split('|').map(plain).collect(),
        None => line
            .split("  ")
            .map(plain)
            .filter(|c| !c.is_empty())
            .collect(),
    }
}

/// The rows of the first table whose head names both passes, printed or in Markdown.
fn rows(text: &str) -> Vec<Row> {
    let is_head = |line: &&str| {
        let cells: Vec<String> = cells(line).into_iter().filter(|c| !c.is_empty()).collect();
        cells == ["filter off", "filter on"]
    };
    let lines = text.lines().skip_while(|l| !is_head(l)).skip(1);
    let rule = |line: &&str| line.trim().starts_with('|') && !line.contains(char::is_alphanumeric);
    lines
        .skip_while(rule)
        .map_while(|line| cells(line).try_into().ok())
        .collect()
}

fn quoted(text: &str) -> Vec<&str> {
    let lines = text.lines().map(str::trim);
    let ends = |l: &&str| l.starts_with("filter off: ") || l.starts_with("filter on: ");
    lines.filter(ends).collect()
}

fn wrong(text: &str, golden: &Value) -> Vec<String> {
    let known: Vec<Row> = serde_json::from_value(golden["rows"].clone()).unwrap();
    let said: Vec<String> = serde_json::from_value(golden["errors"].clone()).unwrap();
    let (found, lines) = (rows(text), quoted(text));
    let mut wrong = Vec::new();
    if !found.iter().any(|r| r[0] == ROWS[0]) && lines.len() < 2 {
        wrong.push(format!(
            "expected a table with the head \"| | filter off | filter on |\" and a row \"{}\", or both lines \"filter off: ...\" and \"filter on: ...\" of the demo",
            ROWS[0]
        ));
    }
    for row in found.iter().filter(|r| !known.contains(r)) {
        wrong.push(format!("{row:?} is none of {known:?}"));
    }
    for line in lines.iter().filter(|l| !said.iter().any(|s| s == *l)) {
        wrong.push(format!("{line:?} is none of {said:?}"));
    }
    wrong
}

/// The error of another system on the frames of the demo, from its trajectory file, mm.
fn error_of(file: &str) -> String {
    let config = SimulatorConfig {
        scene: "walking_xyz".to_owned(),
        frames: Some(300),
        ..SimulatorConfig::default()
    };
    let pose = |(stamp, world_from_camera)| TimedPose {
        stamp,
        world_from_camera,
    };
    let truth = Simulator::new(&config).unwrap().ground_truth();
    let truth: Vec<TimedPose> = truth.into_iter().map(pose).collect();
    let poses = trajectory::read(&root(file)).unwrap().into_iter();
    let poses: Vec<TimedPose> = poses
        .map(|p| pose((p.stamp, p.world_from_camera)))
        .collect();
    match score(&truth, &poses, &EvalOptions::default()).unwrap() {
        Score::Moving(e) => format!("{:.1}", e.ate.statistics.rmse * 1e3),
        Score::Fixed(_) => panic!("the camera moves"),
    }
}

#[test]
fn readme_figures_match_the_demo() {
    let dir = tempfile::tempdir().unwrap();
    let mut demo = program();
    demo.args(["-v", "demo", "--out"]).arg(dir.path());
    let output = demo.output().unwrap();
    check(&output, 0, &[]);
    let text = stdout(&output);
    let stable = |row: &Row| ROWS.contains(&&*row[0]);
    let printed: Vec<Row> = rows(&text).into_iter().filter(stable).collect();
    assert_eq!(printed.len(), ROWS.len(), "{text}");
    let found = json!({
        "command": "stillpoint demo -v",
        "errors": quoted(&text),
        "rows": printed,
        "ORB-SLAM3": error_of(PEER),
    });
    let (file, picture) = (root("docs/images/demo.json"), root("docs/images/demo.webp"));
    if std::env::var_os("STILLPOINT_BLESS").is_some() {
        let json = serde_json::to_string_pretty(&found).unwrap();
        std::fs::write(&file, json + "\n").unwrap();
        let also = format!("ORB-SLAM3={}", root(PEER).display());
        let mut render = program();
        render.arg("render").arg(dir.path()).arg("-o").arg(&picture);
        check(&render.args(["--also", &also]).output().unwrap(), 0, &[]);
    }
    let golden = std::fs::read_to_string(&file).unwrap_or_default();
    let golden: Value = serde_json::from_str(&golden).unwrap_or_default();
    assert_eq!(
        found, golden,
        "the demo gives other figures; if that is intended, renew them: {BLESS}"
    );
    let size = std::fs::metadata(&picture).unwrap().len();
    assert!((10_000..3_000_000).contains(&size), "{size}");
    let readme = std::fs::read_to_string(root("README.md")).unwrap();
    let wrong = wrong(&readme, &golden);
    assert!(wrong.is_empty(), "README.md: {wrong:#?}");
}

#[test]
fn deviating_readme_figures_are_detected() {
    let golden = json!({
        "rows": [["ATE RMSE (mm)", "27.1", "1.0"], ["frames with a pose", "300 of 300", "300 of 300"]],
        "errors": ["filter off: ATE 27.1 mm", "filter on: ATE 1.0 mm"],
    });
    let table = "text\n| | filter off | filter on |\n|---|---:|---:|\n| ATE RMSE (mm) | 27.1 | **1.0** |\n\n| other | 3 | 4 |\n";
    let block = "```\n                      filter off   filter on\nATE RMSE (mm)               27.1         1.0\nframes with a pose    300 of 300  300 of 300\n```\n";
    let lines = "```\nfilter off: ATE 27.1 mm\nfilter on: ATE 1.0 mm\n```\n";
    for text in [table, block, lines] {
        assert_eq!(wrong(text, &golden), Vec::<String>::new());
        assert!(!wrong(&text.replace("27.1", "27.2"), &golden).is_empty());
        assert!(!wrong(&text.replace("1.0", "0.9"), &golden).is_empty());
    }
    assert!(!wrong("no table", &golden).is_empty());
    assert!(!wrong(&table.replace("ATE RMSE", "speed"), &golden).is_empty());
}

fn peers(text: &str) -> Vec<&str> {
    let table = text.lines().map(str::trim).filter(|l| l.starts_with('|'));
    let rows = table.skip_while(|l| !l.contains("ms per frame"));
    rows.take_while(|l| !l.is_empty()).take(5).collect()
}

#[test]
fn readme_comparison_matches_the_evidence() {
    let read = |name: &str| std::fs::read_to_string(root(name)).unwrap();
    let (readme, measured) = (read("README.md"), read("docs/evidence/peers.md"));
    let table = peers(&readme);
    assert!(
        table.len() == 5 && table[3].contains("ORB-SLAM3"),
        "{table:?}"
    );
    assert_eq!(
        table,
        peers(&measured),
        "README.md and docs/evidence/peers.md differ; `lab peers --document` keeps the runs, `lab document` writes both tables"
    );
    // Control: a changed figure is detected.
    assert_ne!(
        peers(&readme.replacen("ms per frame", "ms per frame, once", 1)),
        table
    );
}
