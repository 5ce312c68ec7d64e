//! Surfaces and grids from the command line.

use crate::common::{check, program, simulate, stdout, stillpoint};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use tempfile::TempDir;

const FRAMES: usize = 24;

struct Made {
    dir: TempDir,
    data: PathBuf,
    result: PathBuf,
    map: PathBuf,
}

static MADE: LazyLock<Made> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let (data, result, map) = (at("room"), at("result"), at("room.spmap"));
    simulate(&data, "halfsphere", FRAMES);
    let args = ["-q", "run", text(&data), "--dense", "--voxel", "0.04"];
    let more = ["--out", text(&result), "--save-map", text(&map)];
    check(&stillpoint([&args[..], &more].concat()), 0, &[]);
    Made {
        data,
        result,
        map,
        dir,
    }
});

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn read(folder: &Path, name: &str) -> Vec<u8> {
    std::fs::read(folder.join(name)).unwrap()
}

fn head(ply: &[u8]) -> String {
    String::from_utf8_lossy(&ply[..300.min(ply.len())]).into_owned()
}

#[test]
fn dense_run_writes_a_surface_and_its_figures() {
    let (ply, glb) = (
        read(&MADE.result, "mesh.ply"),
        read(&MADE.result, "mesh.glb"),
    );
    let summary: Value = serde_json::from_slice(&read(&MADE.result, "summary.json")).unwrap();
    let dense = &summary["dense"];
    let triangles = dense["triangles"].as_u64().unwrap();
    assert!(triangles > 1000, "{dense}");
    assert!(
        head(&ply).contains(&format!("element face {triangles}\n")),
        "{}",
        head(&ply)
    );
    assert!(glb.starts_with(b"glTF\x02\0\0\0"));
    assert!(dense["area"].as_f64().unwrap() > 1.0, "{dense}");
    let integrated = dense["integrated"].as_u64().unwrap() as usize;
    assert!((FRAMES / 2 - 1..=FRAMES).contains(&integrated), "{dense}");
    assert_eq!(dense["voxel"], 0.04);
    assert!(dense["memory_bytes"].as_u64() > dense["kept_bytes"].as_u64());
    // The report shows a subset of its triangles.
    let page = String::from_utf8(read(&MADE.result, "report.html")).unwrap();
    let data = page.split("type=\"application/json\">").nth(1).unwrap();
    let data: Value = serde_json::from_str(data.split("</script>").next().unwrap()).unwrap();
    let surface = &data[0]["surface"];
    assert_eq!(surface["count"], triangles);
    // Six bytes each in base 64.
    let shown = surface["triangle"].as_str().unwrap().len() / 8;
    assert!((1000..=20_000).contains(&shown), "{shown}");
    // It does not affect tracking.
    let plain = MADE.dir.path().join("plain");
    let args = [
        "-q",
        "run",
        text(&MADE.data),
        "--no-report",
        "--out",
        text(&plain),
    ];
    check(&stillpoint(args), 0, &[]);
    assert_eq!(
        read(&plain, "trajectory.txt"),
        read(&MADE.result, "trajectory.txt")
    );
    assert!(!plain.join("mesh.ply").exists());
}

#[test]
fn dense_surface_is_reproducible() {
    let meshes = |folder: &Path| (read(folder, "mesh.ply"), read(folder, "mesh.glb"));
    let made = meshes(&MADE.result);
    // From the log, in portable code.
    let again = MADE.dir.path().join("again");
    let log = MADE.result.join("run.log");
    let args = [
        "replay",
        text(&log),
        text(&MADE.data),
        "--dense",
        "--no-report",
    ];
    let mut command = program();
    command.args(args).args(["--out", text(&again)]);
    check(
        &command.env("STILLPOINT_SIMD", "scalar").output().unwrap(),
        0,
        &[],
    );
    assert!(meshes(&again) == made, "a replay gives another surface");
    // From a live run, which may have skipped frames.
    let [live, repeated] = ["live", "repeated"].map(|name| MADE.dir.path().join(name));
    let args = [
        "run",
        text(&MADE.data),
        "--live=all",
        "--dense",
        "--no-report",
    ];
    check(
        &stillpoint([&args[..], &["--out", text(&live)]].concat()),
        0,
        &[],
    );
    let log = live.join("run.log");
    let args = [
        "replay",
        text(&log),
        text(&MADE.data),
        "--dense",
        "--no-report",
    ];
    check(
        &stillpoint([&args[..], &["--out", text(&repeated)]].concat()),
        0,
        &[],
    );
    assert!(
        meshes(&live) == meshes(&repeated),
        "a replay of a live run gives another surface"
    );
}

