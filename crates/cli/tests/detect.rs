//! `detect` on images, folders and data sets, with a network made in the test and with real ones.

use crate::common::{check, files, program, simulate, stdout, stillpoint, tiny_model};
use std::path::{Path, PathBuf};
use std::process::Output;
use stillpoint::detection::{ClassId, ScriptRow, parse_script};

/// A black image of 64x64 px with a white square of 16 px, whose upper left pixel is at (x, y).
fn picture(path: &Path, x: u32, y: u32) {
    let mut image = image::RgbImage::new(64, 64);
    for (dx, dy) in (0..16).flat_map(|dx| (0..16).map(move |dy| (dx, dy))) {
        image.put_pixel(x + dx, y + dy, image::Rgb([255; 3]));
    }
    image.save(path).unwrap();
}

fn detect(path: &Path, model: &Path, more: &[&str]) -> Output {
    program()
        .arg("detect")
        .arg(path)
        .arg("--model")
        .arg(model)
        .args(["--runtime", "rten"])
        .args(more)
        .output()
        .unwrap()
}

fn rows(out: &Path) -> Vec<ScriptRow> {
    let text = std::fs::read_to_string(out.join("detections.csv")).unwrap();
    parse_script("detections.csv", &text).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let name = |p: &PathBuf| p.file_name().unwrap().to_str().unwrap().to_owned();
    files(folder).iter().map(name).collect()
}

#[test]
fn single_image_gives_a_table() {
    let dir = tempfile::tempdir().unwrap();
    let model = tiny_model::write(dir.path());
    for name in ["a.png", "a.jpg", "a.webp"] {
        let file = dir.path().join(name);
        picture(&file, 32, 16);
        let output = detect(&file, &model, &[]);
        check(&output, 0, &[]);
        let text = stdout(&output);
        assert!(text.contains(" person "), "{text}");
        assert!(text.contains(" detections in 1 images"), "{text}");
        for part in [
            "median ms per image: letterbox ",
            "network ",
            "decode ",
            "rten ",
        ] {
            assert!(text.contains(part), "{text}");
        }
    }
    assert_eq!(
        names(dir.path()).len(),
        4,
        "nothing is written without --out"
    );
}

#[test]
fn image_folder_gives_a_table_and_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let (folder, out) = (dir.path().join("in"), dir.path().join("out"));
    std::fs::create_dir(&folder).unwrap();
    let model = tiny_model::write(dir.path());
    picture(&folder.join("b.png"), 32, 16);
    picture(&folder.join("a.png"), 0, 0);
    image::RgbImage::new(64, 64)
        .save(folder.join("c.png"))
        .unwrap();
    std::fs::create_dir(&out).unwrap();
    for name in ["boxes_old.png", "mine.png"] {
        std::fs::write(out.join(name), "").unwrap();
    }
    let more = ["--out", out.to_str().unwrap()];
    let output = detect(&folder, &model, &more);
    check(&output, 0, &["their index, from 0"]);
    let expected = [
        "boxes_a.png",
        "boxes_b.png",
        "boxes_c.png",
        "detections.csv",
        "mine.png",
    ];
    assert_eq!(names(&out), expected);
    let rows = rows(&out);
    for (stamp, (x, y)) in [(0.0, (8.0, 8.0)), (1.0, (40.0, 24.0))] {
        let found: Vec<&ScriptRow> = rows.iter().filter(|r| r.stamp == stamp).collect();
        assert!(!found.is_empty(), "{rows:?}");
        for row in found {
            let b = &row.detection.bounds;
            assert_eq!(row.detection.class, ClassId::PERSON);
            assert!(b.contains(x - 1.0, y - 1.0), "{row:?}");
        }
    }
    assert!(rows.iter().all(|r| r.stamp < 2.0), "nothing is in the dark");
    let drawn = image::open(out.join("boxes_b.png")).unwrap().into_rgb8();
    let plain = image::open(folder.join("b.png")).unwrap().into_rgb8();
    assert_eq!(drawn.dimensions(), plain.dimensions());
    assert_ne!(drawn, plain, "a box is drawn");

    let higher = ["--score", "0.95", "--out", out.to_str().unwrap()];
    check(&detect(&folder, &model, &higher), 0, &[]);
    assert!(self::rows(&out).is_empty(), "no score is over 0.9");
}

#[test]
fn recording_gives_the_same_detections_as_its_folder() {
    let dir = tempfile::tempdir().unwrap();
    let (room, file) = (dir.path().join("room"), dir.path().join("room.mcap"));
    simulate(&room, "walking_static", 3);
    let convert = [
        "recording",
        "convert",
        room.to_str().unwrap(),
        file.to_str().unwrap(),
    ];
    check(&stillpoint(convert), 0, &[]);
    let model = tiny_model::write(dir.path());
    let tables = [&room, &file].map(|path| {
        let out = dir.path().join("out");
        let more = ["--score", "0.05", "--out", out.to_str().unwrap()];
        check(&detect(path, &model, &more), 0, &[]);
        assert_eq!(names(&out).len(), 4, "three pictures and the table");
        rows(&out)
    });
    assert!(!tables[0].is_empty());
    assert_eq!(tables[0].len(), tables[1].len());
    for (a, b) in tables[0].iter().zip(&tables[1]) {
        assert!((a.stamp - b.stamp).abs() < 1e-6);
        assert_eq!(a.detection, b.detection);
    }
    let topic = ["--color-topic", "/nothing"];
    check(&detect(&file, &model, &topic), 2, &["/nothing"]);
}

