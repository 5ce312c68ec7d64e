//! Uses of maps: resuming, localisation, submaps, and merging.

use crate::common::{case::Case, check, files, program, simulate, stderr, stdout};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::{Arc, LazyLock};
use stillpoint::geometry::{Se3, Vec3};
use stillpoint::map::{Map, MapFile, SubmapId};
use stillpoint::slam::{Timing, Up};
use tempfile::TempDir;

/// Frequent keyframes, so that a few seconds are enough to recognise a place.
const OFTEN: [&str; 6] = [
    "--set",
    "keyframes.max_view_angle=0",
    "--set",
    "keyframes.min_seconds=0.22",
    "--set",
    "mapping.redundant_share=1",
];

/// A recording `room` and maps `a` of its beginning and `b` of the rest, which overlap, with surfaces; `c` of another room, and `twice`,
/// which holds `c` two times, as two submaps.
static MAPS: LazyLock<TempDir> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    simulate(&dir.path().join("room"), "halfsphere", 64);
    let other = dir.path().join("other");
    let output = program()
        .args(["-q", "simulate", "--jpeg", "--scene", "rpy", "--seed", "7"])
        .args(["--frames", "40", "--out"])
        .arg(&other)
        .output();
    check(&output.unwrap(), 0, &[]);
    for (name, recording, part) in [
        (
            "a",
            "room",
            &["--max-frames", "44", "--dense", "--voxel", "0.04"][..],
        ),
        (
            "b",
            "room",
            &["--start", "14", "--dense", "--voxel", "0.04"],
        ),
        ("c", "other", &[]),
    ] {
        let path = dir.path().join(name).with_extension("spmap");
        let save = ["--save-map", path.to_str().unwrap()];
        let output = run(&dir.path().join(recording), &[part, &save, &OFTEN].concat());
        check(&output.0, 0, &[]);
    }
    let mut twice = read(&dir.path().join("c.spmap"));
    twice.append(&read(&dir.path().join("c.spmap"))).unwrap();
    save(&twice, &dir.path().join("twice.spmap"));
    dir
});

pub(crate) fn map(name: &str) -> PathBuf {
    MAPS.path().join(name).with_extension("spmap")
}

pub(crate) fn read(path: &Path) -> Map {
    Map::from_bytes(&std::fs::read(path).unwrap()).unwrap()
}

fn save(map: &Map, path: &Path) {
    std::fs::write(path, map.to_bytes(&[]).unwrap()).unwrap();
}

fn up_in(path: &Path) -> Option<Vec3> {
    let file = MapFile::from_bytes(&std::fs::read(path).unwrap()).unwrap();
    Some(Up::from_bytes(file.extension(Up::EXTENSION)?)?.vector())
}

fn save_with_up(map: &Map, up: &Vec3, path: &Path) {
    let up = Up::along(up).unwrap().to_extension();
    std::fs::write(path, map.to_bytes(&[up]).unwrap()).unwrap();
}

fn run(recording: &Path, more: &[&str]) -> (Output, TempDir) {
    let out = tempfile::tempdir().unwrap();
    let mut command = program();
    command.arg("run").arg(recording).arg("--out");
    let output = command.arg(out.path()).args(more).output().unwrap();
    (output, out)
}

/// `stillpoint map COMMAND FILES...`.
fn map_command(command: &str, files: &[&Path], more: &[&str]) -> Output {
    let mut program = program();
    program.args(["map", command]).args(files).args(more);
    program.output().unwrap()
}

pub(crate) fn merge(a: &Path, b: &Path, out: &Path) -> Output {
    map_command("merge", &[a, b], &["--out", out.to_str().unwrap()])
}

fn first_frame(out: &Path) -> String {
    let text = std::fs::read_to_string(out.join("frames.csv")).unwrap();
    text.lines().nth(1).unwrap().to_owned()
}