#[test]
fn map_exports_its_surface_and_grids() {
    let out = |name: &str| MADE.dir.path().join(name);
    let map = text(&MADE.map);
    let info = stdout(&stillpoint(["map", "info", map]));
    assert!(info.contains("stillpoint/dense"), "{info}");
    for name in ["out.ply", "out.glb"] {
        check(
            &stillpoint(["map", "mesh", map, "--out", text(&out(name))]),
            0,
            &[],
        );
    }
    assert!(read(MADE.dir.path(), "out.ply") == read(&MADE.result, "mesh.ply"));
    assert!(read(MADE.dir.path(), "out.glb") == read(&MADE.result, "mesh.glb"));
    let yaml = out("plan.yaml");
    check(
        &stillpoint(["map", "grid", map, "--out", text(&yaml)]),
        0,
        &[],
    );
    let said = std::fs::read_to_string(&yaml).unwrap();
    assert!(
        said.starts_with("image: plan.pgm\nmode: trinary\n"),
        "{said}"
    );
    assert_eq!(
        read(MADE.dir.path(), "plan.pgm"),
        read(&MADE.result, "grid.pgm")
    );
    for name in ["plan_crossed.pgm", "plan_distance.pgm"] {
        assert!(read(MADE.dir.path(), name).starts_with(b"P5\n"));
    }
    check(
        &stillpoint(["map", "octomap", map, "--out", text(&out("out.bt"))]),
        0,
        &[],
    );
    let tree = read(MADE.dir.path(), "out.bt");
    assert!(tree.starts_with(b"# Octomap OcTree binary file\n"));
}

#[test]
fn run_continues_the_surface_of_its_map() {
    let [grown, result, found] = ["grown.spmap", "more", "found"].map(|n| MADE.dir.path().join(n));
    let (data, map) = (text(&MADE.data), text(&MADE.map));
    let part = ["run", data, "--max-frames", "6", "--no-report", "--dense"];
    let args = [
        "--load-map",
        map,
        "--save-map",
        text(&grown),
        "--out",
        text(&result),
    ];
    check(&stillpoint([&part[..], &args].concat()), 0, &[]);
    let area = |folder: &Path| {
        let summary: Value = serde_json::from_slice(&read(folder, "summary.json")).unwrap();
        summary["dense"]["area"].as_f64().unwrap()
    };
    assert!(area(&result) > 0.95 * area(&MADE.result));
    // Localisation does not change the map.
    let before = std::fs::read(map).unwrap();
    let args = ["--localize", map, "--out", text(&found)];
    check(&stillpoint([&part[..], &args].concat()), 0, &[]);
    assert!(std::fs::read(map).unwrap() == before);
    assert!(area(&found) > 0.95 * area(&MADE.result));
    // Without --dense a surface in the map is not dropped silently.
    let dropped = MADE.dir.path().join("dropped.spmap");
    let args = [
        "--load-map",
        map,
        "--save-map",
        text(&dropped),
        "--out",
        text(&found),
    ];
    check(&stillpoint([&part[..5], &args].concat()), 0, &["surface"]);
}

