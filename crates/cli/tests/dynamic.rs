//! Moving objects from the command line: simulated movers, detectors, verdicts and images.

use crate::common::{check, copy, files, program, simulate, stdout};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use stillpoint::detection::{Detector, ScriptedDetector};
use tempfile::TempDir;

const FRAMES: usize = 12;

static WALKING: LazyLock<TempDir> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    simulate(&dir.path().join("room"), "walking_static", FRAMES);
    dir
});

fn room() -> PathBuf {
    WALKING.path().join("room")
}

fn scripted(room: &Path) -> String {
    format!("scripted:{}", room.join("detections.csv").display())
}

fn run(room: &Path, out: &Path, more: &[&str]) -> std::process::Output {
    program()
        .arg("run")
        .arg(room)
        .arg("--out")
        .arg(out)
        .args(more)
        .output()
        .unwrap()
}

fn summary(out: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(out.join("summary.json")).unwrap()).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let name = |p: &PathBuf| p.file_name().unwrap().to_str().unwrap().to_owned();
    files(folder).iter().map(name).collect()
}

/// Rows of a table without its header, by stamp.
fn by_stamp(table: &Path, header: &str) -> BTreeMap<String, Vec<Vec<String>>> {
    let text = std::fs::read_to_string(table).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some(header));
    let mut rows: BTreeMap<String, Vec<Vec<String>>> = BTreeMap::new();
    for line in lines {
        let columns: Vec<String> = line.split(',').map(str::to_owned).collect();
        assert_eq!(columns.len(), header.split(',').count(), "{line}");
        rows.entry(columns[0].clone()).or_default().push(columns);
    }
    rows
}

fn verdicts(table: &Path) -> BTreeMap<String, Vec<Vec<String>>> {
    by_stamp(table, "timestamp,u,v,verdict,reasons")
}

fn stamps(room: &Path) -> Vec<String> {
    let name = |p: &PathBuf| p.file_stem().unwrap().to_str().unwrap().to_owned();
    files(&room.join("rgb")).iter().map(name).collect()
}

#[test]
fn simulated_boxes_match_the_masks() {
    let header = "timestamp,mover,x0,y0,x1,y1,visible_px,px,py,pz,vx,vy,vz";
    let rows = by_stamp(&room().join("boxes.csv"), header);
    let mut boxes = 0;
    for stamp in stamps(&room()) {
        let path = room().join("mask").join(format!("{stamp}.png"));
        let mask = image::open(&path).unwrap().into_luma8();
        assert_eq!(mask.dimensions(), (640, 480));
        let mut found: BTreeMap<u8, ([u32; 4], usize)> = BTreeMap::new();
        for (x, y, pixel) in mask.enumerate_pixels().filter(|p| p.2.0[0] > 0) {
            let (b, count) = found.entry(pixel.0[0]).or_insert(([x, y, x, y], 0));
            *b = [b[0].min(x), b[1].min(y), b[2].max(x), b[3].max(y)];
            *count += 1;
        }
        let expected: Vec<Vec<String>> = found
            .iter()
            .map(|(mover, ([x0, y0, x1, y1], count))| {
                let [x0, y0] = [x0, y0].map(|v| format!("{:.1}", f64::from(*v) - 0.5));
                let [x1, y1] = [x1, y1].map(|v| format!("{:.1}", f64::from(*v) + 0.5));
                let numbers = [mover.to_string(), x0, y0, x1, y1, count.to_string()];
                std::iter::once(stamp.clone()).chain(numbers).collect()
            })
            .collect();
        boxes += expected.len();
        let none = Vec::new();
        // The columns after the box are position and velocity, which masks do not give.
        let found = rows.get(&stamp).unwrap_or(&none).iter();
        let found: Vec<Vec<String>> = found.map(|row| row[..7].to_vec()).collect();
        assert_eq!(found, expected);
    }
    assert!(boxes >= FRAMES, "{boxes} boxes: nobody walks");
    assert_eq!(names(&room().join("mask")).len(), FRAMES);
}

#[test]
fn static_scenes_have_no_masks() {
    let dir = tempfile::tempdir().unwrap();
    simulate(&dir.path().join("room"), "xyz", 2);
    let names = names(&dir.path().join("room"));
    let expected = [
        "camera.toml",
        "depth",
        "depth.txt",
        "groundtruth.txt",
        "rgb",
        "rgb.txt",
    ];
    assert_eq!(names, expected);
}

