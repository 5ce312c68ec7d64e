//! Stamps in other units, clocks that jump or differ, and repeated images.

use crate::common::{check, program, simulate, stderr, stdout};
use std::path::{Path, PathBuf};
use std::process::Output;

/// Stamps, s, and names of a list.
type List = Vec<(f64, String)>;

fn read_list(path: &Path) -> List {
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().filter(|l| !l.starts_with('#'));
    lines
        .map(|l| {
            let (stamp, name) = l.split_once(' ').unwrap();
            (stamp.parse().unwrap(), name.to_owned())
        })
        .collect()
}

/// A simulated data set with each list modified by its own function.
fn changed(folder: &Path, frames: usize, colour: impl Fn(&mut List), depth: impl Fn(&mut List)) {
    simulate(folder, "xyz", frames);
    change(folder, "rgb.txt", &colour);
    change(folder, "depth.txt", &depth);
}

fn change(folder: &Path, name: &str, how: &impl Fn(&mut List)) {
    let path = folder.join(name);
    let mut list = read_list(&path);
    how(&mut list);
    let text: String = list.iter().map(|(t, f)| format!("{t:.6} {f}\n")).collect();
    std::fs::write(path, text).unwrap();
}

/// Runs a data set; returns its output and its result folder.
fn run(folder: &Path) -> (Output, PathBuf) {
    let out = folder.with_extension("out");
    let output = program()
        .args(["run", "--detector", "none", "--no-report", "--out"])
        .args([&out, folder])
        .output()
        .unwrap();
    (output, out)
}

fn doctor(folder: &Path) -> Output {
    program().arg("doctor").arg(folder).output().unwrap()
}

fn ate(out: &Path) -> f64 {
    let text = std::fs::read_to_string(out.join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&text).unwrap();
    summary["accuracy"]["final"]["ate"]["rmse"]
        .as_f64()
        .unwrap()
}

/// Replaces the images of some frames by that of the first of them.
fn stand_still(list: &mut List, frames: std::ops::Range<usize>) {
    let first = list[frames.start].1.clone();
    list[frames].iter_mut().for_each(|l| l.1 = first.clone());
}

#[test]
fn frozen_depth_is_ignored_and_reported() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    changed(&data, 45, |_| {}, |depth| stand_still(depth, 15..35));
    let (output, out) = run(&data);
    check(&output, 0, &["the depth image stood still in frames 1"]);
    assert!(
        stderr(&output).contains("19 frames, 0.63 s"),
        "{}",
        stderr(&output)
    );
    assert!(ate(&out) < 0.004, "{}", ate(&out));
    let csv = std::fs::read_to_string(out.join("frames.csv")).unwrap();
    let told = csv
        .lines()
        .filter(|l| l.ends_with("the depth image stands still"));
    assert_eq!(told.count(), 19, "{csv}");
    let output = doctor(&data);
    check(&output, 1, &[]);
    let said = stdout(&output);
    assert!(
        said.contains("the depth image stands still while the colour image goes on: 19 frames"),
        "{said}"
    );
}

#[test]
fn frozen_colour_and_frozen_frames_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    for (name, both) in [("colour", false), ("both", true)] {
        let data = dir.path().join(name);
        let depth = |list: &mut List| {
            if both {
                stand_still(list, 15..35);
            }
        };
        changed(&data, 45, |colour| stand_still(colour, 15..35), depth);
        let (output, out) = run(&data);
        check(
            &output,
            1,
            &["are no new views and have no pose", "more than one in 10"],
        );
        assert!(ate(&out) < 0.004, "{name}: {}", ate(&out));
        let csv = std::fs::read_to_string(out.join("frames.csv")).unwrap();
        let lost = csv.lines().filter(|l| l.contains(",lost,")).count();
        assert!((18..=19).contains(&lost), "{name}: {csv}");
        let output = doctor(&data);
        check(&output, 1, &[]);
        assert!(
            stdout(&output).contains("stands still while"),
            "{name}: {}",
            stdout(&output)
        );
    }
}

#[test]
fn list_order_is_kept_after_a_backward_clock_jump() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let back = |list: &mut List| list[15..].iter_mut().for_each(|l| l.0 -= 0.4);
    changed(&data, 30, back, back);
    let (output, out) = run(&data);
    check(
        &output,
        0,
        &["stamps go back by 0.36", "clock was set back"],
    );
    let stamps = read_list(&out.join("trajectory.txt"));
    assert!(
        stamps
            .windows(2)
            .all(|w| w[0].0 < w[1].0 && w[1].0 < w[0].0 + 0.05)
    );
    let output = doctor(&data);
    check(&output, 1, &[]);
    assert!(stdout(&output).contains("the clock was set back while this was recorded"));
}

