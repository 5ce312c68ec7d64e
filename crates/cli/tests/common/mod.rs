//! Runs the program on small simulated data sets.
#![allow(clippy::expect_used, unreachable_pub)] // Helpers may panic.

pub mod browser;
pub mod case;
pub mod model_cache;
pub mod server;
pub mod tiny_model;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A cache that never holds a model.
pub const EMPTY_CACHE: &str = concat!(env!("CARGO_TARGET_TMPDIR"), "/no-models");

pub fn program() -> Command {
    isolated(Command::new(env!("CARGO_BIN_EXE_stillpoint")))
}

/// Runs the program through a shell, as `$0` with `args` from `$1` on.
pub fn shell<I: IntoIterator<Item = S>, S: AsRef<std::ffi::OsStr>>(
    script: &str,
    args: I,
) -> Output {
    let mut command = Command::new("sh");
    command.arg("-c").arg(script);
    command.arg(env!("CARGO_BIN_EXE_stillpoint")).args(args);
    isolated(command).output().expect("sh starts")
}

/// Removes environment variables that affect the program, above all the user's model cache.
pub fn isolated(mut command: Command) -> Command {
    command
        .env_remove("STILLPOINT_SIMD")
        .env_remove("STILLPOINT_WORKERS")
        .env("STILLPOINT_CACHE", EMPTY_CACHE);
    command
}

pub fn stillpoint<I: IntoIterator<Item = S>, S: AsRef<std::ffi::OsStr>>(args: I) -> Output {
    program().args(args).output().expect("the program starts")
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Asserts an exit code and that stderr contains every part; never that of a panic.
#[track_caller]
pub fn check(output: &Output, code: i32, parts: &[&str]) {
    let said = stderr(output);
    assert_eq!(output.status.code(), Some(code), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    for part in parts {
        assert!(said.contains(part), "{said:?} lacks {part:?}");
    }
}

pub fn simulate(out: &Path, scene: &str, frames: usize) {
    let frames = frames.to_string();
    let output = program()
        .args([
            "-q", "simulate", "--jpeg", "--scene", scene, "--frames", &frames, "--out",
        ])
        .arg(out)
        .output()
        .unwrap();
    check(&output, 0, &[]);
}

pub fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).unwrap();
        }
    }
}

pub fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    files.sort();
    files
}
