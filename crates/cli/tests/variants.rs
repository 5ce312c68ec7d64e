//! Recordings written by other libraries: those that `tools/recordings/variants.py` makes of fr1_xyz, in the folder that
//! `STILLPOINT_VARIANTS` names.

use crate::common::{check, stderr, stdout, stillpoint};
use std::path::{Path, PathBuf};

const FRAMES: usize = 300;

/// The recording that the variants were made of, and their folder; `None`, counted as skipped, where one is missing.
fn variants() -> Option<(PathBuf, PathBuf)> {
    let Some(made) = std::env::var_os("STILLPOINT_VARIANTS") else {
        stillpoint_testdata::skipped("STILLPOINT_VARIANTS names no folder of recordings");
        return None;
    };
    Some((stillpoint_testdata::recording("fr1_xyz")?, made.into()))
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut found: Vec<_> = folder
        .read_dir()
        .unwrap_or_else(|e| panic!("{}: {e}", folder.display()))
        .map(|entry| entry.unwrap().path())
        .collect();
    found.sort();
    found
}

/// Runs a recording without options about its contents: the trajectory, and its ATE in metres.
#[track_caller]
fn run(path: &Path, truth: &Path) -> (String, f64) {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let output = stillpoint(["run", text(path), "--detector", "none", "--out", text(&out)]);
    check(&output, 0, &[]);
    let trajectory = out.join("trajectory.txt");
    let poses = std::fs::read_to_string(&trajectory).unwrap();
    let count = poses.lines().filter(|l| !l.starts_with('#')).count();
    assert_eq!(count, FRAMES, "{}: {}", path.display(), stderr(&output));
    let output = stillpoint(["eval", text(truth), text(&trajectory), "--json"]);
    check(&output, 0, &[]);
    let scores: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    let ate = scores["ate"]["rmse"].as_f64();
    (poses, ate.unwrap_or_else(|| panic!("{scores}")))
}

#[test]
fn recording_variants_run_like_the_folder() {
    let Some((folder, made)) = variants() else {
        return;
    };
    let truth = folder.join("groundtruth.txt");
    let (_, of_folder) = run(&folder, &truth);

    // Lossless except for depth in whole millimetres: all equal.
    let lossless = entries(&made.join("lossless"));
    let runs: Vec<_> = lossless.iter().map(|path| run(path, &truth)).collect();
    assert_eq!(runs.len(), 6);
    for (path, (poses, ate)) in lossless.iter().zip(&runs) {
        assert_eq!(*poses, runs[0].0, "{}", path.display());
        assert!(*ate <= of_folder + 3e-4, "{ate} beside {of_folder}");
    }

    let (_, ate) = run(&made.join("float.mcap"), &truth);
    assert!(ate <= of_folder + 5e-5, "{ate} beside {of_folder}");

    let compressed = entries(&made.join("compressed"));
    assert_eq!(compressed.len(), 3);
    for path in compressed {
        let (_, ate) = run(&path, &truth);
        assert!(ate <= 1.15 * of_folder, "{}: {ate}", path.display());
    }
}

#[test]
fn every_mcap_writing_option_is_read() {
    let Some((_, made)) = variants() else {
        return;
    };
    let files = entries(&made.join("options"));
    assert_eq!(files.len(), 336);
    for file in files {
        let output = stillpoint(["recording", "info", "--json", text(&file)]);
        check(&output, 0, &[]);
        let found: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
        assert_eq!(found["frames"], 10, "{}: {found}", file.display());
        assert!(found.get("refused").is_none(), "{found}");
    }
}
