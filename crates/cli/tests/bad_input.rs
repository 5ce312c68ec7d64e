//! Every kind of bad input gets a message that names the place, what was expected and found, and exit code 2; never a
//! panic, never a half-written result.
#![allow(clippy::unwrap_used)]

mod common;

use common::{check, copy, files, program, simulate, stderr, stdout, stillpoint};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use tempfile::TempDir;

const FRAMES: usize = 12;

/// A good data set, made once.
static GOOD: LazyLock<TempDir> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    simulate(&dir.path().join("room"), "xyz", FRAMES);
    dir
});

/// A copy of the good data set to spoil, with an old result beside it.
struct Case {
    dir: TempDir,
}

impl Case {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        copy(&GOOD.path().join("room"), &dir.path().join("room"));
        std::fs::create_dir(dir.path().join("out")).unwrap();
        std::fs::write(dir.path().join("out/trajectory.txt"), "old").unwrap();
        Self { dir }
    }

    fn room(&self) -> PathBuf {
        self.dir.path().join("room")
    }

    fn out(&self) -> PathBuf {
        self.dir.path().join("out")
    }

    /// Changes the text of a file of the data set.
    fn edit(&self, name: &str, change: impl Fn(&str) -> String) -> &Self {
        let path = self.room().join(name);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(path, change(&text)).unwrap();
        self
    }

    /// Writes something over images.
    fn images(&self, folder: &str, which: impl Fn(usize) -> bool, write: impl Fn(&Path)) -> &Self {
        for (i, path) in files(&self.room().join(folder)).iter().enumerate() {
            if which(i) {
                write(path);
            }
        }
        self
    }

    fn run(&self, more: &[&str]) -> std::process::Output {
        program()
            .arg("run")
            .arg(self.room())
            .arg("--out")
            .arg(self.out())
            .args(more)
            .output()
            .unwrap()
    }

    /// Expects exit code 2, the parts in the message, and the old result as it was.
    #[track_caller]
    fn fails(&self, more: &[&str], parts: &[&str]) {
        let output = self.run(more);
        check(&output, 2, parts);
        check(&output, 2, &["error: ", "expected", "found"]);
        self.old_result_is_untouched();
    }

    #[track_caller]
    fn old_result_is_untouched(&self) {
        let names: Vec<_> = files(&self.out());
        assert_eq!(names, [self.out().join("trajectory.txt")]);
        let old = std::fs::read_to_string(self.out().join("trajectory.txt")).unwrap();
        assert_eq!(old, "old");
    }
}

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
fn the_good_data_set_is_good() {
    let case = Case::new();
    check(
        &case.run(&[]),
        0,
        &["layout: TUM", "camera: ", "12 of 12 colour images"],
    );
}

