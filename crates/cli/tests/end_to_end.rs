//! The main use on simulated data: results are complete, correct, and identical to the byte every time.

use crate::common::{check, copy, files, isolated, program, simulate, stderr, stdout};
#[cfg(unix)]
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;
use stillpoint_testdata::ate::{self, Figures};
use tempfile::TempDir;

/// Enough for several keyframes, bundle adjustments and culling.
const FRAMES: usize = 90;
/// Stamps of colour and depth drift against each other as those of a real camera, so that association may leave a frame out.
const LEAST: usize = FRAMES - 2;

static ROOM: LazyLock<TempDir> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    simulate(&dir.path().join("room"), "halfsphere", FRAMES);
    dir
});

fn room() -> PathBuf {
    ROOM.path().join("room")
}

/// Runs the data set; returns the trajectory files and the map as bytes.
fn trajectories(mut command: Command, out: &Path) -> [Vec<u8>; 4] {
    let map = out.with_extension("spmap");
    let output = command
        .args(["-q", "run"])
        .arg(room())
        .arg("--out")
        .arg(out)
        .arg("--save-map")
        .arg(&map)
        .output()
        .unwrap();
    check(&output, 0, &[]);
    [
        out.join("trajectory.txt"),
        out.join("trajectory_online.txt"),
        out.join("keyframes.txt"),
        map,
    ]
    .map(|path| std::fs::read(path).unwrap())
}

#[test]
fn same_command_gives_identical_trajectories() {
    let dir = tempfile::tempdir().unwrap();
    let first = trajectories(program(), &dir.path().join("first"));
    let poses = String::from_utf8_lossy(&first[0]).lines().count() - 1;
    assert!(poses >= LEAST, "{poses} poses of {FRAMES} frames");
    let keyframes = String::from_utf8_lossy(&first[2]).lines().count();
    assert!(
        keyframes > 3,
        "{keyframes} lines: too few keyframes to test mapping"
    );

    let mut shared = program();
    shared.env("STILLPOINT_WORKERS", "3");
    let again = trajectories(shared, &dir.path().join("again"));
    assert!(
        first == again,
        "a second run, whose work three threads share, differs"
    );

    let mut scalar = program();
    scalar
        .env("STILLPOINT_SIMD", "scalar")
        .env("STILLPOINT_WORKERS", "1");
    let scalar = trajectories(scalar, &dir.path().join("scalar"));
    assert!(first == scalar, "the scalar kernels differ");
    let summary = std::fs::read_to_string(dir.path().join("scalar/summary.json")).unwrap();
    assert!(summary.contains("\"simd\": \"scalar\""), "{summary}");

    let works = Command::new("taskset").args(["-c", "0", "true"]).status();
    if !works.is_ok_and(|s| s.success()) {
        stillpoint_testdata::skipped("there is no taskset to pin a run to one core");
        return;
    }
    let mut pinned = isolated(Command::new("taskset"));
    pinned.args(["-c", "0", env!("CARGO_BIN_EXE_stillpoint")]);
    let pinned = trajectories(pinned, &dir.path().join("pinned"));
    assert!(first == pinned, "a run pinned to one core differs");
}

