//! Every kind of bad data set gets a message that names the place, the expectation and the finding, and exit code 2; never a panic or an
//! incomplete result.

use crate::common::case::Case;
use crate::common::{check, stderr, stdout, stillpoint};
use std::path::Path;

fn replace_line(text: &str, number: usize, with: &str) -> String {
    let mut lines: Vec<&str> = text.lines().collect();
    lines[number - 1] = with;
    lines.join("\n") + "\n"
}

fn all(_: usize) -> bool {
    true
}

fn gray16(path: &Path, width: u32, height: u32, value: u16) {
    image::ImageBuffer::from_pixel(width, height, image::Luma([value]))
        .save_with_format(path, image::ImageFormat::Png)
        .unwrap();
}

#[test]
fn valid_data_set_is_accepted() {
    let case = Case::new();
    check(
        &case.run(&[]),
        0,
        &["layout: TUM", "camera: ", "12 of 12 colour images"],
    );
}

#[test]
fn missing_or_empty_folder_is_refused() {
    check(
        &stillpoint(["run", "/no/such/folder"]),
        2,
        &["/no/such/folder", "found nothing"],
    );
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().to_str().unwrap();
    check(&stillpoint(["run", path]), 2, &[path, "empty folder"]);
    let case = Case::new();
    let file = case.room().join("rgb.txt");
    check(
        &stillpoint(["run", file.to_str().unwrap()]),
        2,
        &["rgb.txt", "found a file"],
    );
}

#[test]
fn missing_depth_is_refused() {
    let case = Case::new();
    std::fs::remove_file(case.room().join("depth.txt")).unwrap();
    std::fs::remove_dir_all(case.room().join("depth")).unwrap();
    case.fails(&[], &["depth"]);
}

#[test]
fn unknown_layout_is_refused() {
    let case = Case::new();
    std::fs::remove_dir_all(case.room()).unwrap();
    std::fs::create_dir(case.room()).unwrap();
    std::fs::write(case.room().join("notes.md"), "hello").unwrap();
    case.fails(&[], &["TUM", "ICL-NUIM", "7-Scenes"]);
}

#[test]
fn unknown_camera_is_refused() {
    let case = Case::new();
    std::fs::remove_file(case.room().join("camera.toml")).unwrap();
    case.fails(&[], &["camera", "tum_fr1", "bonn", "camera.txt"]);
    case.fails(&["--camera", "nikon"], &["nikon", "tum_fr1"]);
    let bad = case.dir.path().join("camera.txt");
    std::fs::write(&bad, "# fx fy cx cy scale\n500 500 320\n").unwrap();
    case.fails(
        &["--camera", bad.to_str().unwrap()],
        &["camera.txt:2", "3 columns"],
    );
}

#[test]
fn malformed_line_is_reported() {
    let case = Case::new();
    case.edit("rgb.txt", |t| replace_line(t, 5, "once upon a time"));
    case.fails(&[], &["rgb.txt:5", "timestamp", "once"]);
    let case = Case::new();
    case.edit("groundtruth.txt", |t| replace_line(t, 4, "1 2 3"));
    case.fails(&[], &["groundtruth.txt:4", "8 numbers", "3 columns"]);
}

#[test]
fn decreasing_or_repeated_stamps_are_reported() {
    let swapped = |t: &str, a: usize, b: usize| {
        let lines: Vec<&str> = t.lines().collect();
        replace_line(&replace_line(t, a, lines[b - 1]), b, lines[a - 1])
    };
    let case = Case::new();
    case.edit("depth.txt", |t| swapped(t, 6, 7));
    let said = ["depth.txt: lines out of order by their stamps: 1"];
    check(&case.run(&[]), 0, &said);
    let case = Case::new();
    case.edit("rgb.txt", |t| {
        let line = t.lines().nth(5).unwrap().to_owned();
        replace_line(t, 7, &line)
    });
    let said = ["rgb.txt: lines that repeat a stamp and are left out: 1"];
    check(&case.run(&[]), 0, &said);
    let case = Case::new();
    case.edit("groundtruth.txt", |t| swapped(t, 6, 7));
    case.fails(&[], &["groundtruth.txt:7", "goes back"]);
}

#[test]
fn unusable_images_are_refused() {
    type Write = fn(&Path);
    let kinds: [(&str, Write, &str); 6] = [
        ("rgb", |p| std::fs::remove_file(p).unwrap(), "rgb/"),
        (
            "rgb",
            |p| {
                let bytes = std::fs::read(p).unwrap();
                std::fs::write(p, &bytes[..bytes.len() / 2]).unwrap();
            },
            "rgb/",
        ),
        ("depth", |p| std::fs::write(p, "").unwrap(), "depth/"),
        ("depth", |p| gray16(p, 320, 240, 9000), "320 x 240"),
        (
            "depth",
            |p| {
                image::ImageBuffer::from_pixel(640, 480, image::Luma([90_u8]))
                    .save_with_format(p, image::ImageFormat::Png)
                    .unwrap();
            },
            "16",
        ),
        // A float depth image as TIFF: its first bytes identify it.
        (
            "depth",
            |p| std::fs::write(p, b"II*\0\x08\0\0\0\0\0").unwrap(),
            "16",
        ),
    ];
    for (folder, write, part) in kinds {
        let case = Case::new();
        case.images(folder, all, write);
        case.fails(&[], &[part]);
    }
}

