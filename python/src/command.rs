//! The command line, which the wheel holds too.

use crate::guard::detached;
use pyo3::prelude::*;
use std::ffi::OsString;
use std::path::PathBuf;
use stillpoint_cli::front;

/// Carries out a command line, the program's name first, and returns the exit code. For the program `stillpoint` alone: it listens to signals, and
/// says what it says on the process's own standard streams.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, typed: Vec<OsString>) -> PyResult<u8> {
    detached(py, || stillpoint_cli::run(typed))
}

/// Says how the command line is started in a process of its own, and which library holds it: models from elsewhere are tried there first.
#[pyfunction]
pub(crate) fn launch_by(launcher: Vec<OsString>, file: PathBuf) {
    stillpoint_cli::launch_by(launcher, file);
}

/// The digest of a recording, by which a batch knows it, and its bytes.
#[pyfunction]
pub(crate) fn input_digest(py: Python<'_>, path: PathBuf) -> PyResult<(String, u64)> {
    Ok(detached(py, || front::input_digest(&path))??)
}