#[test]
fn stamp_units_are_detected_per_list() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let scaled = |factor: f64| {
        move |list: &mut List| {
            list.iter_mut()
                .for_each(|l| l.0 = 1e9 * factor + l.0 * factor)
        }
    };
    changed(&data, 12, scaled(1e9), scaled(1e3));
    std::fs::remove_file(data.join("groundtruth.txt")).unwrap();
    let (output, out) = run(&data);
    check(
        &output,
        0,
        &[
            "rgb.txt: stamps are nanoseconds",
            "depth.txt: stamps are milliseconds",
        ],
    );
    let last = read_list(&out.join("trajectory.txt")).pop().unwrap().0;
    assert!((1e9..1e9 + 10.0).contains(&last), "{last}");
}

#[test]
fn clock_offset_is_reported_estimated_and_applied() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    simulate(&data, "xyz", 90);
    let truth = data.join("groundtruth.txt");
    let late = dir.path().join("late.txt");
    let lines: String = read_list(&truth)
        .iter()
        .skip(20)
        .take(50)
        .map(|(t, pose)| format!("{:.6} {pose}\n", t + 0.25))
        .collect();
    std::fs::write(&late, lines).unwrap();
    let eval = |more: &[&str]| {
        let output = program()
            .arg("eval")
            .args([&truth, &late])
            .args(more)
            .output();
        output.unwrap()
    };
    let warned = eval(&[]);
    check(
        &warned,
        0,
        &[
            "the clocks of ground truth and estimate seem to be apart",
            "--time-offset -0.25",
        ],
    );
    let found = eval(&["--find-offset"]);
    check(&found, 0, &["-0.250 s are added"]);
    for output in [found, eval(&["--time-offset", "-0.25"])] {
        assert!(!stderr(&output).contains("apart"), "{}", stderr(&output));
        let said = stdout(&output);
        let ate = said.lines().find(|l| l.starts_with("ATE")).unwrap();
        let rmse: f64 = ate.split_whitespace().nth(2).unwrap().parse().unwrap();
        assert!(rmse < 1.0, "{said}");
    }
    check(
        &eval(&["--find-offset", "--time-offset", "1"]),
        2,
        &["--find-offset"],
    );
    check(
        &eval(&["--time-offset", "nan"]),
        2,
        &["a number of seconds"],
    );
}

#[test]
fn data_set_without_readable_images_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    simulate(&data, "xyz", 12);
    let depths: Vec<PathBuf> = std::fs::read_dir(data.join("depth"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    let cut = |path: &PathBuf| {
        let bytes = std::fs::read(path).unwrap();
        std::fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
    };
    depths[..3].iter().for_each(cut);
    let output = doctor(&data);
    check(&output, 1, &[]);
    assert!(
        stdout(&output).contains("3 of 12 frames cannot be read"),
        "{}",
        stdout(&output)
    );
    depths[3..].iter().for_each(cut);
    check(&doctor(&data), 2, &["error: "]);
}

#[test]
fn wrong_quaternion_order_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    simulate(&data, "rpy", 60);
    let truth = data.join("groundtruth.txt");
    let rows: String = read_list(&truth)
        .iter()
        .map(|(t, pose)| {
            let p: Vec<&str> = pose.split_whitespace().collect();
            let [x, y, z] = [p[0], p[1], p[2]];
            format!("{t:.6} {x} {y} {z} {} {} {} {}\n", p[6], p[3], p[4], p[5])
        })
        .collect();
    let eval = |text: &str| {
        let other = dir.path().join("other.txt");
        std::fs::write(&other, text).unwrap();
        let output = program().arg("eval").args([&other, &truth]).output();
        output.unwrap()
    };
    let header = "# timestamp tx ty tz qw qx qy qz";
    let seem = "the quaternions of the ground truth seem to have w first";
    check(&eval(&rows), 0, &[seem, header]);
    // The advice in the message works.
    let advised = eval(&format!("{header}\n{rows}"));
    check(&advised, 0, &["w first"]);
    assert!(!stderr(&advised).contains("seem"), "{}", stderr(&advised));
}
