//! `map merge` of maps with surfaces.

use crate::common::{check, stderr, stillpoint};
use crate::map_use::{map, merge, read};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use stillpoint::dense::{DenseMap, MeshOptions};
use stillpoint::geometry::{Se3, Vec3, align_umeyama};
use stillpoint::imaging::Simd;
use stillpoint::map::{Extension, Map, MapFile};
use stillpoint::simulator::{Simulator, SimulatorConfig, Surfaces, share_near};
use tempfile::TempDir;

/// The simulator behind the recording of maps `a` and `b`.
static ROOM: LazyLock<Simulator> = LazyLock::new(|| {
    Simulator::new(&SimulatorConfig {
        scene: "halfsphere".to_owned(),
        frames: Some(64),
        ..SimulatorConfig::default()
    })
    .unwrap()
});

static MERGED: LazyLock<TempDir> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    let output = merge(&map("a"), &map("b"), &dir.path().join("both.spmap"));
    check(&output, 0, &[]);
    dir
});

fn both() -> PathBuf {
    MERGED.path().join("both.spmap")
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn dense_bytes(path: &Path) -> Option<Vec<u8>> {
    let file = MapFile::from_bytes(&std::fs::read(path).unwrap()).unwrap();
    file.extension(DenseMap::EXTENSION).map(<[u8]>::to_vec)
}

fn dense(path: &Path) -> DenseMap {
    DenseMap::from_bytes(&dense_bytes(path).unwrap(), Simd::detect()).unwrap()
}

/// Saves a map with a surface extension of these bytes.
fn save_with(map: &Map, bytes: Option<Vec<u8>>, path: &Path) {
    let extension = bytes.map(|bytes| Extension {
        name: DenseMap::EXTENSION.to_owned(),
        bytes,
    });
    let extensions: Vec<Extension> = extension.into_iter().collect();
    std::fs::write(path, map.to_bytes(&extensions).unwrap()).unwrap();
}

/// From the world of a map's keyframes to that of the simulator.
fn truth_from(map: &Map) -> Se3 {
    let keyframes = || map.view().keyframes();
    let ours: Vec<Vec3> = keyframes().map(|k| k.centre()).collect();
    let truth = keyframes().map(|k| ROOM.world_from_camera(k.data.stamp).translation);
    let found = align_umeyama(&ours, &truth.collect::<Vec<_>>(), false).unwrap();
    found.target_from_source
}

/// Every `step`-th vertex of a surface in the simulator's frame; `map` shares the surface's frame.
fn corners(dense: &DenseMap, map: &Map, step: usize) -> Vec<Vec3> {
    let (mesh, turn) = (dense.mesh(&MeshOptions::default()), truth_from(map));
    let some = (0..mesh.positions.len() as u32).step_by(step);
    some.map(|i| turn.transform(&mesh.position(i))).collect()
}

/// Mean distance of a surface to the true one, m, and its area, m^2.
fn score(dense: &DenseMap, map: &Map) -> [f64; 2] {
    let truth = Surfaces::new(ROOM.static_surfaces());
    let points = corners(dense, map, 5);
    let sum: f64 = points.iter().map(|p| truth.distance(p)).sum();
    let area = dense.mesh(&MeshOptions::default()).area();
    [sum / points.len() as f64, area]
}

/// The share of the vertices of one map's surface that lie within 5 cm of another's.
fn covered(one: &Path, by: &Path) -> f64 {
    let [points, others] =
        [(one, 5), (by, 1)].map(|(path, step)| corners(&dense(path), &read(path), step));
    share_near(&points, &others, 0.05)
}

#[test]
fn merged_maps_have_one_surface() {
    let of = |path: &Path| score(&dense(path), &read(path));
    let [a, b, merged] = [map("a"), map("b"), both()].map(|path| of(&path));
    println!("mean error, m, and area, m^2: {a:?} and {b:?} become {merged:?}");
    assert!(merged[0] < a[0].max(b[0]) + 0.002, "{merged:?}");
    assert!(merged[1] > a[1].max(b[1]), "{merged:?}");
    let pairs = [("a", "b"), ("b", "a")];
    let shares = pairs.map(|(one, other)| {
        let one = map(one);
        [covered(&one, &both()), covered(&one, &map(other))]
    });
    println!("of each, in both and in the other one: {shares:?}");
    assert!(shares.iter().all(|s| s[0] > 0.95), "{shares:?}");
    assert!(shares[1][1] < 0.8, "{shares:?}");
    // Control: merged without aligning the frames.
    let mut wrong = dense(&map("a"));
    wrong.absorb(&dense(&map("b")), &Se3::identity()).unwrap();
    let wrong = score(&wrong, &read(&both()));
    println!("without the motion {wrong:?}");
    assert!(wrong[0] > merged[0] + 0.01, "{wrong:?}");
    // Exports of the merged map; merging a file with itself.
    for (command, name) in [
        ("mesh", "both.ply"),
        ("grid", "both.yaml"),
        ("octomap", "both.bt"),
    ] {
        let out = MERGED.path().join(name);
        let output = stillpoint(["map", command, text(&both()), "--out", text(&out)]);
        check(&output, 0, &[]);
        assert!(out.metadata().unwrap().len() > 100);
    }
    let again = MERGED.path().join("again.spmap");
    check(&merge(&map("a"), &map("b"), &again), 0, &[]);
    assert!(std::fs::read(again).unwrap() == std::fs::read(both()).unwrap());
}

#[test]
fn single_surface_is_moved_to_the_first_maps_frame() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).with_extension("spmap");
    let [a, b] = ["a", "b"].map(|name| read(&map(name)));
    save_with(&a, None, &at("bare_a"));
    save_with(&b, None, &at("bare_b"));
    check(&merge(&map("a"), &at("bare_b"), &at("first")), 0, &[]);
    assert!(dense_bytes(&at("first")) == dense_bytes(&map("a")));
    check(&merge(&at("bare_a"), &map("b"), &at("second")), 0, &[]);
    let alone = score(&dense(&map("b")), &b);
    let moved = score(&dense(&at("second")), &read(&at("second")));
    println!("mean error, m, and area, m^2: {alone:?}, moved {moved:?}");
    assert!(moved[0] < alone[0] + 0.002, "{alone:?} {moved:?}");
    assert!(moved[1] > 0.9 * alone[1], "{alone:?} {moved:?}");
    // Control: not transformed.
    let wrong = score(&dense(&map("b")), &read(&at("second")));
    assert!(wrong[0] > moved[0] + 0.01, "{wrong:?}");
    check(&merge(&at("bare_a"), &at("bare_b"), &at("none")), 0, &[]);
    assert_eq!(dense_bytes(&at("none")), None);
}

