//! Replays reproduce runs from their logs.

use super::{PLAYED, check_ran, write_all};
use crate::common::{check, files, program, stdout};
use serde_json::Value;
use std::ffi::OsString;
use std::path::PathBuf;

#[test]
fn live_run_replays_byte_for_byte() {
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
        "trajectory_covariance.txt",
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
    // At least one image and the animation.
    assert!(pictures("live").len() > 1);
    assert!(pictures("live") == pictures("again"), "pictures differ");
    // Counts are equal, and only a live run has latencies.
    let [live, again] = ["live", "again"].map(|n| played.json(&format!("{n}/summary.json")));
    for counts in [
        "frames", "tracked", "detector", "features", "loops", "submaps",
    ] {
        assert_eq!(live[counts], again[counts], "{counts}");
    }
    assert_eq!(live["detector"]["kind"], "scripted");
    assert_eq!(again["live"], Value::Null);
    // Mapping steps are counted in the same way, with or without a thread of their own.
    let steps = |summary: &Value| {
        let stages = summary["timing_ms"].as_array().unwrap().clone();
        let map = stages.into_iter().find(|s| s["stage"] == "map");
        map.unwrap()["n"].as_u64().unwrap()
    };
    assert!(steps(&live) > 1);
    assert_eq!(steps(&live), steps(&again));
}

#[test]
fn inline_run_replays_byte_for_byte() {
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
fn localizing_live_run_replays() {
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