#[test]
fn result_is_complete_and_accurate() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("result");
    trajectories(program(), &out);
    let names: Vec<String> = files(&out)
        .iter()
        .map(|p| p.file_name().unwrap().to_str().unwrap().to_owned())
        .collect();
    assert_eq!(
        names,
        [
            "config.toml",
            "frames.csv",
            "keyframes.txt",
            "plot.png",
            "plot.svg",
            "report.html",
            "run.log",
            "summary.json",
            "timing.png",
            "timing.svg",
            "trajectory.txt",
            "trajectory_covariance.txt",
            "trajectory_covariance_in_map.txt",
            "trajectory_online.txt"
        ]
    );
    // A line of 22 numbers per pose, with its stamp.
    let lines = |name: &str| -> Vec<Vec<String>> {
        let text = std::fs::read_to_string(out.join(name)).unwrap();
        let lines = text.lines().filter(|l| !l.starts_with('#'));
        lines
            .map(|l| l.split(' ').map(str::to_owned).collect())
            .collect()
    };
    let poses = lines("trajectory.txt");
    for name in [
        "trajectory_covariance.txt",
        "trajectory_covariance_in_map.txt",
    ] {
        let covariances = lines(name);
        assert!(covariances.iter().all(|l| l.len() == 22), "{name}");
        let stamps = |of: &[Vec<String>]| of.iter().map(|l| l[0].clone()).collect::<Vec<_>>();
        assert_eq!(stamps(&covariances), stamps(&poses));
    }
    let summary: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("summary.json")).unwrap()).unwrap();
    assert!(summary["frames"].as_u64().unwrap() >= LEAST as u64);
    assert_eq!(summary["tracked"], summary["frames"]);
    let frames = summary["frames"].as_u64().unwrap() as usize;
    for poses in ["final", "online"] {
        let ate = summary["accuracy"][poses]["ate"]["rmse"].as_f64().unwrap();
        let sequence = format!("sim:halfsphere {FRAMES} frames as JPEG {poses}");
        let found = Figures::all_posed(1e3 * ate, frames);
        ate::hold(&sequence, "none", "default", found);
        assert_eq!(summary["accuracy"][poses]["pairs"], summary["frames"]);
    }
    let stages = summary["timing_ms"].as_array().unwrap();
    for name in [
        "total", "frame", "extract", "match", "pose", "map", "refine",
    ] {
        let stage = stages.iter().find(|s| s["stage"] == name);
        let stage = stage.unwrap_or_else(|| panic!("no stage {name}"));
        assert!(stage["median"].as_f64().unwrap() > 0.0, "{stage}");
    }
    // `eval` gives the score of the summary.
    let output = program()
        .arg("eval")
        .arg(room().join("groundtruth.txt"))
        .arg(out.join("trajectory.txt"))
        .arg("--json")
        .output()
        .unwrap();
    let score: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    let (a, b) = (
        &score["ate"]["rmse"],
        &summary["accuracy"]["final"]["ate"]["rmse"],
    );
    assert!((a.as_f64().unwrap() - b.as_f64().unwrap()).abs() < 1e-6);
    // The resolved configuration reproduces the run.
    let config = out.join("config.toml");
    let output = program()
        .args(["config", "print", "--config"])
        .arg(&config)
        .output()
        .unwrap();
    assert_eq!(stdout(&output), std::fs::read_to_string(config).unwrap());
}

#[test]
fn without_ground_truth_everything_else_works() {
    let dir = tempfile::tempdir().unwrap();
    copy(&room(), &dir.path().join("room"));
    std::fs::remove_file(dir.path().join("room/groundtruth.txt")).unwrap();
    let out = dir.path().join("out");
    let output = program()
        .arg("run")
        .arg(dir.path().join("room"))
        .arg("--out")
        .arg(&out)
        .args(["--start", "10", "--max-frames", "20"])
        .output()
        .unwrap();
    check(&output, 0, &[]);
    assert!(stdout(&output).contains("20 of 20 frames tracked"));
    assert!(!stdout(&output).contains("ATE"));
    assert!(out.join("plot.svg").exists());
}

/// With --json, stdout holds only the summary, at any verbosity.
#[test]
fn json_option_prints_only_the_summary() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    for quiet in [&[][..], &["-q"], &["-v"]] {
        let output = program()
            .args(quiet)
            .arg("run")
            .arg(room())
            .args(["--max-frames", "12", "--json", "--out"])
            .arg(&out)
            .arg("--verdicts")
            .arg(dir.path().join("v.csv"))
            .output()
            .unwrap();
        check(&output, 0, &[]);
        let summary = std::fs::read(out.join("summary.json")).unwrap();
        assert!(output.stdout == summary, "{}", stdout(&output));
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(json["tracked"], 12);
    }
}