#[test]
fn run_resumes_a_saved_map() {
    let dir = tempfile::tempdir().unwrap();
    let grown = dir.path().join("grown.spmap");
    let arguments = ["--save-map", grown.to_str().unwrap(), "--start", "14"];
    let first = map("a");
    let load = ["--load-map", first.to_str().unwrap()];
    let room = MAPS.path().join("room");
    let (output, out) = run(&room, &[&load[..], &arguments, &OFTEN].concat());
    check(&output, 0, &["resuming map"]);
    let line = first_frame(out.path());
    assert!(line.contains(",relocalised,"), "{line}");
    let (before, after) = (read(&map("a")), read(&grown));
    assert!(after.view().keyframe_count() > before.view().keyframe_count());
    assert_eq!(after.view().submaps().len(), 1);
    for k in before.view().keyframes() {
        assert!(after.view().world_from_keyframe(k.id).is_some());
    }
    // This run started from the readout in the map.
    let bytes = std::fs::read(map("a")).unwrap();
    let extension = MapFile::from_bytes(&bytes).unwrap();
    let known = extension.extension(Timing::EXTENSION).unwrap();
    let [readout, sigma] = Timing::readout_in(known).unwrap();
    assert!(sigma > 0.0 && sigma < 0.02, "{sigma}");
    let config = std::fs::read_to_string(out.path().join("config.toml")).unwrap();
    for line in [
        format!("readout = {readout:?}"),
        format!("readout_sigma = {sigma:?}"),
    ] {
        assert!(config.contains(&line), "{line}: {config}");
    }
    let summary = std::fs::read_to_string(out.path().join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    assert!(
        summary["readout"]["sigma"]
            .as_f64()
            .is_some_and(|s| s < sigma),
        "{summary}"
    );
}

#[test]
fn localize_finds_the_camera_and_keeps_the_map() {
    let bytes = std::fs::read(map("a")).unwrap();
    let path = map("a");
    let arguments = ["--localize", path.to_str().unwrap(), "--start", "14"];
    let part = ["--max-frames", "20"];
    let (output, out) = run(&MAPS.path().join("room"), &[&arguments[..], &part].concat());
    check(&output, 0, &["finding the camera in map"]);
    assert!(stdout(&output).contains("20 of 20 frames tracked"));
    let line = first_frame(out.path());
    assert!(line.contains(",relocalised,"), "{line}");
    assert!(std::fs::read(map("a")).unwrap() == bytes);

    let dir = tempfile::tempdir().unwrap();
    let empty = dir.path().join("empty.spmap");
    save(&Map::new(5, 1.45), &empty);
    let case = Case::new();
    let arguments = ["--localize", empty.to_str().unwrap()];
    case.fails(&arguments, &["empty.spmap: expected a map with keyframes"]);
}

#[test]
fn overlapping_maps_are_merged() {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole.spmap");
    let output = merge(&map("a"), &map("b"), &whole);
    check(&output, 0, &[]);
    let said = stdout(&output);
    assert!(said.contains("1 and 1 submaps became 1"), "{said}");
    let [a, b, both] = [map("a"), map("b"), whole].map(|path| read(&path));
    let count = |m: &Map| m.view().keyframe_count();
    assert_eq!(count(&both), count(&a) + count(&b));
    assert_eq!(both.view().submaps().len(), 1);
    // Keyframes of the same time coincide, whichever map they come from.
    let mut places = BTreeMap::new();
    for k in both.view().keyframes() {
        let stamp = (k.data.stamp * 1e4) as i64;
        if let Some(before) = places.insert(stamp, k.centre()) {
            let off = (k.centre() - before).norm();
            assert!(off < 0.02, "keyframe {} is off by {off} m", k.id);
        }
    }
}

#[test]
fn up_direction_is_kept_and_the_argument_takes_precedence() {
    let dir = tempfile::tempdir().unwrap();
    let [known, grown] = ["known", "grown"].map(|n| dir.path().join(n).with_extension("spmap"));
    let (before, said) = (Vec3::new(0.0, -0.8, 0.6), Vec3::new(0.0, -0.6, 0.8));
    save_with_up(&read(&map("a")), &before, &known);
    let room = MAPS.path().join("room");
    let paths = [&known, &grown].map(|p| p.to_str().unwrap());
    let arguments = ["--load-map", paths[0], "--save-map", paths[1]];
    let part = ["--start", "40", "--max-frames", "4"];
    let run_on = |more: &[&str]| {
        let (output, _out) = run(&room, &[&arguments[..], &part, more].concat());
        check(&output, 0, &[]);
        up_in(&grown)
    };
    assert_eq!(run_on(&[]), Some(before));
    let off = (run_on(&["--up", "0,-6,8"]).unwrap() - said).norm();
    assert!(off < 1e-12, "{off}");
    // Control: maps and arguments without an up direction.
    assert_eq!(up_in(&map("a")), None);
}

#[test]
fn merged_map_keeps_a_known_up_direction() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).with_extension("spmap");
    let (up, other) = (Vec3::new(0.0, -0.8, 0.6), Vec3::new(0.6, -0.8, 0.0));
    let [a, b] = ["a", "b"].map(|name| read(&map(name)));
    save_with_up(&a, &up, &at("a"));
    save_with_up(&b, &other, &at("b"));
    let merged = |first: &Path, second: &Path| {
        check(&merge(first, second, &at("out")), 0, &[]);
        up_in(&at("out"))
    };
    assert_eq!(merged(&at("a"), &at("b")), Some(up));
    assert_eq!(merged(&map("a"), &map("b")), None);
    // If only the second map has one, it is rotated to the first map's world.
    let same = b.view().keyframes().find_map(|k| {
        let of_a = |o: &&Arc<stillpoint::map::Keyframe>| o.data.stamp == k.data.stamp;
        let o = a.view().keyframes().find(of_a)?;
        Some(o.world_from_camera.rotation * k.world_from_camera.rotation.inverse())
    });
    let expected = same.unwrap() * other;
    let off = merged(&map("a"), &at("b")).unwrap().angle(&expected);
    assert!(off < 0.01 && expected.angle(&other) > 0.02, "{off}");
}

