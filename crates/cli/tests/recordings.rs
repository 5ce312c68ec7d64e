//! Recordings: converted, cut, run, and refused.

use crate::common::{check, simulate, stderr, stdout, stillpoint};
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::LazyLock;
use tempfile::TempDir;

const FRAMES: usize = 12;

/// A data set folder, and the same as MCAP.
struct Pair {
    dir: TempDir,
    folder: PathBuf,
    file: PathBuf,
}

static PAIR: LazyLock<Pair> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    let (folder, file) = (dir.path().join("desk"), dir.path().join("desk.mcap"));
    simulate(&folder, "halfsphere", FRAMES);
    let output = stillpoint(["recording", "convert", text(&folder), text(&file)]);
    writes(&output, FRAMES);
    Pair { dir, folder, file }
});

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[track_caller]
fn writes(output: &Output, frames: usize) {
    check(output, 0, &[]);
    let said = stdout(output);
    assert!(said.contains(&format!(": {frames} frames, ")), "{said}");
}

fn run(path: &Path) -> (String, String) {
    let (trajectory, _, said) = run_with(path, &[]);
    (trajectory, said)
}

/// Runs an input with more options: trajectory, `summary.json`, and output.
fn run_with(path: &Path, more: &[&str]) -> (String, serde_json::Value, String) {
    let out = tempfile::tempdir().unwrap();
    let target = out.path().join("out");
    let args = [
        "run",
        text(path),
        "--detector",
        "none",
        "--out",
        text(&target),
    ];
    let output = stillpoint(args.iter().chain(more));
    check(&output, 0, &[]);
    let trajectory = std::fs::read_to_string(target.join("trajectory.txt"));
    let summary = std::fs::read(target.join("summary.json")).unwrap();
    let summary = serde_json::from_slice(&summary).unwrap();
    (trajectory.unwrap(), summary, stderr(&output))
}

fn info(path: &Path) -> serde_json::Value {
    let output = stillpoint(["recording", "info", "--json", text(path)]);
    check(&output, 0, &[]);
    serde_json::from_str(&stdout(&output)).unwrap()
}

#[test]
fn converted_recording_runs_like_its_folder() {
    let (of_folder, _) = run(&PAIR.folder);
    let (of_file, _) = run(&PAIR.file);
    assert!(of_folder.lines().count() >= FRAMES, "{of_folder}");
    assert_eq!(of_folder, of_file);
}

/// Asserts that two trajectories are equal up to the rounding of sample stamps to nanoseconds.
#[track_caller]
fn is_near(a: &str, b: &str) {
    assert_eq!(a.lines().count(), b.lines().count());
    let numbers = |text: &str| -> Vec<f64> {
        let words = text.split_whitespace().filter_map(|w| w.parse().ok());
        words.collect()
    };
    let (a, b) = (numbers(a), numbers(b));
    assert!(a.len() == b.len() && a.len() > 8);
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-6));
}

#[test]
fn inertial_samples_are_converted_and_cut() {
    let out = tempfile::tempdir().unwrap();
    let [folder, file, back, cut] =
        ["a", "a.mcap", "b", "cut.mcap"].map(|name| out.path().join(name));
    check(
        &stillpoint([
            "-q",
            "simulate",
            "--scene",
            "blocked_turn",
            "--imu",
            "--jpeg",
            "--frames",
            "20",
            "--out",
            text(&folder),
        ]),
        0,
        &[],
    );
    let samples = |output: &Output| -> usize {
        let said = stdout(output);
        let part = said
            .split(", ")
            .find(|p| p.contains(" samples of an inertial sensor"));
        part.unwrap().split(' ').next().unwrap().parse().unwrap()
    };
    for (from, to) in [(&folder, &file), (&file, &back)] {
        let output = stillpoint(["recording", "convert", text(from), text(to)]);
        writes(&output, 20);
        // 200 Hz over 19 intervals of frames, and one after them.
        assert!((120..150).contains(&samples(&output)));
    }
    let (expected, summary, _) = run_with(&folder, &[]);
    assert!(summary["inertial"]["state"].is_string(), "{summary}");
    for path in [&file, &back] {
        let (trajectory, found, said) = run_with(path, &[]);
        is_near(&trajectory, &expected);
        assert_eq!(
            found["inertial"]["state"], summary["inertial"]["state"],
            "{said}"
        );
        // Stamps of recordings are whole nanoseconds.
        let bias = |v: &serde_json::Value| v["inertial"]["gyro_bias"][0].as_f64().unwrap();
        assert!((bias(&found) - bias(&summary)).abs() < 1e-7, "{found}");
    }
    let named = run_with(&file, &["--imu-topic", "/camera/imu"]);
    assert_eq!(named.0, run_with(&file, &[]).0);
    for path in [&folder, &file] {
        let (_, without, said) = run_with(path, &["--no-imu"]);
        assert!(without["inertial"].is_null(), "{without}");
        assert!(!said.contains("inertial sensor"), "{said}");
    }
    let output = stillpoint([
        "recording",
        "cut",
        text(&file),
        text(&cut),
        "--start",
        "5",
        "--max-frames",
        "10",
    ]);
    writes(&output, 10);
    assert!((60..90).contains(&samples(&output)));
    let (_, part, _) = run_with(&cut, &[]);
    assert!(part["inertial"]["state"].is_string(), "{part}");
    let wrong = [
        "run",
        text(&file),
        "--imu-topic",
        "/camera/color/image_raw",
        "--out",
        text(&back),
    ];
    check(
        &stillpoint(wrong),
        2,
        &["--imu-topic", "/camera/imu", "name one of these"],
    );
}

