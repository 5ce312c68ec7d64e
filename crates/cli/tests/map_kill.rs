//! Killing a process while it saves a map leaves the old or the new map, intact.

#![cfg(unix)]
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;
use stillpoint::datasets::{AtomicFile, write_atomic};
use stillpoint::features::{Descriptor, Edge, FeatureGrid, Keypoint};
use stillpoint::geometry::{Camera, Se3};
use stillpoint::map::{KeyframeData, KeyframeId, Map, MapFile};

const KILLS: u32 = 50;
/// Number of maps that are written in turn.
const VERSIONS: u64 = 3;
/// Environment variable with the file for the child process.
const FILE: &str = "STILLPOINT_TEST_MAP_TO_SAVE";

/// SplitMix64.
fn random(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A map of some hundred kilobytes, which takes a while to write, in one of its versions.
fn map(version: u64) -> Vec<u8> {
    let mut state = version;
    let camera = Camera::pinhole(640, 480, [525.0, 525.0, 319.5, 239.5]);
    let mut map = Map::new(5, 1.45);
    for id in 0..8 + version as u32 {
        let mut px = |most: u64| (random(&mut state) % most) as f32;
        let positions: Vec<[f32; 2]> = (0..1000).map(|_| [px(640), px(480)]).collect();
        let keypoint = |p: &[f32; 2]| Keypoint {
            x: p[0],
            y: p[1],
            level: 0,
            angle: 0.5,
            response: 20.0,
            edge: Edge::default(),
        };
        let data = KeyframeData {
            stamp: f64::from(id),
            camera,
            keypoints: positions.iter().map(keypoint).collect(),
            sigma_px: vec![1.0; 1000],
            depths: vec![2.0; 1000],
            depth_sigmas: vec![0.01; 1000],
            descriptors: (0..1000)
                .map(|_| Descriptor(std::array::from_fn(|_| random(&mut state))))
                .collect::<Vec<_>>()
                .into(),
            mappable: vec![true; 1000],
            grid: FeatureGrid::build(&positions, &[0; 1000], KeyframeData::grid_bounds(&camera)),
            positions,
        };
        map.insert_keyframe(KeyframeId(id), Arc::new(data), Se3::identity(), None);
    }
    map.to_bytes(&[]).unwrap()
}

/// Not a test: the process that is killed. It keeps saving, at first part by part as the command line does.
#[test]
fn child_that_saves() {
    let Some(path) = std::env::var_os(FILE) else {
        return;
    };
    let path = Path::new(&path);
    let versions: Vec<Vec<u8>> = (0..VERSIONS).map(map).collect();
    for turn in 0.. {
        let bytes = &versions[turn % versions.len()];
        let mut file = AtomicFile::create(path).unwrap();
        for part in bytes.chunks(1 << 16) {
            file.write_all(part).unwrap();
        }
        file.commit().unwrap();
        println!("\nsaved");
    }
}

fn others(folder: &Path) -> usize {
    std::fs::read_dir(folder).unwrap().count() - 1
}

#[test]
fn map_survives_fifty_kills_while_saving() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("room.spmap");
    let versions: Vec<Vec<u8>> = (0..VERSIONS).map(map).collect();
    assert!(versions[0].len() > 300_000, "{} bytes", versions[0].len());
    write_atomic(&path, &versions[0]).unwrap();
    let mut state = 5;
    let (mut in_between, mut found) = (0, [0u32; VERSIONS as usize]);
    for kill in 0..KILLS {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "map_kill::child_that_saves", "--nocapture"])
            .env(FILE, &path)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // After a varying number of saves, so that every version is found whatever a save takes, and during the next save.
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut saves = lines.filter(|l| l.as_deref().unwrap() == "saved");
        let wanted = 1 + (kill as usize) % versions.len();
        assert_eq!(saves.by_ref().take(wanted).count(), wanted, "kill {kill}");
        std::thread::sleep(Duration::from_micros(random(&mut state) % 30_000));
        child.kill().unwrap();
        let status = child.wait().unwrap();
        // The process ended by the kill.
        assert_eq!(
            std::os::unix::process::ExitStatusExt::signal(&status),
            Some(9)
        );
        let bytes = std::fs::read(&path).unwrap();
        MapFile::from_bytes(&bytes).unwrap_or_else(|e| panic!("kill {kill}: {e}"));
        let version = versions.iter().position(|v| *v == bytes);
        found[version.unwrap_or_else(|| panic!("kill {kill}: another map"))] += 1;
        // At most the leftover of this process: those of earlier ones were removed.
        let left = others(dir.path());
        assert!(left <= 1, "kill {kill}: {left} files beside the map");
        in_between += left;
    }
    // The kills came during saves, and at different times.
    assert!(in_between > 5, "{in_between} of {KILLS} while saving");
    assert!(found.iter().all(|n| *n > 0), "{found:?}");
    write_atomic(&path, &versions[1]).unwrap();
    assert_eq!(others(dir.path()), 0);
}