#[test]
fn maps_without_overlap_are_not_merged() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.spmap");
    let nothing = |second: &Path, code: i32, parts: &[&str]| {
        check(&merge(&map("a"), second, &out), code, parts);
        assert_eq!(files(dir.path()).len(), 1, "something was written");
    };
    let odd = dir.path().join("odd.spmap");
    std::fs::copy(map("c"), &odd).unwrap();
    nothing(
        &odd,
        1,
        &["odd.spmap in", "found none", "nothing was written"],
    );
    // Its two submaps are joined, but not to the first map.
    std::fs::copy(map("twice"), &odd).unwrap();
    nothing(
        &odd,
        1,
        &["odd.spmap in", "found none", "nothing was written"],
    );
    // As from another camera.
    let mut zoomed = Map::new(5, 1.45);
    for k in read(&map("b")).view().keyframes() {
        let mut data = (*k.data).clone();
        data.camera.fx += 60.0;
        zoomed.insert_keyframe(k.id, Arc::new(data), Se3::identity(), k.parent);
    }
    save(&zoomed, &odd);
    let parts = [
        "odd.spmap: expected a map from the camera of",
        "px elsewhere",
    ];
    nothing(&odd, 2, &parts);
    let nowhere = dir.path().join("no/out.spmap");
    let output = merge(&map("a"), &map("b"), &nowhere);
    check(&output, 2, &["no/out.spmap", "another with --out"]);
    // Control: the two submaps do overlap.
    check(&merge(&map("c"), &map("c"), &out), 0, &[]);
}