#[test]
fn detections_of_a_data_set_work_as_a_script() {
    let dir = tempfile::tempdir().unwrap();
    let (room, out) = (dir.path().join("room"), dir.path().join("out"));
    simulate(&room, "walking_static", 4);
    let model = tiny_model::write(dir.path());
    let more = ["--score", "0.05", "--out", out.to_str().unwrap()];
    check(&detect(&room, &model, &more), 0, &["data set of 4 frames"]);
    let rows = rows(&out);
    assert!(!rows.is_empty());
    assert_eq!(names(&out).len(), 5);
    let script = format!("scripted:{}", out.join("detections.csv").display());
    let run = |detector: &str, to: &str| {
        let to = dir.path().join(to);
        let output = program()
            .arg("run")
            .arg(&room)
            .args(["--detector", detector, "--runtime", "rten", "--out"])
            .arg(&to)
            .output()
            .unwrap();
        check(&output, 0, &[]);
        let summary = std::fs::read(to.join("summary.json")).unwrap();
        serde_json::from_slice::<serde_json::Value>(&summary).unwrap()
    };
    let played = run(&script, "played");
    assert_eq!(played["detector"]["detections"], rows.len());
    let live = run(model.to_str().unwrap(), "live");
    let reported = &live["detector"];
    assert_eq!(reported["frames"], 4);
    assert_eq!(reported["head"], "yolox");
    assert_eq!(reported["threads"], 1);
    assert!(reported["runtime"].as_str().unwrap().starts_with("rten "));
    let stages = live["timing_ms"].as_array().unwrap();
    for part in ["detect", "letterbox", "network", "decode"] {
        assert!(
            stages.iter().any(|s| s["stage"] == part),
            "{part}: {stages:?}"
        );
    }
}

#[test]
fn unreadable_images_are_skipped_and_reported() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("in");
    std::fs::create_dir(&folder).unwrap();
    let model = tiny_model::write(dir.path());
    std::fs::write(folder.join("1.png"), "no image").unwrap();
    let output = detect(&folder, &model, &[]);
    check(&output, 2, &["skipped: ", "1.png", "found none among 1"]);
    picture(&folder.join("2.png"), 0, 0);
    let out = dir.path().join("out");
    let output = detect(&folder, &model, &["--out", out.to_str().unwrap()]);
    check(
        &output,
        1,
        &["skipped: ", "1.png", "numbers in their names"],
    );
    assert!(stdout(&output).contains("1 images skipped"));
    assert!(rows(&out).iter().all(|r| r.stamp == 2.0));
}

#[test]
fn unusable_detect_input_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let model = tiny_model::write(dir.path());
    let file = dir.path().join("a.png");
    picture(&file, 0, 0);
    let empty = dir.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    check(&detect(&empty, &model, &[]), 2, &["found an empty folder"]);
    let nothing = dir.path().join("nothing");
    check(&detect(&nothing, &model, &[]), 2, &["found nothing"]);
    check(
        &detect(dir.path(), &model, &["--out", dir.path().to_str().unwrap()]),
        2,
        &["found the same"],
    );
    check(&detect(&file, &model, &["--score", "0"]), 2, &["score"]);
    check(
        &detect(&file, &model, &["--threads", "0"]),
        2,
        &["--threads"],
    );
    let missing = dir.path().join("missing.onnx");
    check(
        &detect(&file, &missing, &[]),
        2,
        &["missing.onnx", "check the path"],
    );
    check(
        &detect(&file, Path::new("yolox_nano"), &[]),
        2,
        &[
            "--model",
            "did you mean \"yolox-nano\"?",
            "models pull yolox-nano",
        ],
    );
    let output = program().arg("detect").arg(&file).output().unwrap();
    check(&output, 2, &["--model: expected a model", "models pull"]);
    // A card beside the model is used, even if wrong.
    std::fs::write(dir.path().join("tiny.toml"), "head = \"yolo\"\n").unwrap();
    check(&detect(&file, &model, &[]), 2, &["tiny.toml", "yolox"]);
}

/// With networks and images of people, if available.
#[test]
fn real_networks_find_people_in_pictures() {
    let Some(folder) = stillpoint_testdata::beside("images") else {
        return;
    };
    for (model, people) in [("yolox_nano_416.onnx", 3), ("picodet_s_416_coco.onnx", 3)] {
        let Some(model) = stillpoint_testdata::beside(&format!("models/{model}")) else {
            continue;
        };
        let dir = tempfile::tempdir().unwrap();
        let more = ["--score", "0.4", "--out", dir.path().to_str().unwrap()];
        check(&detect(&folder, &model, &more), 0, &[]);
        let rows = rows(dir.path());
        let found = rows.iter().filter(|r| r.detection.class == ClassId::PERSON);
        assert!(found.count() >= people, "{rows:?}");
    }
}
