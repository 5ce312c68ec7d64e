//! `batch` on simulated rooms: results, skipping, retries, and merging.

use crate::common::{check, program, simulate, stderr, stdout, stillpoint};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::LazyLock;
use tempfile::TempDir;

/// Five rooms of a few frames each: `a` to `e`.
static ROOMS: LazyLock<TempDir> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    for (name, scene, frames) in [
        ("a", "xyz", 6),
        ("b", "halfsphere", 8),
        ("c", "walking_xyz", 10),
        ("d", "xyz", 4),
        ("e", "rpy", 5),
    ] {
        simulate(&dir.path().join(name), scene, frames);
    }
    dir
});

pub(crate) fn rooms() -> &'static Path {
    ROOMS.path()
}

/// A batch over inputs, without a detector unless `more` names one.
pub(crate) fn batch(inputs: &[PathBuf], out: &Path, more: &[&str]) -> Output {
    program()
        .arg("batch")
        .args(inputs)
        .arg("--out")
        .arg(out)
        .args(more)
        .output()
        .unwrap()
}

pub(crate) fn table(out: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(out.join("batch.json")).unwrap()).unwrap()
}

pub(crate) fn row<'a>(table: &'a Value, name: &str) -> &'a Value {
    let rows = table["recordings"].as_array().unwrap();
    let row = rows.iter().find(|r| r["name"] == name);
    row.unwrap_or_else(|| panic!("no {name} in {table}"))
}

fn trajectory(out: &Path) -> Vec<u8> {
    std::fs::read(out.join("trajectory.txt")).unwrap()
}

#[test]
fn batch_equals_single_runs_and_skips_finished_ones() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let mcap = dir.path().join("walk.mcap");
    let convert = program()
        .args(["-q", "recording", "convert"])
        .args([&rooms().join("d"), &mcap])
        .output()
        .unwrap();
    check(&convert, 0, &[]);
    let list = dir.path().join("list.txt");
    let lines = format!("# rooms\n\n{}/[ab]\n", rooms().display());
    std::fs::write(&list, lines).unwrap();
    let inputs = [format!("@{}", list.display()).into(), mcap.clone()];
    let options = ["--workers", "2", "--save-map", "map.spmap", "--seed", "3"];
    let first = batch(&inputs, &out, &options);
    check(
        &first,
        0,
        &[
            "2 workers on",
            "for 3 recordings",
            "GB each at most",
            "[3/3]",
        ],
    );
    let shown = stdout(&first);
    for part in ["recording", "a ", "b ", "walk ", "ok", "written to"] {
        assert!(shown.contains(part), "{shown}");
    }
    for (name, path) in [
        ("a", rooms().join("a")),
        ("b", rooms().join("b")),
        ("walk", mcap),
    ] {
        let alone = dir.path().join("alone");
        let run = program()
            .args(["-q", "run", "--seed", "3"])
            .arg(path)
            .arg("--out")
            .arg(&alone)
            .output()
            .unwrap();
        check(&run, 0, &[]);
        assert_eq!(trajectory(&out.join(name)), trajectory(&alone), "{name}");
        for file in ["report.html", "summary.json", "map.spmap", "stderr.log"] {
            assert!(out.join(name).join(file).is_file(), "{name}/{file}");
        }
    }
    let json = table(&out);
    assert_eq!(json["is_complete"], true);
    let a = row(&json, "a");
    assert_eq!(
        (&a["outcome"], &a["frames"], &a["attempts"]),
        (&"ok".into(), &6.into(), &1.into())
    );
    assert!(a["ate_rmse"].as_f64().unwrap() < 0.05, "{a}");
    let parquet = std::fs::read(out.join("batch.parquet")).unwrap();
    assert!(parquet.starts_with(b"PAR1") && parquet.ends_with(b"PAR1"));
    let page = std::fs::read_to_string(out.join("batch.html")).unwrap();
    assert!(page.contains("href=\"walk/report.html\""), "{page}");

    // The second time nothing is run.
    let time = |name: &str| {
        std::fs::metadata(out.join(name).join("summary.json"))
            .unwrap()
            .modified()
            .unwrap()
    };
    let before = time("a");
    let again = batch(&inputs, &out, &options);
    check(&again, 0, &["3 of 3 recordings skipped"]);
    assert_eq!(time("a"), before);
    assert_eq!(table(&out)["skipped"], 3);
    assert_eq!(table(&out)["recordings"], json["recordings"]);
}