#[test]
fn stage_times_are_shown_only_if_verbose() {
    let dir = tempfile::tempdir().unwrap();
    let run = |more: &[&str]| {
        let mut command = program();
        command.args(more).arg("run").arg(room()).arg("--out");
        command.arg(dir.path().join("out"));
        let output = command.args(["--max-frames", "12"]).output().unwrap();
        check(&output, 0, &[]);
        stdout(&output)
    };
    let (short, long) = (run(&[]), run(&["-v"]));
    assert!(short.lines().count() < 12, "{short}");
    assert!(
        short.contains("final: ATE") && !short.contains("filter "),
        "{short}"
    );
    assert!(
        long.contains("online: ATE") && long.contains("filter "),
        "{long}"
    );
}

#[test]
fn run_output_is_short_and_verbose_output_detailed() {
    let dir = tempfile::tempdir().unwrap();
    let run = |more: &[&str]| {
        let mut command = program();
        command.args(more).arg("run").arg(room()).arg("--out");
        command.arg(dir.path().join("out"));
        let output = command.args(["--max-frames", "30", "--dense"]).output();
        let output = output.unwrap();
        check(&output, 0, &[]);
        format!("{}{}", stderr(&output), stdout(&output))
    };
    let lines = |text: &str| text.lines().filter(|l| !l.trim().is_empty()).count();
    let (short, words, all) = (run(&[]), run(&["-v"]), run(&["-vv"]));
    assert!(lines(&short) <= 10, "{short}");
    assert!(
        !short.contains("mapped") && !short.contains("memory"),
        "{short}"
    );
    assert!(
        words.contains("\nmapped keyframe 0: 1 keyframe, "),
        "{words}"
    );
    assert!(
        !words.contains("debug:") && !words.contains(" { "),
        "{words}"
    );
    // The peak memory is printed once.
    assert_eq!(words.matches("peak memory").count(), 1, "{words}");
    assert!(
        all.contains("debug: mapped report=MappingReport {"),
        "{all}"
    );
    assert!(all.contains("trace: tracked"), "{all}");
}

#[test]
fn bench_reports_every_run() {
    let dir = tempfile::tempdir().unwrap();
    let output = program()
        .arg("bench")
        .arg(room())
        .args(["--runs", "2", "--max-frames", "30", "--out"])
        .arg(dir.path())
        .output()
        .unwrap();
    check(&output, 0, &["room: run 1 of 2", "room: run 2 of 2"]);
    let markdown = std::fs::read_to_string(dir.path().join("bench.md")).unwrap();
    assert!(stdout(&output).contains(&markdown));
    assert!(
        markdown.contains("| room ") && markdown.contains("100.0 / 100.0"),
        "{markdown}"
    );
    let json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(dir.path().join("bench.json")).unwrap()).unwrap();
    let sequence = &json["sequences"][0];
    assert_eq!(sequence["runs"].as_array().unwrap().len(), 2);
    assert_eq!(sequence["identical"], true);
    let worst = sequence["ate_rmse"]["worst"].as_f64().unwrap();
    let name = "sim:halfsphere 30 frames as JPEG";
    let found = Figures::all_posed(1e3 * worst, 30);
    ate::hold(name, "none", "default", found);
    assert!(json["machine"]["cores"].as_u64().unwrap() > 0);
}

/// Ctrl-C ends the run after the current frame, and its results are written.
#[test]
#[cfg(unix)]
fn interrupted_demo_keeps_its_results() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let mut child = program()
        .args(["-v", "demo", "--frames", "100000", "--out"])
        .arg(&out)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap());
    // Once the first keyframe is in the map there is something to write.
    let mut line = String::new();
    while !line.contains("mapped") {
        line.clear();
        assert!(said.read_line(&mut line).unwrap() > 0, "the program ended");
    }
    let kill = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    assert!(kill.unwrap().success());
    let mut rest = String::new();
    said.read_to_string(&mut rest).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(1), "{rest}");
    assert!(rest.contains("interrupted after"), "{rest}");
    let out = out.join("off");
    let trajectory = std::fs::read_to_string(out.join("trajectory.txt")).unwrap();
    assert!(trajectory.lines().count() > 1, "{trajectory}");
    let summary = std::fs::read_to_string(out.join("summary.json")).unwrap();
    assert!(summary.contains("\"interrupted\": true"), "{summary}");
}