#[test]
fn odometry_samples_are_converted_and_cut() {
    let out = tempfile::tempdir().unwrap();
    let [folder, file, back, cut] =
        ["a", "a.mcap", "b", "cut.mcap"].map(|name| out.path().join(name));
    let simulated = "-q simulate --scene blocked_walk --odometry --jpeg --frames 20 --out";
    let args = simulated.split(' ').chain([text(&folder)]);
    check(&stillpoint(args), 0, &[]);
    let samples = |output: &Output| -> usize {
        let said = stdout(output);
        let part = said
            .split(", ")
            .find(|p| p.contains(" samples of odometry"));
        part.unwrap().split(' ').next().unwrap().parse().unwrap()
    };
    for (from, to) in [(&folder, &file), (&file, &back)] {
        let output = stillpoint(["recording", "convert", text(from), text(to)]);
        writes(&output, 20);
        // 50 Hz over 19 intervals of frames, and one after the last; a file has no times before 0.
        assert_eq!(samples(&output), 33);
    }
    let (expected, summary, _) = run_with(&folder, &[]);
    assert!(summary["odometry"]["state"].is_string(), "{summary}");
    let (without, _, said) = run_with(&folder, &["--no-odometry"]);
    assert!(without != expected && !said.contains("odometry"), "{said}");
    for path in [&file, &back] {
        let (trajectory, found, said) = run_with(path, &[]);
        assert_eq!(trajectory, expected, "{said}");
        for what in ["state", "slips", "carried_frames"] {
            assert_eq!(found["odometry"][what], summary["odometry"][what]);
        }
        assert_eq!(run_with(path, &["--no-odometry"]).0, without);
    }
    let (named, _, _) = run_with(&file, &["--odometry-topic", "/odom"]);
    assert_eq!(named, expected);
    let (_, found, _) = run_with(&file, &["--truth-topic", "/odom"]);
    assert!(found["odometry"].is_null(), "{found}");
    let guesses = info(&file)["guesses"].to_string();
    assert!(
        guesses.contains("odometry: /odom of base_link"),
        "{guesses}"
    );
    let part = ["--start", "5", "--max-frames", "10"];
    let output = stillpoint([&["recording", "cut", text(&file), text(&cut)][..], &part].concat());
    writes(&output, 10);
    let (_, part, _) = run_with(&cut, &[]);
    assert!(part["odometry"]["state"].is_string(), "{part}");
    let wrong = ["run", text(&file), "--odometry-topic", "/camera/imu"];
    let told = ["--odometry-topic", "/odom", "name one of these"];
    check(&stillpoint(wrong), 2, &told);
}

#[test]
fn eval_accepts_folders_and_recordings_as_ground_truth() {
    let out = tempfile::tempdir().unwrap();
    let (estimate, _) = run(&PAIR.folder);
    let file = out.path().join("trajectory.txt");
    std::fs::write(&file, estimate).unwrap();
    let eval = |truth: &Path, more: &[&str]| {
        let args = ["eval", text(truth), text(&file), "--json"];
        let output = stillpoint(args.iter().chain(more));
        check(&output, 0, &[]);
        let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
        json["ate"]["rmse"].as_f64().unwrap()
    };
    let expected = eval(&PAIR.folder.join("groundtruth.txt"), &[]);
    assert_eq!(eval(&PAIR.folder, &[]), expected);
    // Stamps of recordings are whole nanoseconds.
    for more in [&[][..], &["--truth-topic", "/ground_truth/pose"]] {
        assert!((eval(&PAIR.file, more) - expected).abs() < 1e-6);
    }
    let refused = |args: &[&str], parts: &[&str]| {
        check(&stillpoint(["eval"].iter().chain(args)), 2, parts);
    };
    let (folder, estimate) = (text(out.path()), text(&file));
    refused(
        &[estimate, estimate, "--truth-topic", "/a"],
        &["expected a recording"],
    );
    refused(
        &[text(&PAIR.file), estimate, "--truth-topic", "/a"],
        &["/a"],
    );
    refused(&[folder, estimate], &[folder]);
}