#[test]
fn verdicts_cover_every_keypoint_of_every_frame() {
    let dir = tempfile::tempdir().unwrap();
    let (out, table) = (dir.path().join("out"), dir.path().join("v.csv"));
    let script = scripted(&room());
    let more = ["--detector", &script, "--verdicts", table.to_str().unwrap()];
    let output = run(&room(), &out, &more);
    check(&output, 0, &[]);
    let summary = summary(&out);

    let text = std::fs::read_to_string(room().join("detections.csv")).unwrap();
    let detector = ScriptedDetector::parse("script", &text).unwrap();
    let detections = detector.rows().len();
    assert!(detections > FRAMES / 2, "{detections} detections");
    let reported = &summary["detector"];
    assert_eq!(reported["kind"], "scripted");
    assert_eq!(
        reported["name"],
        room().join("detections.csv").to_str().unwrap()
    );
    assert_eq!(reported["sha256"], detector.info().sha256.unwrap());
    assert_eq!(reported["frames"], FRAMES);
    assert_eq!(reported["detections"], detections);
    assert_eq!(reported["failed_frames"], 0);

    let rows = verdicts(&table);
    assert_eq!(rows.keys().cloned().collect::<Vec<_>>(), stamps(&room()));
    let (mut all, mut dynamic) = (0, 0);
    for row in rows.values().flatten() {
        let at: Vec<f64> = row[1..3].iter().map(|c| c.parse().unwrap()).collect();
        assert!((0.0..640.0).contains(&at[0]) && (0.0..480.0).contains(&at[1]));
        match row[3].as_str() {
            "dynamic" => dynamic += 1,
            other => assert_eq!(other, "static"),
        }
        let words = [
            "", "object", "epipolar", "depth", "rigid", "age", "parked", "released",
        ];
        assert!(row[4].split('+').all(|r| words.contains(&r)), "{row:?}");
        assert!(
            row[3] == "static" || !row[4].is_empty(),
            "no reason: {row:?}"
        );
        all += 1;
    }
    assert_eq!(summary["features"]["keypoints"], all);
    assert_eq!(summary["features"]["dynamic"], dynamic);
    assert!(dynamic > 0 && all > 100 * FRAMES, "{dynamic} of {all}");

    let stages = summary["timing_ms"].as_array().unwrap();
    for name in ["detect", "filter"] {
        assert!(stages.iter().any(|s| s["stage"] == name), "no stage {name}");
    }
    let said = stdout(&output);
    for part in ["detector: scripted", &format!("{all} verdicts in")] {
        assert!(said.contains(part), "{said} lacks {part}");
    }
}

#[test]
fn verdicts_need_no_detector() {
    let dir = tempfile::tempdir().unwrap();
    let (out, table) = (dir.path().join("out"), dir.path().join("v.csv"));
    let output = run(&room(), &out, &["--verdicts", table.to_str().unwrap()]);
    check(&output, 0, &[]);
    all_keypoints_are_there(&room(), &out, &table);
    assert_eq!(summary(&out)["detector"]["kind"], "none");
    assert!(stdout(&output).contains("detector: none"));
}

#[test]
fn verdicts_need_no_pose() {
    let dir = tempfile::tempdir().unwrap();
    let (other, out) = (dir.path().join("other"), dir.path().join("out"));
    let spoiled = dir.path().join("room");
    simulate(&other, "halfsphere", 3);
    copy(&room(), &spoiled);
    // The last frames show another room: enough keypoints, but no matches to the map.
    let (theirs, ours) = (files(&other.join("rgb")), files(&spoiled.join("rgb")));
    for (from, to) in theirs.iter().zip(&ours[FRAMES - 3..]) {
        std::fs::copy(from, to).unwrap();
    }
    let table = dir.path().join("v.csv");
    let output = run(&spoiled, &out, &["--verdicts", table.to_str().unwrap()]);
    check(&output, 1, &["no pose in frames 9 to 11"]);
    all_keypoints_are_there(&spoiled, &out, &table);
}

/// Checks that every frame has a row per keypoint.
fn all_keypoints_are_there(room: &Path, out: &Path, table: &Path) {
    let rows = verdicts(table);
    assert_eq!(rows.keys().cloned().collect::<Vec<_>>(), stamps(room));
    for (stamp, rows) in &rows {
        assert!(rows.len() > 100, "{stamp}: {} rows", rows.len());
    }
    let all: usize = rows.values().map(Vec::len).sum();
    assert_eq!(summary(out)["features"]["keypoints"], all);
}