#[test]
fn missing_or_empty_folder() {
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
fn no_depth() {
    let case = Case::new();
    std::fs::remove_file(case.room().join("depth.txt")).unwrap();
    std::fs::remove_dir_all(case.room().join("depth")).unwrap();
    case.fails(&[], &["depth"]);
}

#[test]
fn unknown_layout() {
    let case = Case::new();
    std::fs::remove_dir_all(case.room()).unwrap();
    std::fs::create_dir(case.room()).unwrap();
    std::fs::write(case.room().join("notes.md"), "hello").unwrap();
    case.fails(&[], &["TUM", "ICL-NUIM", "7-Scenes"]);
}

#[test]
fn unknown_camera() {
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
fn malformed_line() {
    let case = Case::new();
    case.edit("rgb.txt", |t| replace_line(t, 5, "once upon a time"));
    case.fails(&[], &["rgb.txt:5", "timestamp", "once"]);
    let case = Case::new();
    case.edit("groundtruth.txt", |t| replace_line(t, 4, "1 2 3"));
    case.fails(&[], &["groundtruth.txt:4", "8 numbers", "3 columns"]);
}

#[test]
fn stamps_that_go_back_or_repeat() {
    let swapped = |t: &str, a: usize, b: usize| {
        let lines: Vec<&str> = t.lines().collect();
        replace_line(&replace_line(t, a, lines[b - 1]), b, lines[a - 1])
    };
    let case = Case::new();
    case.edit("depth.txt", |t| swapped(t, 6, 7));
    case.fails(&[], &["depth.txt:7", "goes back"]);
    let case = Case::new();
    case.edit("rgb.txt", |t| {
        let line = t.lines().nth(5).unwrap().to_owned();
        replace_line(t, 7, &line)
    });
    case.fails(&[], &["rgb.txt:7", "repeats"]);
}

#[test]
fn images_that_cannot_be_used() {
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
        // A float depth image as TIFF: its first bytes are enough to know it.
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
        stdout(&output).contains("11 of 11 frames tracked"),
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
fn depth_that_is_zero_or_of_the_wrong_scale() {
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
fn configuration_mistakes() {
    let case = Case::new();
    case.fails(
        &["--set", "tracking.min_inlier=20"],
        &[
            "--set tracking.min_inlier=20",
            "did you mean \"tracking.min_inliers\"",
        ],
    );
    let file = case.dir.path().join("my.toml");
    std::fs::write(&file, "seed = 1\n\n[traking]\nmin_inliers = 20\n").unwrap();
    let file = file.to_str().unwrap();
    case.fails(
        &["--config", file],
        &["my.toml:4", "\"tracking.min_inliers\""],
    );
    case.fails(&["--config", "/no/such.toml"], &["/no/such.toml"]);
    // All values out of range are told at once.
    case.fails(
        &[
            "--set",
            "tracking.min_inliers=1",
            "--set",
            "features.levels=99",
        ],
        &["tracking.min_inliers", "features.levels"],
    );
}

#[test]
fn arguments() {
    let case = Case::new();
    case.fails(
        &["--detector", "yolo"],
        &["--detector", "\"yolo\"", "FILE.onnx"],
    );
    case.fails(&["--start", "12"], &["start 12"]);
    check(&case.run(&["--max-frames", "0"]), 2, &["--max-frames"]);
    check(&case.run(&["--seed", "-1"]), 2, &[]);
    check(&stillpoint(["fly"]), 2, &["fly"]);
    check(
        &stillpoint(["simulate", "--scene", "xzy", "--out", "/tmp/never"]),
        2,
        &["\"xyz\"?"],
    );
    let output = program()
        .env("STILLPOINT_SIMD", "fast")
        .arg("run")
        .arg(case.room())
        .output()
        .unwrap();
    check(&output, 2, &["STILLPOINT_SIMD", "scalar"]);
}

#[test]
fn detectors_that_cannot_be_used() {
    let case = Case::new();
    let file = |name: &str, text: &str| {
        let path = case.dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let script = |name: &str, text: &str| format!("scripted:{}", file(name, text));
    let header = "timestamp,class,score,x0,y0,x1,y1";
    for (detector, parts) in [
        (
            "/no/such/model.onnx".to_owned(),
            &["/no/such/model.onnx", "check the path"][..],
        ),
        (file("bad.onnx", "no model"), &["bad.onnx", "ONNX model"]),
        ("/no/such.csv".to_owned(), &["scripted:/no/such.csv?"]),
        (
            "scripted:/no/such.csv".to_owned(),
            &["/no/such.csv", "script of detections"],
        ),
        (
            script("a.csv", "0.0,person,0.9,10,10\n"),
            &["a.csv:1", header, "5 in"],
        ),
        (
            script("b.csv", &format!("{header}\n0.0,persn,0.9,10,10,90,90\n")),
            &["b.csv:2", "such as \"person\""],
        ),
        // A script of another recording would be ignored in silence.
        (
            script("c.csv", "1305031102.175304,person,0.9,10,10,90,90\n"),
            &[
                "c.csv",
                "none of its 1 rows",
                "12 frames",
                "belongs to this recording",
            ],
        ),
    ] {
        case.fails(&["--detector", &detector], parts);
    }
    // Nothing seen in any frame is possible, and worth a word.
    let empty = script("empty.csv", header);
    let output = case.run(&["--detector", &empty]);
    check(&output, 0, &["warning: ", "empty.csv", "no detections"]);
}

#[test]
fn verdicts_and_pictures_that_cannot_be_written() {
    let case = Case::new();
    let file = case.dir.path().join("file");
    std::fs::write(&file, "mine").unwrap();
    let below = file.join("below");
    let below = below.to_str().unwrap();
    case.fails(
        &["--verdicts", below],
        &["file/below", "another with --verdicts"],
    );
    case.fails(
        &["--overlay", below],
        &["file/below", "another with --overlay"],
    );
    let folder = case.room();
    let folder = folder.to_str().unwrap();
    case.fails(
        &["--verdicts", folder],
        &["room", "another with --verdicts"],
    );
    let file = file.to_str().unwrap();
    case.fails(
        &["--overlay", file],
        &["found a file", "another with --overlay"],
    );
    check(&case.run(&["--overlay-every", "2"]), 2, &["--overlay"]);
    check(
        &case.run(&["--overlay", "x", "--overlay-every", "0"]),
        2,
        &["--overlay-every"],
    );
    if cfg!(target_os = "linux") {
        case.fails(&["--verdicts", "/dev/full"], &["/dev/full", "free space"]);
    }
}

#[test]
fn simulate_does_not_write_into_a_full_folder() {
    let case = Case::new();
    let room = case.room();
    let args = [
        "simulate",
        "--scene",
        "xyz",
        "--frames",
        "1",
        "--out",
        room.to_str().unwrap(),
    ];
    check(&stillpoint(args), 2, &["room", "new or empty folder"]);
}

#[test]
fn evaluation() {
    let case = Case::new();
    let truth = case.room().join("groundtruth.txt");
    let late = case.dir.path().join("late.txt");
    std::fs::write(
        &late,
        "1000 0 0 0 0 0 0 1\n1001 1 0 0 0 0 0 1\n1002 1 1 0 0 0 0 1\n",
    )
    .unwrap();
    let eval = |estimate: &Path, more: &[&str]| {
        program()
            .arg("eval")
            .arg(&truth)
            .arg(estimate)
            .args(more)
            .output()
            .unwrap()
    };
    check(
        &eval(&late, &[]),
        2,
        &["late.txt", "no overlap in time", "1000.000"],
    );
    check(&eval(Path::new("/no/such.txt"), &[]), 2, &["/no/such.txt"]);
    check(&eval(&truth, &["--delta", "3"]), 2, &["30f"]);
    check(
        &eval(&truth, &["--plot", "a.jpg"]),
        2,
        &["a.jpg", ".svg or .png"],
    );
    check(
        &eval(&truth, &["--plot", "/no/such/a.svg"]),
        2,
        &["/no/such/a.svg"],
    );
    let empty = case.dir.path().join("empty.txt");
    std::fs::write(&empty, "# nothing\n").unwrap();
    check(&eval(&empty, &[]), 2, &["the estimate holds no pose"]);
    std::fs::write(&late, "1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n").unwrap();
    check(&eval(&late, &[]), 2, &["late.txt:2", "repeats"]);
    check(&eval(&truth, &[]), 0, &[]);
}

#[test]
fn output_that_cannot_be_written() {
    let case = Case::new();
    let file = case.dir.path().join("file");
    std::fs::write(&file, "mine").unwrap();
    let run = |out: &Path| {
        program()
            .arg("run")
            .arg(case.room())
            .arg("--out")
            .arg(out)
            .output()
            .unwrap()
    };
    check(&run(&file), 2, &["expected a folder", "found a file"]);
    check(
        &run(&file.join("below")),
        2,
        &["expected to write", "file/below"],
    );
    if cfg!(target_os = "linux") {
        // Not even the superuser can write here.
        check(
            &run(Path::new("/proc/stillpoint")),
            2,
            &["expected to write", "/proc/stillpoint"],
        );
    }
    assert_eq!(std::fs::read_to_string(file).unwrap(), "mine");
}

/// A limit on file sizes acts as a full disk does: writing fails half-way.
#[test]
#[cfg(unix)]
fn full_disk() {
    let case = Case::new();
    let output = std::process::Command::new("sh")
        .arg("-c")
        .arg("trap '' XFSZ; ulimit -f 1; exec \"$0\" run \"$1\" --out \"$2\"")
        .arg(env!("CARGO_BIN_EXE_stillpoint"))
        .arg(case.room())
        .arg(case.out())
        .output()
        .unwrap();
    check(&output, 2, &["expected to write", "free space"]);
    case.old_result_is_untouched();
    // Verdicts are written while frames go by: what was there before stays, and nothing else is left.
    let table = case.dir.path().join("tables/v.csv");
    std::fs::create_dir(case.dir.path().join("tables")).unwrap();
    std::fs::write(&table, "old").unwrap();
    let output = std::process::Command::new("sh")
        .arg("-c")
        .arg("trap '' XFSZ; ulimit -f 300; exec \"$0\" run \"$1\" --out \"$2\" --verdicts \"$3\"")
        .arg(env!("CARGO_BIN_EXE_stillpoint"))
        .arg(case.room())
        .arg(case.out())
        .arg(&table)
        .output()
        .unwrap();
    check(&output, 2, &["v.csv: expected to write", "free space"]);
    case.old_result_is_untouched();
    assert_eq!(std::fs::read_to_string(&table).unwrap(), "old");
    assert_eq!(files(&case.dir.path().join("tables")), [table]);
}

#[test]
fn lost_frames_end_with_1_and_are_told() {
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
fn bench_passes_on_what_a_run_says() {
    let out = tempfile::tempdir().unwrap();
    let out = out.path().to_str().unwrap();
    check(
        &stillpoint(["bench", "/no/such/folder", "--out", out]),
        2,
        &["/no/such/folder", "found nothing"],
    );
    check(&stillpoint(["bench"]), 2, &["PATH"]);
}

/// A reader that leaves early is no reason to panic.
#[test]
#[cfg(unix)]
fn closed_pipe() {
    let output = std::process::Command::new("sh")
        .arg("-c")
        .arg("{ \"$0\" config print; echo \"exit $?\" >&2; } | true")
        .arg(env!("CARGO_BIN_EXE_stillpoint"))
        .output()
        .unwrap();
    check(&output, 0, &["exit 0"]);
}