#[test]
fn impossible_dense_outputs_are_refused() {
    let dir = MADE.dir.path();
    let bare = dir.join("bare.spmap");
    let args = ["run", text(&MADE.data), "--max-frames", "4", "--no-report"];
    let out = dir.join("bare");
    let more = ["--save-map", text(&bare), "--out", text(&out)];
    check(&stillpoint([&args[..], &more].concat()), 0, &[]);
    let ply = dir.join("none.ply");
    let bt = dir.join("none.bt");
    for (command, file) in [("mesh", &ply), ("octomap", &bt)] {
        let output = stillpoint(["map", command, text(&bare), "--out", text(file)]);
        check(
            &output,
            2,
            &["bare.spmap: expected a map with a surface", "--dense"],
        );
        assert!(!file.exists());
    }
    let map = text(&MADE.map);
    let odd = dir.join("mesh.obj");
    check(
        &stillpoint(["map", "mesh", map, "--out", text(&odd)]),
        2,
        &[".ply or .glb"],
    );
    check(
        &stillpoint(["map", "grid", map, "--out", text(&odd)]),
        2,
        &[".yaml"],
    );
    check(&stillpoint(["map", "mesh", map, "--out", map]), 2, &[]);
    for (option, value) in [("--voxel", "3"), ("--up", "0,0,0"), ("--up", "1,2")] {
        let args = ["run", text(&MADE.data), "--dense", option, value];
        check(&stillpoint(args), 2, &["expected"]);
    }
    check(
        &stillpoint(["run", text(&MADE.data), "--voxel", "0.02"]),
        2,
        &["--dense"],
    );
    // Another voxel size than the map's.
    let args = [
        "run",
        text(&MADE.data),
        "--dense",
        "--voxel",
        "0.02",
        "--load-map",
        map,
    ];
    check(&stillpoint(args), 2, &["--voxel: expected 0.04 m"]);
}

/// Rotates every image of a folder by half a turn, as from a camera mounted upside down.
fn turn_images(folder: &Path) {
    for part in ["rgb", "depth"] {
        for entry in std::fs::read_dir(folder.join(part)).unwrap() {
            let path = entry.unwrap().path();
            image::open(&path).unwrap().rotate180().save(&path).unwrap();
        }
    }
}

#[test]
fn inertial_sensor_gives_the_floor_of_an_inverted_camera() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let data = at("hanging");
    let args = ["-q", "simulate", "--imu", "--scene", "halfsphere"];
    let more = ["--frames", "60", "--out", text(&data)];
    check(&stillpoint([&args[..], &more].concat()), 0, &[]);
    turn_images(&data);
    // The sensor is not rotated, so that its rotation to the camera is half a turn about the optical axis.
    let file = data.join("camera.toml");
    let camera = std::fs::read_to_string(&file).unwrap();
    let (before, after) = camera.split_once("\nrotation = ").unwrap();
    let (_, after) = after.split_once('\n').unwrap();
    let turned = format!("{before}\nrotation = [0.0, 0.0, 1.0, 0.0]\n{after}");
    std::fs::write(&file, turned).unwrap();
    let run = |out: &Path, more: &[&str]| {
        let args = [
            "-q",
            "run",
            text(&data),
            "--no-report",
            "--dense",
            "--voxel",
            "0.04",
        ];
        let args = [&args[..], &["--out", text(out)], more].concat();
        check(&stillpoint(args), 0, &[]);
        std::fs::read(out.join("grid.pgm")).unwrap_or_default()
    };
    let known = run(&at("with"), &[]);
    let named = run(&at("named"), &["--no-imu", "--up", "0,1,0"]);
    let without = run(&at("without"), &["--no-imu"]);
    assert!(!known.is_empty() && known != without);
    // The map stores it: exporting the plan needs no option.
    let file = at("hanging.spmap");
    run(&at("saved"), &["--save-map", text(&file)]);
    let plan = at("plan.yaml");
    check(
        &stillpoint(["map", "grid", text(&file), "--out", text(&plan)]),
        0,
        &[],
    );
    let plan = std::fs::read(at("plan.pgm")).unwrap();
    assert!(plan == known, "{} and {} bytes", plan.len(), known.len());
    // With --up the free area is the same.
    let free = |grid: &[u8]| grid.iter().filter(|v| **v == 254).count() as f64;
    let (known, named) = (free(&known), free(&named));
    assert!(
        known > 50.0 && (known / named - 1.0).abs() < 0.1,
        "{known} {named}"
    );
}
