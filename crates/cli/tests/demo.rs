//! `demo`: a simulated scene without and with the static filter, side by side.

use crate::common::{check, files, program, stdout};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn demo(out: &Path, more: &[&str]) -> Output {
    demo_of(program(), out, more)
}

fn demo_of(mut command: Command, out: &Path, more: &[&str]) -> Output {
    command
        .args(["-v", "demo", "--frames", "20", "--out"])
        .arg(out);
    command.args(more).output().unwrap()
}

fn text_of(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn summary(out: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(out.join("summary.json")).unwrap()).unwrap()
}

/// The figures of a printed row: filter off, filter on.
fn row<'a>(text: &'a str, name: &str) -> [&'a str; 2] {
    let line = text.lines().find(|l| l.starts_with(name));
    let line = line.unwrap_or_else(|| panic!("no row {name} in {text}"));
    let cells: Vec<&str> = line[name.len()..].split("  ").map(str::trim).collect();
    let cells: Vec<&str> = cells.into_iter().filter(|c| !c.is_empty()).collect();
    cells.try_into().unwrap()
}

#[test]
fn demo_writes_both_passes_side_by_side() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("demo");
    let output = demo(&out, &[]);
    let said = [
        "simulating scene walking_xyz: 20 frames",
        "30 % of the people missed",
    ];
    check(&output, 0, &said);
    let text = stdout(&output);
    assert!(text.contains("within its bound of 10 mm"), "{text}");
    assert!(text.contains("of the keypoints on people"), "{text}");
    assert_eq!(row(&text, "frames with a pose"), ["20 of 20", "20 of 20"]);

    let (off, on) = (summary(&out.join("off")), summary(&out.join("on")));
    let ate = |s: &Value| {
        let rmse = s["accuracy"]["final"]["ate"]["rmse"].as_f64().unwrap();
        format!("{:.1}", rmse * 1e3)
    };
    assert_eq!(row(&text, "ATE RMSE (mm)"), [ate(&off), ate(&on)]);
    assert_eq!(off["features"]["dynamic"], 0);
    assert!(on["features"]["dynamic"].as_u64().unwrap() > 0, "{on}");
    assert!(on["detector"]["detections"].as_u64().unwrap() > 0, "{on}");
    // The times are those of one pass each.
    for s in [&off, &on] {
        let stages = s["timing_ms"].as_array().unwrap();
        let total = stages.iter().find(|s| s["stage"] == "total").unwrap();
        assert_eq!(total["n"], 20);
    }
    for (pass, preset) in [("off", "off"), ("on", "default")] {
        let config = std::fs::read_to_string(out.join(pass).join("config.toml")).unwrap();
        assert!(
            config.contains(&format!("preset = \"{preset}\"")),
            "{config}"
        );
    }
    for name in ["comparison.png", "side_by_side.png"] {
        let image = image::open(out.join(name)).unwrap();
        assert!(image.width() > 600, "{name}");
    }
    let animation = std::fs::read(out.join("animation.gif")).unwrap();
    assert!(animation.starts_with(b"GIF89a"));
    let names: Vec<String> = files(&out)
        .iter()
        .map(|p| p.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    let pictures = [
        "animation.gif",
        "comparison.png",
        "comparison.svg",
        "demo.webp",
    ];
    assert_eq!(names[..4], pictures);
    assert_eq!(names[4..], ["off", "on", "side_by_side.png"]);
    assert!(out.join("on").join("mesh.ply").exists());
    // `render` can remake it from the demo's results.
    let again = dir.path().join("again.webp");
    let output = crate::common::stillpoint(["render", text_of(&out), "-o", text_of(&again)]);
    check(&output, 0, &[]);
    let read = |path: &Path| std::fs::read(path).unwrap();
    assert!(read(&again) == read(&out.join("demo.webp")));
}

#[test]
fn demo_is_deterministic_without_a_detector() {
    let dir = tempfile::tempdir().unwrap();
    let pictures = |name: &str, program: Command| {
        let out = dir.path().join(name);
        let scene = ["--detector", "none", "--scene", "walking_rpy"];
        let output = demo_of(program, &out, &scene);
        check(&output, 0, &["detections: none"]);
        assert!(stdout(&output).contains("bound of 15 mm"));
        assert_eq!(summary(&out.join("on"))["detector"]["kind"], "none");
        [
            "animation.gif",
            "demo.webp",
            "side_by_side.png",
            "comparison.svg",
            "on/trajectory.txt",
        ]
        .map(|f| std::fs::read(out.join(f)).unwrap())
    };
    // Renders anew, not from the cached scenes.
    let mut renders = program();
    renders.env_remove("STILLPOINT_SCENES");
    assert!(pictures("first", program()) == pictures("second", renders));
}

#[test]
fn demo_exceeding_its_error_bound_fails() {
    let dir = tempfile::tempdir().unwrap();
    // Tracking always fails with these few keypoints.
    let few = [
        "--set",
        "features.features=100",
        "--set",
        "tracking.min_inliers=100",
    ];
    let output = demo(&dir.path().join("demo"), &few);
    check(
        &output,
        1,
        &["has no score", "20 of 20 frames have no pose"],
    );
    let off = ["--set", "static_filter.preset=off"];
    let output = demo(&dir.path().join("off"), &off);
    check(&output, 2, &["compares the filter with none"]);
    assert!(!dir.path().join("off").exists());
    check(
        &demo(dir.path(), &["--scene", "walking"]),
        2,
        &["did you mean"],
    );
}
