//! Tests of `lab`, with the command line as this workspace builds it.
#![allow(clippy::unwrap_used)]

mod constants;
mod document;
mod experiments;
#[cfg(unix)]
mod peers;
mod sweep;

use std::path::PathBuf;
use std::process::{Command, Output};

/// The program `stillpoint` (tests/program.rs), which cargo builds with the tests.
fn program() -> PathBuf {
    let this = std::env::current_exe().unwrap();
    let name = format!("program{}", std::env::consts::EXE_SUFFIX);
    let path = this.parent().unwrap().join("../examples").join(name);
    assert!(
        path.is_file(),
        "{}: expected the program of the end-to-end tests; `cargo test` without --test builds it",
        path.display()
    );
    path
}

/// Returns exit code, stdout and stderr.
fn lab(words: &[&str]) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lab"));
    let Output {
        status,
        stdout,
        stderr,
    } = command.args(words).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (status.code(), text(stdout), text(stderr))
}
