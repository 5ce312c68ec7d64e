//! Maps in the formats of other programs.

use super::{SAVED, json, saved};
use crate::common::{check, files, program, stdout};
use std::path::PathBuf;
use stillpoint::geometry::{Mat6, Se3, Vec3};
use stillpoint::map::{Correction, KeyframeId, LoopEdge, MapFile};

#[test]
fn exports_match_the_map_content() {
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
    // The normal points to a camera that saw the landmark.
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
    // Each edge is close to the map's relative pose, but most differ from it: they were measured from two keyframes alone.
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
        // The information differs between directions.
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
fn file_extension_selects_the_point_cloud_format() {
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
fn loops_are_exported_as_measured() {
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
