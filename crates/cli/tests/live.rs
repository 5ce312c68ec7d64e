//! Data sets played as a camera: results that are complete, logs from which they come out again to the byte, and what is said when
//! a log does not fit.

use crate::common::{check, copy, files, program, simulate, stderr, stdout};
use serde_json::Value;
use std::collections::BTreeSet;
use std::ffi::OsString;
#[cfg(unix)]
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;
use stillpoint::slam::{LogEntry, RunLog};
use tempfile::TempDir;

const FRAMES: usize = 24;

/// A room with people, and a live run in it with everything that can be written.
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

/// Runs a command with everything that can be written, as files beside the folder `name`.
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

    /// Replays a text as the log of this run.
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

/// How well a run went depends on what else the machine does; that it went does not.
#[track_caller]
fn check_ran(output: &Output) {
    let said = stderr(output);
    assert!(matches!(output.status.code(), Some(0 | 1)), "{said}");
    assert!(!said.contains("panicked"), "{said}");
}

#[test]
fn a_live_run_comes_out_again_to_the_byte() {
    let played = &*PLAYED;
    check_ran(&played.output);
    let mut again = program();
    again.arg("replay").arg(played.path("live/run.log"));
    again.arg(played.path("room"));
    let again = write_all(again, played.dir.path(), "again");
    check(&again, played.output.status.code().unwrap(), &[]);
    assert!(stdout(&again).contains("the trajectory is that of the run, bit for bit"));
    let mut json = program();
    json.arg("replay").arg(played.path("live/run.log"));
    json.arg(played.path("room")).arg("--json").arg("--out");
    let json = json.arg(played.path("json")).output().unwrap();
    check(
        &json,
        played.output.status.code().unwrap(),
        &["bit for bit"],
    );
    let summary = std::fs::read(played.path("json/summary.json")).unwrap();
    assert!(json.stdout == summary, "{}", stdout(&json));
    for name in [
        "trajectory.txt",
        "trajectory_online.txt",
        "keyframes.txt",
        "frames.csv",
        "config.toml",
        "run.log",
    ] {
        let of = |folder: &str| std::fs::read(played.path(&format!("{folder}/{name}"))).unwrap();
        assert!(!of("live").is_empty(), "{name} is empty");
        assert!(of("live") == of("again"), "{name} differs");
    }
    for file in ["spmap", "csv"] {
        let of = |name: &str| std::fs::read(played.path(&format!("{name}.{file}"))).unwrap();
        assert!(of("live") == of("again"), "{file} differs");
    }
    let pictures = |name: &str| -> Vec<(OsString, Vec<u8>)> {
        let all = files(&played.path(&format!("{name}_pictures")));
        let named = |p: PathBuf| (p.file_name().unwrap().into(), std::fs::read(p).unwrap());
        all.into_iter().map(named).collect()
    };
    // One, and the animation, at least.
    assert!(pictures("live").len() > 1);
    assert!(pictures("live") == pictures("again"), "pictures differ");
    // What was counted is the same, and only a live run has latencies.
    let [live, again] = ["live", "again"].map(|n| played.json(&format!("{n}/summary.json")));
    for counts in [
        "frames", "tracked", "detector", "features", "loops", "submaps",
    ] {
        assert_eq!(live[counts], again[counts], "{counts}");
    }
    assert_eq!(live["detector"]["kind"], "scripted");
    assert_eq!(again["live"], Value::Null);
    // Steps of mapping are counted alike, whether they have a thread of their own or not.
    let steps = |summary: &Value| {
        let stages = summary["timing_ms"].as_array().unwrap().clone();
        let map = stages.into_iter().find(|s| s["stage"] == "map");
        map.unwrap()["n"].as_u64().unwrap()
    };
    assert!(steps(&live) > 1);
    assert_eq!(steps(&live), steps(&again));
}

#[test]
fn a_run_in_one_thread_leaves_a_log_and_comes_out_again_to_the_byte() {
    let dir = tempfile::tempdir().unwrap();
    let detector = format!("scripted:{}", PLAYED.path("room/detections.csv").display());
    let mut run = program();
    run.arg("run").arg(PLAYED.path("room"));
    run.args(["--detector", &detector, "--start", "3"]);
    for delay in ["detector=3", "mapper=2", "loop_closer=4"] {
        run.arg("--set").arg(format!("schedule.{delay}"));
    }
    check_ran(&write_all(run, dir.path(), "inline"));
    let mut again = program();
    again.arg("replay").arg(dir.path().join("inline/run.log"));
    again.arg(PLAYED.path("room"));
    let again = write_all(again, dir.path(), "again");
    check_ran(&again);
    assert!(stdout(&again).contains("the trajectory is that of the run, bit for bit"));
    let same = |a: &str, b: &str| {
        let of = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
        assert!(!of(a).is_empty(), "{a} is empty");
        assert!(of(a) == of(b), "{a} and {b} differ");
    };
    for name in ["trajectory.txt", "frames.csv", "keyframes.txt", "run.log"] {
        same(&format!("inline/{name}"), &format!("again/{name}"));
    }
    same("inline.spmap", "again.spmap");
    same("inline.csv", "again.csv");
    let pictures = files(&dir.path().join("inline_pictures"));
    assert!(pictures.len() > 2);
    for picture in pictures {
        let name = picture.file_name().unwrap().to_str().unwrap().to_owned();
        same(
            &format!("inline_pictures/{name}"),
            &format!("again_pictures/{name}"),
        );
    }
}

