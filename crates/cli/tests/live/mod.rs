//! Data sets played as a camera: complete results, logs that reproduce them to the byte, and errors for logs that do not match.

mod log;
mod measured;
mod replay;

use crate::common::{check, program, simulate, stderr};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;
use std::time::Instant;
use stillpoint::slam::RunLog;
use tempfile::TempDir;

const FRAMES: usize = 24;

/// A room with people, and a live run in it with all outputs.
struct Played {
    dir: TempDir,
    output: Output,
}

static PLAYED: LazyLock<Played> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    let room = dir.path().join("room");
    simulate(&room, "walking_xyz", FRAMES);
    let detector = format!("scripted:{}/detections.csv", room.display());
    let mut run = program();
    run.arg("run").arg(&room).arg("--live");
    run.args(["-v", "--detector", &detector]);
    let output = write_all(run, dir.path(), "live");
    Played { dir, output }
});

/// Runs a command with all outputs, written beside the folder `name`.
fn write_all(mut command: Command, dir: &Path, name: &str) -> Output {
    for (option, file) in [
        ("--out", name.to_owned()),
        ("--save-map", format!("{name}.spmap")),
        ("--verdicts", format!("{name}.csv")),
        ("--trace", format!("{name}.json")),
        ("--overlay", format!("{name}_pictures")),
    ] {
        command.arg(option).arg(dir.join(file));
    }
    command.args(["--overlay-every", "6"]).output().unwrap()
}

impl Played {
    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&std::fs::read(self.path(name)).unwrap()).unwrap()
    }

    fn log(&self) -> RunLog {
        RunLog::from_bytes(&std::fs::read(self.path("live/run.log")).unwrap()).unwrap()
    }

    fn replay(&self, log: &str, more: &[&str]) -> Output {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("changed.log");
        std::fs::write(&path, log).unwrap();
        let mut command = program();
        command.arg("replay").arg(path).arg(self.path("room"));
        let out = dir.path().join("out");
        command.args(more).arg("--out").arg(out).output().unwrap()
    }
}

/// Lost frames depend on the load of the machine, so that only success or exit code 1 is required.
#[track_caller]
fn check_ran(output: &Output) {
    let said = stderr(output);
    assert!(matches!(output.status.code(), Some(0 | 1)), "{said}");
    assert!(!said.contains("panicked"), "{said}");
}

#[test]
fn live_file_plays_a_folder_as_a_camera() {
    let out = PLAYED.path("live_file");
    let mut live = program();
    live.args(["live", "file"]).arg(PLAYED.path("room"));
    live.args(["--all", "--json", "--out"]).arg(&out);
    let started = Instant::now();
    let output = live.output().unwrap();
    check_ran(&output);
    // Each frame arrives at least an interval after the previous one; without pacing the run could be shorter.
    let shown: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(shown["frames"], FRAMES, "{shown}");
    assert_eq!(shown["live"]["dropped"], 0, "{shown}");
    let seconds = (FRAMES - 1) as f64 / 30.0;
    assert!(started.elapsed().as_secs_f64() > seconds);
    let log = RunLog::from_bytes(&std::fs::read(out.join("run.log")).unwrap());
    assert!(log.is_ok());
    let nothing = program().args(["live", "file", "/no/room"]).output();
    check(&nothing.unwrap(), 2, &["/no/room"]);
}

/// Without a camera or its library the message says how to get them.
#[test]
fn missing_camera_library_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let text = dir.path().join("librealsense2.so");
    std::fs::write(&text, "not a library").unwrap();
    let gone = dir.path().join("gone");
    let taken = dir.path().join("taken.mcap");
    std::fs::write(&taken, "mine").unwrap();
    let live = |library: &std::path::Path, more: &[&str]| {
        let mut live = program();
        live.args(["live", "realsense"])
            .args(more)
            .current_dir(&dir);
        live.env("STILLPOINT_REALSENSE", library).output().unwrap()
    };
    let advice = [
        "expected librealsense 2.50 or later",
        "STILLPOINT_REALSENSE",
    ];
    check(&live(&text, &[]), 2, &advice);
    check(&live(&gone, &[]), 2, &["no such file", "gone"]);
    // A folder without the library.
    std::fs::create_dir(&gone).unwrap();
    check(&live(&gone, &[]), 2, &["ros-$ROS_DISTRO-librealsense2"]);
    check(
        &live(&text, &["--size", "3x3"]),
        2,
        &["expected width x height"],
    );
    check(
        &live(&text, &["--exposure-ms", "0"]),
        2,
        &["expected 0.1 to 1000"],
    );
    check(
        &live(&text, &["--record", "taken.mcap"]),
        2,
        &["expected a new file"],
    );
    assert_eq!(std::fs::read(&taken).unwrap(), b"mine");
}