#[test]
fn info_lists_topics_and_frames() {
    let found = info(&PAIR.file);
    assert_eq!(found["format"], "MCAP");
    assert_eq!(found["frames"], FRAMES);
    let topics = found["topics"].as_array().unwrap();
    let colour = topics
        .iter()
        .find(|t| t["name"] == "/camera/color/image_raw");
    assert_eq!(colour.unwrap()["messages"], FRAMES);
    assert!(found.get("refused").is_none(), "{found}");
}

#[test]
fn recording_is_cut_by_time_or_frames() {
    let out = PAIR.dir.path();
    // Frames are 1/30 s apart; cut times between frames do not depend on rounding.
    let by_time = out.join("time.mcap");
    let truth = ["--truth-topic", "/ground_truth/pose"];
    let times = [&["--start-time", "0.09", "--end-time", "0.29"], &truth[..]].concat();
    let by_frames = out.join("frames.mcap");
    let frames = vec!["--start", "3", "--max-frames", "6"];
    for (from, to, part) in [
        (&PAIR.file, &by_time, times),
        (&PAIR.folder, &by_frames, frames),
    ] {
        let output =
            stillpoint([&["recording", "cut", text(from), text(to)][..], &part[..]].concat());
        writes(&output, 6);
        assert_eq!(info(to)["frames"], 6);
    }
    // The same part of file and folder.
    assert!(std::fs::read(&by_time).unwrap() == std::fs::read(&by_frames).unwrap());
}

#[test]
fn invalid_cut_ranges_are_refused() {
    let out = PAIR.dir.path().join("none.mcap");
    let folder = PAIR.dir.path().join("none");
    let cut = |out: &Path, part: &[&str]| {
        stillpoint([&["recording", "cut", text(&PAIR.file), text(out)][..], part].concat())
    };
    let empty = &["expected a part with frames", "12 frames"];
    check(&cut(&out, &["--start-time", "9"]), 2, empty);
    check(
        &cut(&out, &["--start-time", "0.3", "--end-time", "0.1"]),
        2,
        empty,
    );
    check(&cut(&out, &["--start", "12"]), 2, empty);
    check(
        &cut(&out, &["--start-time", "nan"]),
        2,
        &["expected seconds"],
    );
    check(
        &cut(&out, &["--start", "1", "--start-time", "1"]),
        2,
        &["cannot be used with"],
    );
    check(&cut(&folder, &[]), 2, &[".mcap"]);
    check(&cut(&PAIR.file, &[]), 2, &["choose another name"]);
    assert!(!out.exists() && !folder.exists());
}

#[test]
fn truncated_recording_runs_up_to_its_end() {
    let whole = std::fs::read(&PAIR.file).unwrap();
    let cut_off = PAIR.dir.path().join("cut_off.mcap");
    std::fs::write(&cut_off, &whole[..whole.len() * 3 / 4]).unwrap();
    let (trajectory, said) = run(&cut_off);
    assert!(said.contains("cut off"), "{said}");
    let frames = trajectory.lines().filter(|l| !l.starts_with('#')).count();
    assert!((4..FRAMES).contains(&frames), "{frames}");
}

/// A recording with every message twice: from a camera in front and from one behind.
fn of_two_cameras(one: &Path, two: &Path) {
    let bytes = std::fs::read(one).unwrap();
    let file = std::fs::File::create(two).unwrap();
    let options = mcap::WriteOptions::new().compression(None);
    let mut writer = options.create(std::io::BufWriter::new(file)).unwrap();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        for name in ["/front", "/rear"] {
            let mut message = message.clone();
            let mut channel = (*message.channel).clone();
            channel.id = 2 * channel.id + u16::from(name == "/rear");
            channel.topic = channel.topic.replacen("/camera", name, 1);
            message.channel = channel.into();
            writer.write(&message).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn recording_with_two_cameras_needs_a_topic() {
    let two = PAIR.dir.path().join("two.mcap");
    of_two_cameras(&PAIR.file, &two);
    let list = [
        "expected one camera",
        "/front/color/image_raw",
        "/rear/color/image_raw",
        "--color-topic",
    ];
    check(&stillpoint(["run", text(&two)]), 2, &list);
    let rear = PAIR.dir.path().join("rear.mcap");
    let named = ["--color-topic", "/rear/color/image_raw"];
    let cut = ["recording", "cut", text(&two), text(&rear)];
    writes(
        &stillpoint([cut, [named[0], named[1], "--max-frames", "2"]].concat()),
        2,
    );
    assert_eq!(info(&rear)["frames"], 2);
}