#[test]
fn only_changed_recordings_are_rerun_on_request() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let inputs: Vec<PathBuf> = ["a", "d"].map(|n| dir.path().join(n)).into();
    for (path, name) in inputs.iter().zip(["a", "d"]) {
        crate::common::copy(&rooms().join(name), path);
    }
    check(&batch(&inputs, &out, &[]), 0, &[]);
    std::fs::remove_file(dir.path().join("d/groundtruth.txt")).unwrap();
    let again = batch(&inputs, &out, &[]);
    check(
        &again,
        0,
        &[
            "1 of 2 recordings skipped",
            "1 recording run again: the recording changed",
        ],
    );
    assert_eq!(row(&table(&out), "d")["ate_rmse"], Value::Null);
    // Another configuration, and a result of another program.
    let other = ["--set", "tracking.min_inliers=31"];
    let before = trajectory(&out.join("a"));
    let refused = batch(&inputs, &out, &other);
    check(
        &refused,
        2,
        &["found one of another configuration", "--out", "--replace"],
    );
    let file = out.join("a/recording.json");
    let text = std::fs::read_to_string(&file).unwrap();
    let mut old: Value = serde_json::from_str(&text).unwrap();
    old["program_sha256"] = "0".into();
    old["stillpoint"] = "0.0.1".into();
    std::fs::write(&file, old.to_string()).unwrap();
    let refused = batch(&inputs, &out, &[]);
    check(
        &refused,
        2,
        &["another program (Stillpoint 0.0.1; this is", "--replace"],
    );
    assert_eq!(trajectory(&out.join("a")), before);
    let replaced = batch(&inputs, &out, &["--replace"]);
    check(
        &replaced,
        0,
        &[
            "1 recording run again: the result is of another program",
            "1 of 2 recordings skipped",
        ],
    );
}

#[test]
fn options_reach_the_runs_with_per_recording_detectors() {
    let dir = tempfile::tempdir().unwrap();
    let options = [
        "--detector",
        "scripted:{}/detections.csv",
        "--max-frames",
        "7",
        "--no-report",
        "--json",
    ];
    let output = batch(&[rooms().join("c")], dir.path(), &options);
    check(&output, 0, &[]);
    let printed: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(printed, table(dir.path()));
    let summary = std::fs::read_to_string(dir.path().join("c/summary.json")).unwrap();
    let summary: Value = serde_json::from_str(&summary).unwrap();
    assert_eq!(summary["frames"], 7);
    assert!(
        summary["detector"].to_string().contains("scripted"),
        "{}",
        summary["detector"]
    );
    assert!(!dir.path().join("c/report.html").exists());
}

#[test]
fn failed_recordings_are_retried_without_affecting_others() {
    let dir = tempfile::tempdir().unwrap();
    let empty = dir.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    let broken = dir.path().join("broken.mcap");
    std::fs::write(&broken, b"no recording").unwrap();
    let out = dir.path().join("out");
    let inputs = [
        rooms().join("a"),
        empty,
        broken,
        dir.path().join("gone"),
        rooms().join("d"),
    ];
    let output = batch(&inputs, &out, &[]);
    check(
        &output,
        1,
        &[
            "empty: failed, tried again later",
            "broken: failed, tried again later",
            "empty: failed, after 2 runs",
            "gone: failed: ",
            "3 recordings of 5 without a result: broken, empty, gone",
        ],
    );
    let json = table(&out);
    assert_eq!(row(&json, "empty")["attempts"], 2);
    assert!(
        row(&json, "broken")["error"]
            .as_str()
            .unwrap()
            .contains("broken.mcap")
    );
    for name in ["a", "d"] {
        assert_eq!(row(&json, name)["outcome"], "ok");
    }
    let page = std::fs::read_to_string(out.join("batch.html")).unwrap();
    assert!(page.find("empty/stderr.log").unwrap() < page.find("a/report.html").unwrap());
    // Only failures are run again.
    let again = batch(&inputs[..4], &out, &[]);
    check(&again, 1, &["1 of 4 recordings skipped"]);

    let late = batch(
        &[rooms().join("c")],
        &dir.path().join("late"),
        &["--time-limit", "0.02"],
    );
    check(
        &late,
        1,
        &["c: failed, after 2 runs: took longer than 0.02 s"],
    );
}

#[test]
fn shards_are_joined() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = [rooms().join("*")];
    let shards = [1, 2].map(|i| dir.path().join(format!("{i}")));
    for (i, out) in shards.iter().enumerate() {
        let shard = format!("{}/2", i + 1);
        check(&batch(&inputs, out, &["--shard", &shard]), 0, &[]);
    }
    let all = dir.path().join("all");
    let merge = |folders: &[PathBuf]| {
        let mut command = program();
        command.args(["batch", "merge"]).args(folders);
        command.arg("--out").arg(&all).output().unwrap()
    };
    check(&merge(&shards[..1]), 1, &["shards that are missing: 2"]);
    check(&merge(&shards), 0, &[]);
    let json = table(&all);
    let rows = json["recordings"].as_array().unwrap();
    let names: Vec<&str> = rows.iter().map(|r| r["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["a", "b", "c", "d", "e"]);
    for row in rows {
        let report = all
            .join(row["folder"].as_str().unwrap())
            .join("report.html");
        assert!(report.is_file(), "{}", report.display());
    }
    check(
        &merge(&[shards[0].clone(), shards[0].clone()]),
        2,
        &["name each batch once"],
    );
    let into = stillpoint([
        Path::new("batch"),
        Path::new("merge"),
        &shards[0],
        Path::new("--out"),
        &shards[1],
    ]);
    check(
        &into,
        2,
        &["expected a folder without the table of a batch"],
    );
    assert!(stderr(&merge(&[dir.path().to_owned()])).contains("expected the table of a batch"));
}