#[test]
fn submaps_are_exported_separately() {
    let dir = tempfile::tempdir().unwrap();
    let (path, graph) = (dir.path().join("both.spmap"), dir.path().join("map.g2o"));
    let (large, small) = (read(&map("a")), read(&map("c")));
    let mut both = read(&map("c"));
    let added = both.append(&large).unwrap();
    save(&both, &path);
    let [of_large, of_small] = [&large, &small].map(|m| m.view().keyframe_count());
    assert!(of_large > of_small, "{of_large} and {of_small}");
    let other = large.view().submaps()[0].0.0 + added;

    let output = map_command("info", &[&path], &[]);
    let line = format!("submaps      2: {other} ({of_large} keyframes), 0 ({of_small} keyframes)");
    let text = stdout(&output);
    assert!(text.contains(&line), "{line} is not in {text}");
    assert!(text.contains(&format!(" m, of submap {other}\n")), "{text}");
    let info = |path: &Path| -> serde_json::Value {
        serde_json::from_slice(&map_command("info", &[path], &["--json"]).stdout).unwrap()
    };
    let (of_both, of_one) = (info(&path), info(&map("a")));
    for field in ["path_length", "extent"] {
        assert_eq!(of_both[field], of_one[field]);
    }
    assert_eq!(of_both["submaps"][1]["keyframes"], of_small);

    let file = ["--graph", graph.to_str().unwrap()];
    let ids = |more: &[&str], parts: &[&str]| -> Vec<u32> {
        let output = map_command("export", &[&path], &[&file[..], more].concat());
        check(&output, 0, parts);
        let text = std::fs::read_to_string(&graph).unwrap();
        let vertices = text.lines().filter(|l| l.starts_with("VERTEX_SE3:QUAT "));
        let id = |l: &str| l.split(' ').nth(1).unwrap().parse().unwrap();
        vertices.map(id).collect()
    };
    let of_submap = |submap: u32| -> Vec<u32> {
        let all = both.view().keyframes();
        all.filter(|k| k.submap == SubmapId(submap))
            .map(|k| k.id.0)
            .collect()
    };
    let left_out = format!("warning: {of_small} keyframes are in other submaps");
    assert_eq!(ids(&[], &[&left_out, "--submap"]), of_submap(other));
    let left_out = format!("warning: {of_large} keyframes are in other submaps");
    assert_eq!(ids(&["--submap", "0"], &[&left_out]), of_submap(0));
    let unknown = [&file[..], &["--submap", "9999"]].concat();
    let output = map_command("export", &[&path], &unknown);
    check(
        &output,
        2,
        &[
            "both.spmap: expected a submap",
            "found 9999",
            "its submaps are",
        ],
    );
    // A map with one submap needs no message.
    let output = map_command("export", &[&map("a")], &file);
    check(&output, 0, &[]);
    assert!(!stderr(&output).contains("submap"), "{}", stderr(&output));
}

/// The map is kept when a disk is full or an image cannot be read.
#[test]
fn aborted_run_saves_its_map() {
    let case = Case::new();
    let map = case.dir.path().join("room.spmap");
    let save = ["--save-map", map.to_str().unwrap()];
    let saved = |more: &[&str], parts: &[&str]| {
        let output = case.run(&[&save[..], more].concat());
        check(
            &output,
            2,
            &[parts, &["the run ends after", "is saved to"]].concat(),
        );
        case.old_result_is_untouched();
        assert!(read(&map).view().landmark_count() > 0);
        std::fs::remove_file(&map).unwrap();
    };
    if cfg!(target_os = "linux") {
        saved(&["--verdicts", "/dev/full"], &["/dev/full", "free space"]);
    }
    case.images(
        "rgb",
        |i| i == 6,
        |path| std::fs::write(path, "no image").unwrap(),
    );
    saved(&["--strict"], &["the run ends after 6 frames"]);
    // Without a frame there is nothing to save.
    case.images(
        "rgb",
        |_| true,
        |path| std::fs::write(path, "no image").unwrap(),
    );
    check(&case.run(&[&save[..], &["--strict"]].concat()), 2, &[]);
    assert!(!map.exists());
}
