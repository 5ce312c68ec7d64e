//! Measurements of live runs: figures, traces, and results after an interrupt.

use super::{FRAMES, PLAYED, write_all};
use crate::common::{check, copy, program, stderr, stdout};
use serde_json::Value;
use std::collections::BTreeSet;
#[cfg(unix)]
use std::io::{BufRead, BufReader, Read};
use std::process::Command;

#[test]
fn live_run_reports_its_measurements() {
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
    // Frames are 1/30 s apart.
    assert!(number(&summary["seconds"]) > 0.9 * (FRAMES - 3) as f64 / 30.0);
}

/// Checks that every thread of a trace has a name, and has the expected spans.
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
fn trace_contains_the_spans_of_every_thread() {
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
#[cfg(unix)]
fn interrupted_live_run_keeps_its_results() {
    let dir = tempfile::tempdir().unwrap();
    let room = dir.path().join("room");
    copy(&PLAYED.path("room"), &room);
    // A camera with one frame per second, to allow time for the interrupt.
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