#[test]
fn a_live_run_says_what_was_measured() {
    let summary = PLAYED.json("live/summary.json");
    let live = &summary["live"];
    let number = |v: &Value| v.as_f64().unwrap_or_else(|| panic!("{v} in {live}"));
    let frames = number(&summary["frames"]);
    assert!(frames > 0.0);
    assert_eq!(number(&live["arrived"]), frames + number(&live["dropped"]));
    assert_eq!(number(&live["latency_ms"]["n"]), frames);
    let latency = &live["latency_ms"];
    assert!(number(&latency["median"]) > 0.0);
    assert!(number(&latency["median"]) <= number(&latency["p95"]));
    assert!(number(&latency["p99"]) <= number(&latency["max"]));
    assert!(number(&live["waited_ms"]["median"]) <= number(&latency["median"]));
    for thread in ["tracking", "detection", "mapping", "looping"] {
        assert_eq!(live["threads"][thread], "finished");
    }
    for listener in ["tally", "verdicts", "trace"] {
        assert_eq!(live["subscribers"][listener]["events"], 0, "{listener}");
    }
    let said = stdout(&PLAYED.output);
    for part in [
        "latency",
        "- waited",
        "frames dropped",
        "detections per second",
    ] {
        assert!(said.contains(part), "{said}");
    }
    // A camera takes its time: the frames are 1/30 s apart.
    assert!(number(&summary["seconds"]) > 0.9 * (FRAMES - 3) as f64 / 30.0);
}

/// Every thread of a trace has a name, and what it did is where it should be.
#[track_caller]
fn check_trace(trace: &Value, expected: &[(&str, &str)]) {
    let events = trace["traceEvents"].as_array().unwrap();
    let named = |e: &&Value| e["ph"] == "M" && e["name"] == "thread_name";
    let name_of = |tid: &Value| {
        let name = events.iter().filter(named).find(|e| e["tid"] == *tid);
        name.unwrap_or_else(|| panic!("thread {tid} has no name"))["args"]["name"].clone()
    };
    let mut did = BTreeSet::new();
    for span in events.iter().filter(|e| e["ph"] == "X") {
        assert!(span["ts"].as_f64().unwrap() >= 0.0, "{span}");
        assert!(span["dur"].as_f64().unwrap() >= 0.0, "{span}");
        let name = span["name"].as_str().unwrap().to_owned();
        did.insert((name_of(&span["tid"]).as_str().unwrap().to_owned(), name));
    }
    for (thread, span) in expected {
        let wanted = ((*thread).to_owned(), (*span).to_owned());
        assert!(did.contains(&wanted), "no {span} in {thread}: {did:?}");
    }
    assert_eq!(trace["otherData"]["left_out"], 0);
}

#[test]
fn a_trace_shows_what_every_thread_did() {
    check_trace(
        &PLAYED.json("live.json"),
        &[
            ("main", "wait"),
            ("read-ahead", "read"),
            ("tracking", "frame"),
            ("detection", "detect"),
            ("mapping", "map"),
        ],
    );
    let dir = tempfile::tempdir().unwrap();
    let mut inline = program();
    inline.arg("run").arg(PLAYED.path("room"));
    inline.args(["--max-frames", "3", "--detector", "none"]);
    check(&write_all(inline, dir.path(), "inline"), 0, &[]);
    let trace = std::fs::read(dir.path().join("inline.json")).unwrap();
    check_trace(
        &serde_json::from_slice(&trace).unwrap(),
        &[("main", "total"), ("main", "map"), ("read-ahead", "read")],
    );
}

#[test]
fn a_run_that_goes_on_with_a_map_and_drops_no_frame_is_replayed_too() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("elsewhere.log");
    let mut run = program();
    run.arg("run").arg(PLAYED.path("room"));
    run.arg("--localize").arg(PLAYED.path("live.spmap"));
    run.args(["--live=all", "--detector", "none", "--start", "2"]);
    run.args(["--max-frames", "12", "--seed", "5", "--log"])
        .arg(&log);
    run.arg("--out").arg(dir.path().join("live"));
    let live = run.output().unwrap();
    check_ran(&live);
    assert!(!dir.path().join("live/run.log").exists());
    let summary = std::fs::read(dir.path().join("live/summary.json")).unwrap();
    let summary: Value = serde_json::from_slice(&summary).unwrap();
    assert_eq!(summary["live"]["dropped"], 0);
    assert_eq!(summary["live"]["frames"], "all");
    assert_eq!(summary["frames"], 12);
    let mut again = program();
    again.arg("replay").arg(&log).arg(PLAYED.path("room"));
    again.arg("--out").arg(dir.path().join("again"));
    let again = again.output().unwrap();
    check(
        &again,
        live.status.code().unwrap(),
        &["finding the camera in"],
    );
    assert!(stdout(&again).contains("bit for bit"), "{}", stdout(&again));
}

