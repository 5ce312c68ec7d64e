//! Map files as users have them: saved by a run, looked at, exported, damaged.

use crate::common::{case::Case, check, files, program, shell, simulate, stdout, stillpoint};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;
use stillpoint::geometry::{Mat6, Se3, Vec3};
use stillpoint::map::{Correction, KeyframeId, LoopEdge, MapFile};
use tempfile::TempDir;

const FRAMES: usize = 90;

/// A recording, and what a run that saved its map left.
static SAVED: LazyLock<TempDir> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    simulate(&dir.path().join("room"), "halfsphere", FRAMES);
    let output = run(dir.path(), &dir.path().join("room.spmap"));
    check(&output, 0, &[]);
    let said = stdout(&output);
    assert!(said.contains("map saved to") && said.contains("room.spmap"));
    dir
});

/// Runs the recording that is in a folder.
fn run(folder: &Path, map: &Path) -> Output {
    let mut command = program();
    command.arg("run").arg(folder.join("room")).arg("--out");
    command.arg(folder.join("out")).arg("--save-map").arg(map);
    command.output().unwrap()
}

fn saved() -> PathBuf {
    SAVED.path().join("room.spmap")
}

fn json(text: &[u8]) -> serde_json::Value {
    serde_json::from_slice(text).unwrap()
}

#[test]
fn a_saved_map_is_the_one_that_was_made() {
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
    assert_eq!(info["format"], 1);
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
    for part in ["keyframes    ", "640x480 px", "8 levels", "submaps      1"] {
        assert!(text.contains(part), "{part:?} is not in {text}");
    }

    let output = stillpoint(["map".as_ref(), "check".as_ref(), saved().as_os_str()]);
    check(&output, 0, &[]);
    assert!(stdout(&output).contains("room.spmap: ok"));
}

#[test]
fn exports_hold_what_is_in_the_map() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let export = |options: &[(&str, PathBuf)]| {
        let mut command = program();
        command.args(["map", "export"]).arg(saved());
        for (option, path) in options {
            command.arg(option).arg(path);
        }
        command.output().unwrap()
    };
    let all = [
        ("--points", path("a.ply")),
        ("--trajectory", path("a.txt")),
        ("--graph", path("a.g2o")),
    ];
    check(&export(&all), 0, &[]);
    let map = MapFile::from_bytes(&std::fs::read(saved()).unwrap())
        .unwrap()
        .map;
    let view = map.view();

    let ply = std::fs::read(path("a.ply")).unwrap();
    let end = b"end_header\n";
    let at = ply.windows(end.len()).position(|w| w == end).unwrap() + end.len();
    let head = std::str::from_utf8(&ply[..at]).unwrap();
    assert!(head.contains(&format!("element vertex {}\n", view.landmark_count())));
    assert_eq!(ply.len() - at, 40 * view.landmark_count());
    let (id, landmark) = view.landmarks().next().unwrap();
    let float = |i: usize| f32::from_le_bytes(ply[at + 4 * i..at + 4 * i + 4].try_into().unwrap());
    let position = view.landmark_position(id).unwrap();
    assert_eq!([0, 1, 2].map(float), position.map(|x| x as f32).data.0[0]);
    let normal: f32 = (3..6).map(|i| float(i) * float(i)).sum();
    assert!((normal - 1.0).abs() < 1e-5);
    // It points to the camera that saw the landmark.
    let seen_from = view.keyframe(landmark.anchor).unwrap().centre();
    let towards = (0..3).map(|i| f64::from(float(3 + i)) * (seen_from - position)[i]);
    assert!(towards.sum::<f64>() > 0.0);
    let observers = u32::from_le_bytes(ply[at + 24..at + 28].try_into().unwrap());
    assert_eq!(observers, landmark.observers);

    let trajectory = std::fs::read(path("a.txt")).unwrap();
    let of_run = std::fs::read(SAVED.path().join("out/keyframes.txt")).unwrap();
    assert!(trajectory == of_run, "not the keyframes of the run");

    let graph = std::fs::read_to_string(path("a.g2o")).unwrap();
    let count = |tag: &str| graph.lines().filter(|l| l.starts_with(tag)).count();
    assert_eq!(count("VERTEX_SE3:QUAT "), view.keyframe_count());
    assert!(count("EDGE_SE3:QUAT ") >= view.keyframe_count() - 1);
    // Each edge is near what the poses of the map say, and most are not what they say: they were measured by two keyframes alone.
    let (mut off, mut exact) = (Vec::new(), 0);
    for line in graph.lines().filter(|l| l.starts_with("EDGE_SE3:QUAT ")) {
        let numbers: Vec<f64> = line
            .split(' ')
            .skip(1)
            .map(|n| n.parse().unwrap())
            .collect();
        assert_eq!(numbers.len(), 2 + 7 + 21, "{line}");
        let of = |n: f64| {
            view.keyframe(KeyframeId(n as u32))
                .unwrap()
                .world_from_camera
        };
        let estimated = of(numbers[0]).inverse() * of(numbers[1]);
        let difference = (0..3).map(|i| (estimated.translation[i] - numbers[2 + i]).abs());
        let difference = difference.fold(0.0, f64::max);
        off.push(difference);
        exact += usize::from(difference < 1e-8);
        // What is known of a motion differs from direction to direction; an edge with weight says so.
        assert!(numbers[9] > 0.0 && numbers[9] != numbers[9 + 11], "{line}");
    }
    off.sort_by(f64::total_cmp);
    assert!(exact == 0 && off[off.len() / 2] < 0.01, "{exact} {off:?}");

    check(&export(&[]), 2, &["--points"]);
    let nowhere = export(&[("--points", path("no/a.ply"))]);
    check(&nowhere, 2, &["no/a.ply", "another with --points"]);
    let folder = export(&[("--graph", dir.path().to_owned())]);
    check(&folder, 2, &["another with --graph"]);
    assert_eq!(files(dir.path()).len(), 3);
}