#[test]
fn incompatible_surface_is_dropped_and_damaged_one_refused() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).with_extension("spmap");
    let left_out = |second: &Path, words: &str| {
        let output = merge(&map("a"), second, &at("out"));
        check(&output, 0, &[]);
        let said = stderr(&output);
        assert!(said.contains(words) && said.contains("left out"), "{said}");
        assert!(dense_bytes(&at("out")) == dense_bytes(&map("a")));
    };
    // Its surface is of the other room, which has no overlap with the first map.
    let mut rooms = read(&map("c"));
    rooms.append(&read(&map("b"))).unwrap();
    save_with(&rooms, dense_bytes(&map("b")), &at("rooms"));
    left_out(&at("rooms"), "rooms.spmap: its surface is left out, since");
    // An empty surface with voxels of 5 mm.
    let mut fine = b"SPDENSE2".to_vec();
    for value in [0.005, 0.06, 0.05, 4.0_f64] {
        fine.extend(value.to_le_bytes());
    }
    fine.extend([0; 8]);
    save_with(&read(&map("b")), Some(fine), &at("fine"));
    let [first, second] = [at("fine"), map("b")];
    let output = merge(&first, &second, &at("out"));
    check(&output, 0, &[]);
    let said = stderr(&output);
    let words = "b.spmap: its surface is left out: expected voxels of";
    assert!(
        said.contains(words) && said.contains("other way round"),
        "{said}"
    );
    // Either file may be damaged.
    let mut bytes = dense_bytes(&map("b")).unwrap();
    bytes.truncate(bytes.len() - 1);
    save_with(&read(&map("b")), Some(bytes), &at("damaged"));
    for files in [[map("a"), at("damaged")], [at("damaged"), map("a")]] {
        let output = merge(&files[0], &files[1], &at("refused"));
        let words = ["damaged.spmap: expected a dense map of", "it is damaged"];
        check(&output, 2, &words);
        assert!(!at("refused").exists());
    }
}