#[test]
fn a_log_that_does_not_fit_is_refused() {
    let log = PLAYED.log();
    let changed = |change: &dyn Fn(&mut RunLog)| {
        let mut log = log.clone();
        change(&mut log);
        log.to_text()
    };
    // Everything but its result is that of the run.
    let other = changed(&|log| log.trajectory ^= 1);
    check(
        &PLAYED.replay(&other, &[]),
        1,
        &["changed.log: expected the trajectory", "another"],
    );
    let late = changed(&|log| {
        for entry in &mut log.entries {
            if let LogEntry::TrackFrame { stamp, .. } = entry {
                *stamp += 0.5;
            }
        }
    });
    check(
        &PLAYED.replay(&late, &[]),
        2,
        &["changed.log: entry 0: expected frame"],
    );
    let text = log.to_text();
    let refused = |text: &str, more: &[&str], part: &str| {
        check(
            &PLAYED.replay(text, more),
            2,
            &["changed.log", "expected", "found", part],
        );
    };
    refused(&text, &["--seed", "9"], "configuration");
    refused(&text, &["--camera", "tum_fr1"], "camera");
    refused(&text[..text.len() / 2], &[], "line ");
    refused(&text.replacen("frame ", "fame ", 1), &[], "line ");
    refused(
        "fx = 525\n",
        &[],
        "line 1: expected \"stillpoint run log 1\"",
    );
    refused(
        &changed(&|log| log.about = "start = true".into()),
        &[],
        "description of the run",
    );
    refused(
        &changed(&|log| log.about = log.about.replacen("min_inliers", "min_inlier", 1)),
        &[],
        "known key",
    );
    let missing = program()
        .args(["replay", "/no/run.log", "room"])
        .output()
        .unwrap();
    check(&missing, 2, &["/no/run.log: expected the log of a run"]);
}

#[test]
fn options_of_live_runs_are_checked() {
    let run = |more: &[&str]| {
        let mut run = program();
        run.arg("run").arg(PLAYED.path("room")).args(more);
        run.output().unwrap()
    };
    check(&run(&["--live=some"]), 2, &["some"]);
    let room = PLAYED.path("room");
    let room = room.to_str().unwrap();
    check(&run(&["--live", "--log", room]), 2, &["another with --log"]);
    check(&run(&["--trace", room]), 2, &["another with --trace"]);
}

/// Ctrl-C ends the run soon, and all that was found until then is there, the log too.
#[test]
#[cfg(unix)]
fn an_interrupt_keeps_what_there_is() {
    let dir = tempfile::tempdir().unwrap();
    let room = dir.path().join("room");
    copy(&PLAYED.path("room"), &room);
    // A camera that takes a frame per second, so that there is time to interrupt it.
    for list in ["rgb.txt", "depth.txt"] {
        let text = std::fs::read_to_string(room.join(list)).unwrap();
        let slower = |line: &str| match line.split_once(' ') {
            Some((stamp, name)) if !line.starts_with('#') => {
                let stamp: f64 = stamp.parse().unwrap();
                let frame = (stamp * 30.0 + 1e-3).floor();
                format!("{:.6} {name}\n", stamp + frame * (1.0 - 1.0 / 30.0))
            }
            _ => format!("{line}\n"),
        };
        let text: String = text.lines().map(slower).collect();
        std::fs::write(room.join(list), text).unwrap();
    }
    let out = dir.path().join("out");
    let trace = dir.path().join("trace.json");
    let mut child = program()
        .arg("-v")
        .arg("run")
        .arg(&room)
        .args(["--live", "--detector", "none", "--out"])
        .arg(&out)
        .arg("--trace")
        .arg(&trace)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap());
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
    let summary = std::fs::read(out.join("summary.json")).unwrap();
    let summary: Value = serde_json::from_slice(&summary).unwrap();
    assert_eq!(summary["interrupted"], true);
    assert!(summary["frames"].as_u64().unwrap() < FRAMES as u64 / 2);
    let trace: Value = serde_json::from_slice(&std::fs::read(trace).unwrap()).unwrap();
    check_trace(&trace, &[("tracking", "frame"), ("mapping", "map")]);
    let again = program()
        .arg("replay")
        .arg(out.join("run.log"))
        .arg(&room)
        .arg("--out")
        .arg(dir.path().join("again"))
        .output()
        .unwrap();
    assert!(stdout(&again).contains("bit for bit"), "{}", stderr(&again));
}
