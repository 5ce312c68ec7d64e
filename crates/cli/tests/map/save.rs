//! When a run saves its map, and when it does not.

use super::{SAVED, json, saved};
use crate::common::{case::Case, check, files, program, shell, stdout, stillpoint};
use std::io::Read;
use std::path::Path;
use std::process::Command;
use stillpoint::map::MapFile;

#[test]
fn saved_map_matches_the_run() {
    let bytes = std::fs::read(saved()).unwrap();
    let map = MapFile::from_bytes(&bytes).unwrap().map;
    assert_eq!(map.check(), Ok(()));
    let out = SAVED.path().join("out");
    let summary = json(&std::fs::read(out.join("summary.json")).unwrap());
    assert_eq!(summary["map"]["bytes"], bytes.len());
    assert_eq!(summary["map"]["keyframes"], summary["keyframes"]);
    assert_eq!(summary["map"]["landmarks"], summary["landmarks"]);
    assert_eq!(summary["keyframes"], map.view().keyframe_count());
    let landmarks = map.view().landmark_count();
    assert_eq!(summary["landmarks"], landmarks);
    assert!(map.view().keyframe_count() > 2 && landmarks > 100);

    let output = stillpoint([
        "map".as_ref(),
        "info".as_ref(),
        saved().as_os_str(),
        "--json".as_ref(),
    ]);
    check(&output, 0, &[]);
    let info = json(&output.stdout);
    assert_eq!(info["keyframes"], summary["keyframes"]);
    assert_eq!(info["landmarks"], landmarks);
    assert_eq!(info["bytes"], bytes.len());
    assert_eq!(info["submaps"].as_array().unwrap().len(), 1);
    assert_eq!(info["submaps"][0]["keyframes"], summary["keyframes"]);
    assert_eq!(info["format"], 2);
    assert_eq!(info["cameras"][0]["width"], 640);
    assert!(info["observations"].as_u64().unwrap() > landmarks as u64);
    let number = |name: &str| info[name].as_f64().unwrap();
    assert!((0.05..5.0).contains(&number("path_length")), "{info}");
    let span = info["stamps"][1].as_f64().unwrap() - info["stamps"][0].as_f64().unwrap();
    assert!((0.5..3.1).contains(&span), "{info}");
    let text = stdout(&stillpoint([
        "map".as_ref(),
        "info".as_ref(),
        saved().as_os_str(),
    ]));
    for part in ["keyframes    ", "640x480 px", "5 levels", "submaps      1"] {
        assert!(text.contains(part), "{part:?} is not in {text}");
    }

    let output = stillpoint(["map".as_ref(), "check".as_ref(), saved().as_os_str()]);
    check(&output, 0, &[]);
    assert!(stdout(&output).contains("room.spmap: ok"));
}

#[test]
fn unwritable_map_path_is_reported_before_the_run() {
    let case = Case::new();
    let map = case.dir.path().join("maps/room.spmap");
    let arguments = ["--save-map", map.to_str().unwrap()];
    case.fails(&arguments, &["room.spmap", "another with --save-map"]);
    std::fs::create_dir(map.parent().unwrap()).unwrap();
    std::fs::create_dir(&map).unwrap();
    case.fails(&arguments, &["room.spmap", "another with --save-map"]);
    std::fs::remove_dir(&map).unwrap();
    std::fs::write(&map, "old").unwrap();
    let mut protected = map.metadata().unwrap().permissions();
    protected.set_readonly(true);
    std::fs::set_permissions(&map, protected).unwrap();
    case.fails(&arguments, &["room.spmap", "write-protected"]);
    assert_eq!(std::fs::read(&map).unwrap(), b"old");
    assert_eq!(files(map.parent().unwrap()), std::slice::from_ref(&map));
    if cfg!(target_os = "linux") {
        // Not even the superuser can write here.
        let nowhere = ["--save-map", "/proc/room.spmap"];
        case.fails(&nowhere, &["/proc/room.spmap", "another with --save-map"]);
        // The run completes, and its result is written.
        let output = case.run(&["--save-map", "/dev/full"]);
        check(&output, 2, &["/dev/full", "free space", "--save-map"]);
        assert!(case.out().join("summary.json").exists());
    }
}

/// A file size limit acts like a full disk: writing fails half-way.
#[test]
#[cfg(unix)]
fn full_disk_keeps_the_old_map() {
    let case = Case::new();
    let map = case.dir.path().join("maps/room.spmap");
    std::fs::create_dir(map.parent().unwrap()).unwrap();
    std::fs::copy(saved(), &map).unwrap();
    let output = shell(
        "trap '' XFSZ; ulimit -f 20; exec \"$0\" run \"$1\" --out \"$2\" --save-map \"$3\"",
        [case.room(), case.out(), map.clone()],
    );
    check(&output, 2, &["expected to write it", "free space"]);
    assert_eq!(
        std::fs::read(&map).unwrap(),
        std::fs::read(saved()).unwrap()
    );
    assert_eq!(files(map.parent().unwrap()), [map]);
}

#[test]
#[cfg(unix)]
fn interrupted_run_saves_its_map() {
    let dir = tempfile::tempdir().unwrap();
    let map = dir.path().join("half.spmap");
    let mut child = program()
        .args(["-v", "run"])
        .arg(SAVED.path().join("room"))
        .arg("--out")
        .arg(dir.path().join("out"))
        .arg("--save-map")
        .arg(&map)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = std::io::BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    while !line.contains("mapped") {
        line.clear();
        let read = std::io::BufRead::read_line(&mut said, &mut line).unwrap();
        assert!(read > 0, "the program ended");
    }
    let kill = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    assert!(kill.unwrap().success());
    let mut rest = String::new();
    said.read_to_string(&mut rest).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(1), "{rest}");
    assert!(rest.contains("interrupted after"), "{rest}");
    let half = MapFile::from_bytes(&std::fs::read(&map).unwrap())
        .unwrap()
        .map;
    assert!(half.view().landmark_count() > 0);
}

/// A run that loses track saves its map; one without a map leaves the older file.
#[test]
fn run_that_loses_track_saves_its_map() {
    let case = Case::new();
    let map = case.dir.path().join("room.spmap");
    let arguments = ["--save-map", map.to_str().unwrap()];
    let black = |path: &Path| {
        image::GrayImage::new(640, 480).save(path).unwrap();
    };
    case.images("rgb", |i| i > 5, black);
    check(&case.run(&arguments), 1, &["no pose in frames"]);
    let bytes = std::fs::read(&map).unwrap();
    let view = MapFile::from_bytes(&bytes).unwrap().map;
    assert!(view.view().landmark_count() > 0);
    case.images("rgb", |_| true, black);
    check(&case.run(&arguments), 1, &["no keyframe", "untouched"]);
    assert_eq!(std::fs::read(&map).unwrap(), bytes);
    let mut hidden = files(case.dir.path());
    hidden.retain(|p| p.extension().is_some_and(|e| e == "tmp"));
    assert!(hidden.is_empty(), "{hidden:?}");
}