#[test]
fn the_ending_of_a_file_says_which_cloud_it_is() {
    let dir = tempfile::tempdir().unwrap();
    let export = |name: &str| {
        let mut command = program();
        command.args(["map", "export"]).arg(saved()).arg("--points");
        command.arg(dir.path().join(name)).output().unwrap()
    };
    check(&export("a.pcd"), 0, &[]);
    check(&export("a.ply"), 0, &[]);
    let [pcd, ply] = ["a.pcd", "a.ply"].map(|n| std::fs::read(dir.path().join(n)).unwrap());
    assert!(
        pcd.starts_with(b"# .PCD v0.7"),
        "a PLY file under the name of a PCD"
    );
    let rows = |bytes: &[u8], end: &[u8]| {
        let at = bytes.windows(end.len()).position(|w| w == end).unwrap();
        bytes[at + end.len()..].to_vec()
    };
    assert!(rows(&pcd, b"DATA binary\n") == rows(&ply, b"end_header\n"));
    for name in ["a.xyz", "cloud"] {
        let parts = ["--points", name, "ends with .ply or .pcd"];
        check(&export(name), 2, &parts);
        assert!(!dir.path().join(name).exists());
    }
}

#[test]
fn loops_are_exported_as_they_were_measured() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let bytes = std::fs::read(saved()).unwrap();
    let mut map = MapFile::from_bytes(&bytes).unwrap().map;
    let ends: Vec<KeyframeId> = map.view().keyframes().map(|k| k.id).collect();
    let (old, new) = (ends[0], ends[ends.len() - 1]);
    let old_from_new = Se3::new(Default::default(), Vec3::new(0.125, -0.25, 0.5));
    map.apply(&Correction {
        measured: Some(Box::new(LoopEdge {
            old,
            new,
            old_from_new,
            information: Mat6::identity() * 400.0,
            inliers: 57,
        })),
        ..Correction::default()
    });
    std::fs::write(path("looped.spmap"), map.to_bytes(&[]).unwrap()).unwrap();
    let command = |args: &[&str]| {
        let mut command = program();
        command.arg("map").args(args).current_dir(dir.path());
        command.output().unwrap()
    };
    let output = command(&["export", "looped.spmap", "--graph", "a.g2o"]);
    check(&output, 0, &[]);
    assert!(stdout(&output).contains("edges, 1 of loops"));
    let graph = std::fs::read_to_string(path("a.g2o")).unwrap();
    let last = graph.lines().last().unwrap();
    let expected = format!(
        "EDGE_SE3:QUAT {old} {new} 0.125000000 -0.250000000 0.500000000 0.000000000 0.000000000 0.000000000 1.000000000 \
         400 0 0 0 0 0 400 0 0 0 0 400 0 0 0 1600 0 0 1600 0 1600"
    );
    assert_eq!(last, expected);
    let info = command(&["info", "looped.spmap", "--json"]);
    assert_eq!(json(&info.stdout)["loops"], 1);
    let whole = command(&["check", "looped.spmap"]);
    check(&whole, 0, &[]);
}