#[test]
fn filter_can_be_turned_off() {
    let dir = tempfile::tempdir().unwrap();
    let table = dir.path().join("v.csv");
    let more = [
        "--set",
        "static_filter.preset=off",
        "--verdicts",
        table.to_str().unwrap(),
    ];
    check(&run(&room(), &dir.path().join("out"), &more), 0, &[]);
    assert!(
        verdicts(&table)
            .values()
            .flatten()
            .all(|row| row[3..] == ["static", ""])
    );
}

fn gif_width(path: &Path) -> u16 {
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(&bytes[..6], b"GIF89a");
    u16::from_le_bytes([bytes[6], bytes[7]])
}

#[test]
fn overlay_pictures_decode_and_replace_older_ones() {
    let dir = tempfile::tempdir().unwrap();
    let pictures = dir.path().join("pictures");
    std::fs::create_dir(&pictures).unwrap();
    for name in ["000001.png", "animation.png", "mine.png"] {
        std::fs::write(pictures.join(name), "old").unwrap();
    }
    let script = scripted(&room());
    let folder = pictures.to_str().unwrap();
    let more = [
        "--detector",
        &script,
        "--overlay",
        folder,
        "--overlay-every",
        "5",
    ];
    let output = run(&room(), &dir.path().join("out"), &more);
    check(&output, 0, &[]);
    assert!(stdout(&output).contains("3 pictures and animation.gif"));
    let expected = [
        "000000.png",
        "000005.png",
        "000010.png",
        "animation.gif",
        "mine.png",
    ];
    assert_eq!(names(&pictures), expected);
    for name in &expected[..3] {
        let picture = image::open(pictures.join(name)).unwrap().into_rgb8();
        // The image, and below it a line of text and the legend.
        assert_eq!(picture.width(), 640);
        assert!(
            (510..560).contains(&picture.height()),
            "{}",
            picture.height()
        );
        let green = picture.pixels().filter(|p| p.0 == [30, 200, 110]).count();
        assert!(green > 500, "{green} px of static features");
        let coloured = picture
            .rows()
            .take(480)
            .flatten()
            .filter(|p| p.0[0] != p.0[1]);
        assert!(coloured.count() > 640 * 480 / 2, "the image is grey");
    }
    assert_eq!(gif_width(&pictures.join("animation.gif")), 320);
    // Drawing does not change the results.
    let plain = dir.path().join("plain");
    check(&run(&room(), &plain, &["--detector", &script]), 0, &[]);
    let poses = |out: &Path| std::fs::read(out.join("trajectory.txt")).unwrap();
    assert!(
        poses(&dir.path().join("out")) == poses(&plain),
        "the poses differ"
    );
}

#[test]
fn outputs_may_share_a_folder() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("new/out");
    let (folder, table) = (out.to_str().unwrap(), out.join("v.csv"));
    let more = [
        "--overlay",
        folder,
        "--overlay-every",
        "9",
        "--verdicts",
        table.to_str().unwrap(),
    ];
    check(&run(&room(), &out, &more), 0, &[]);
    let names = names(&out);
    for name in [
        "000009.png",
        "animation.gif",
        "trajectory.txt",
        "plot.png",
        "v.csv",
    ] {
        assert!(names.iter().any(|n| n == name), "{names:?} lacks {name}");
    }
    assert!(names.iter().all(|n| !n.starts_with('.')), "{names:?}");
}

#[test]
fn summary_names_network_checksum_and_runtime() {
    let Some(model) = stillpoint_testdata::beside("models/yolox_nano_416.onnx") else {
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    let model = model.to_str().unwrap();
    let more = [
        "--detector",
        model,
        "--runtime",
        "rten",
        "--max-frames",
        "3",
    ];
    check(&run(&room(), dir.path(), &more), 0, &[]);
    let detector = &summary(dir.path())["detector"];
    assert_eq!(detector["kind"], "onnx");
    assert_eq!(detector["frames"], 3);
    assert_eq!(detector["sha256"].as_str().unwrap().len(), 64);
    assert!(detector["runtime"].as_str().unwrap().starts_with("rten "));
}