#[test]
fn one_unreadable_frame_is_skipped_unless_strict() {
    let case = Case::new();
    case.images("depth", |i| i == 4, |p| std::fs::write(p, "").unwrap());
    case.fails(&["--strict"], &["frame 4", "depth/"]);
    let output = case.run(&[]);
    check(&output, 0, &["skipped: frame 4"]);
    assert!(
        stdout(&output).contains("11 of 12 frames tracked, 1 could not be read"),
        "{}",
        stdout(&output)
    );
    let summary = std::fs::read_to_string(case.out().join("summary.json")).unwrap();
    assert!(summary.contains("\"skipped\": 1"), "{summary}");
    let trajectory = std::fs::read_to_string(case.out().join("trajectory.txt")).unwrap();
    assert_eq!(
        trajectory.lines().filter(|l| !l.starts_with('#')).count(),
        11
    );
}

#[test]
fn zero_or_wrongly_scaled_depth_is_reported() {
    let case = Case::new();
    case.images("depth", all, |p| gray16(p, 640, 480, 0));
    case.fails(&[], &["depth", "zero everywhere"]);
    let case = Case::new();
    case.edit("camera.toml", |t| {
        t.replace("depth_scale = 5000.0", "depth_scale = 5.0")
    });
    let output = case.run(&[]);
    assert!(
        stderr(&output).contains("warning: depth scale"),
        "{}",
        stderr(&output)
    );
    assert!(
        stderr(&output).contains("the likely factor is"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn lost_frames_are_reported_with_exit_code_1() {
    let case = Case::new();
    case.images(
        "rgb",
        |i| i >= 9,
        |p| {
            image::ImageBuffer::from_pixel(640, 480, image::Rgb([9_u8, 9, 9]))
                .save_with_format(p, image::ImageFormat::Jpeg)
                .unwrap();
        },
    );
    let output = case.run(&[]);
    check(
        &output,
        1,
        &["no pose in frames 9 to 11", "3 of 12 frames have no pose"],
    );
    let trajectory = std::fs::read_to_string(case.out().join("trajectory.txt")).unwrap();
    assert_eq!(
        trajectory.lines().filter(|l| !l.starts_with('#')).count(),
        9
    );
}

#[test]
fn bench_forwards_errors_of_a_run() {
    let out = tempfile::tempdir().unwrap();
    let out = out.path().to_str().unwrap();
    check(
        &stillpoint(["bench", "/no/such/folder", "--out", out]),
        2,
        &["/no/such/folder", "found nothing"],
    );
    check(&stillpoint(["bench"]), 2, &["PATH"]);
}

/// Many unreadable images make a poor result, and scripts do not read warnings, so that the exit code must tell.
#[test]
fn many_unreadable_frames_give_exit_code_1() {
    let case = Case::new();
    case.images(
        "depth",
        |i| i == 4 || i == 7,
        |p| std::fs::write(p, "").unwrap(),
    );
    let output = case.run(&[]);
    check(
        &output,
        1,
        &["2 of 12 frames could not be read, more than one in 10"],
    );
    assert!(case.out().join("summary.json").exists());
}

#[test]
fn lens_with_a_missing_k3_is_refused() {
    let case = Case::new();
    case.edit("camera.toml", |t| {
        let others = t.lines().filter(|l| !l.starts_with("distortion"));
        let others: Vec<&str> = others.collect();
        format!(
            "{}\ndistortion = [0.2624, -0.9531, -0.0054, 0.0026, 0.0]\n",
            others.join("\n")
        )
    });
    case.fails(
        &[],
        &["camera.toml", "k2 = -0.9531", "k3 is 0: was it left out?"],
    );
}

/// Names in a recording are untrusted: control characters are shown as text.
#[test]
#[cfg(unix)]
fn control_characters_in_names_are_escaped() {
    let case = Case::new();
    let bad = case.dir.path().join("a\u{1b}]0;owned\u{7}b");
    let bad = bad.to_str().unwrap();
    case.fails(&["--camera", bad], &["a\\u{1b}]0;owned\\u{7}b"]);
    let output = stillpoint(["run", "--\u{1b}[2J"]);
    check(&output, 2, &["\\u{1b}[2J"]);
    std::fs::rename(case.room(), bad).unwrap();
    let output = stillpoint([
        "run",
        bad,
        "--max-frames",
        "3",
        "--out",
        case.out().to_str().unwrap(),
    ]);
    check(&output, 0, &[]);
    for said in [stdout(&output), stderr(&output)] {
        assert!(
            !said.contains('\u{1b}') && !said.contains('\u{7}'),
            "{said:?}"
        );
    }
}

/// Pipes without a writer and endless devices are refused under any name.
#[test]
#[cfg(unix)]
fn pipes_and_devices_are_not_read() {
    let case = Case::new();
    let pipe = case.dir.path().join("pipe");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    let pipe = pipe.to_str().unwrap();
    let script = format!("scripted:{pipe}");
    for (options, part) in [
        (["--config", pipe], "a pipe"),
        (["--config", "/dev/zero"], "a device"),
        (["--detector", &script], "a pipe"),
        (["--camera", pipe], "neither a preset nor a file"),
        (["--load-map", pipe], "a pipe"),
        (["--load-map", "/dev/zero"], "a device"),
    ] {
        case.fails(&options, &[part]);
    }
    let room = case.room();
    let room = room.to_str().unwrap();
    for (arguments, part) in [
        (vec!["replay", pipe, room], "a pipe"),
        (vec!["replay", "/dev/zero", room], "a device"),
        (vec!["eval", pipe, pipe], "a pipe"),
        (vec!["map", "info", pipe], "a pipe"),
        (vec!["models", "check", "/dev/zero.onnx"], "found"),
    ] {
        check(&stillpoint(&arguments), 2, &[part]);
    }
}