/// `check` says 1 of what is no map; whoever needs the map says 2.
#[test]
fn files_that_are_no_maps_are_refused_with_a_reason() {
    let dir = tempfile::tempdir().unwrap();
    let good = std::fs::read(saved()).unwrap();
    let path = dir.path().join("odd.spmap");
    let refused = |bytes: &[u8], parts: &[&str]| {
        std::fs::write(&path, bytes).unwrap();
        let file = path.to_str().unwrap();
        let parts = [parts, &["odd.spmap: expected", "found"]].concat();
        check(&stillpoint(["map", "check", file]), 1, &parts);
        check(&stillpoint(["map", "info", file]), 2, &parts);
        let ply = dir.path().join("odd.ply");
        let export = ["map", "export", file, "--points", ply.to_str().unwrap()];
        check(&stillpoint(export), 2, &parts);
        assert!(!ply.exists());
    };
    refused(b"", &["its end is missing"]);
    refused(b"ply\nformat ascii 1.0\n", &["another kind of file"]);
    refused(&good[..good.len() / 2], &["its end is missing"]);
    refused(&good[..20], &["its end is missing"]);
    refused(&[&good[..], b"x"].concat(), &["something was added"]);
    let mut bytes = good.clone();
    bytes[good.len() / 2] ^= 1;
    refused(&bytes, &["checksum", "damaged after it was written"]);
    let mut bytes = good.clone();
    bytes[8] = 2;
    let checksum = crc32(&bytes[..24]);
    bytes[24..28].copy_from_slice(&checksum.to_le_bytes());
    refused(&bytes, &["version 2", "a later version"]);
    // Larger than any that is read, as the header says.
    let mut bytes = good;
    bytes[23] = 1;
    let checksum = crc32(&bytes[..24]);
    bytes[24..28].copy_from_slice(&checksum.to_le_bytes());
    refused(&bytes, &["at most", "as a whole"]);

    for (file, part) in [
        (dir.path().join("none.spmap"), "check that it exists"),
        (dir.path().to_owned(), "is a directory"),
    ] {
        let file = file.to_str().unwrap();
        for command in ["check", "info"] {
            check(&stillpoint(["map", command, file]), 2, &[file, part]);
        }
    }
    // Not read to its end, which does not come.
    if cfg!(target_os = "linux") {
        check(
            &stillpoint(["map", "check", "/dev/zero"]),
            1,
            &["/dev/zero"],
        );
    }
}

/// CRC-32 as in zlib and PNG, from its definition: what the format says, not what the program does.
fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 {
                crc >> 1 ^ 0xedb8_8320
            } else {
                crc >> 1
            };
        }
    }
    !crc
}

/// A small file whose counts ask for gigabytes, with checksums that are right.
#[test]
#[cfg(target_os = "linux")]
fn huge_counts_take_no_memory() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("greedy.spmap");
    let good = std::fs::read(saved()).unwrap();
    // The first section is "header": kind, compression, length of the name, name, two lengths, checksum.
    assert_eq!(&good[28..37], b"\x00\x00\x06header");
    let (begin, content) = (28, 28 + 9 + 20);
    let length = u64::from_le_bytes(good[37..45].try_into().unwrap()) as usize;
    // Version and features in 8 bytes each, then counts in 4 each: cameras, slots of keyframes, keyframes, tombstones, pairs,
    // slots of landmarks, landmarks, levels.
    let places = [
        (8, 8),
        (16, 4),
        (20, 4),
        (24, 4),
        (28, 4),
        (32, 4),
        (36, 4),
        (40, 4),
        (44, 4),
    ];
    for (at, size) in places {
        for value in [u64::MAX, 1 << 31, 1 << 24] {
            let mut bytes = good.clone();
            let place = content + at..content + at + size;
            bytes[place].copy_from_slice(&value.to_le_bytes()[..size]);
            let section = [
                &bytes[begin..content - 4],
                &bytes[content..content + length],
            ]
            .concat();
            bytes[content - 4..content].copy_from_slice(&crc32(&section).to_le_bytes());
            let end = bytes.len() - 4;
            let whole = crc32(&bytes[..end]);
            bytes[end..].copy_from_slice(&whole.to_le_bytes());
            std::fs::write(&path, &bytes).unwrap();
            // A quarter of a gigabyte, of which the program itself takes a part.
            let output = shell(
                "ulimit -v 262144; exec \"$0\" map check \"$1\"",
                [path.as_os_str()],
            );
            // That many ids of keyframes are possible, if most of them are not used.
            let code = i32::from((at, value) != (20, 1 << 24));
            check(&output, code, &[]);
        }
    }
}

#[test]
fn a_map_that_cannot_be_written_is_reported_before_the_run() {
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
        // The run goes on to its end, and its result is there.
        let output = case.run(&["--save-map", "/dev/full"]);
        check(&output, 2, &["/dev/full", "free space", "--save-map"]);
        assert!(case.out().join("summary.json").exists());
    }
}

/// A limit on file sizes acts as a full disk does: writing fails half-way.
#[test]
#[cfg(unix)]
fn a_full_disk_does_not_harm_the_old_map() {
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

/// What was learned until then is saved.
#[test]
#[cfg(unix)]
fn an_interrupted_run_saves_its_map() {
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

/// A run that loses track saves what it has; one that finds nothing leaves the older map.
#[test]
fn a_run_that_is_lost_saves_what_it_has() {
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
