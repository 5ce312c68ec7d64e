//! Map files: saved by a run, inspected, exported, damaged.

mod damaged;
mod export;
mod save;

use crate::common::{check, program, simulate, stdout};
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::LazyLock;
use tempfile::TempDir;

const FRAMES: usize = 90;

/// A recording, and the results of a run that saved its map.
static SAVED: LazyLock<TempDir> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    simulate(&dir.path().join("room"), "halfsphere", FRAMES);
    let output = run(dir.path(), &dir.path().join("room.spmap"));
    check(&output, 0, &[]);
    let said = stdout(&output);
    assert!(said.contains("map saved to") && said.contains("room.spmap"));
    dir
});

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
