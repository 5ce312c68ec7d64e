//! The command line contained in the wheel.

use crate::guard::detached;
use pyo3::prelude::*;
use std::ffi::OsString;
use std::path::PathBuf;
use stillpoint_cli::front;

/// Runs a command line, the program's name first, and returns the exit code. Only for the program `stillpoint`: it handles signals and uses
/// the standard streams.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, typed: Vec<OsString>) -> PyResult<u8> {
    detached(py, || stillpoint_cli::run(typed))
}

/// Sets the command and the library of the separate process in which models from other sources are first tried.
#[pyfunction]
pub(crate) fn launch_by(launcher: Vec<OsString>, file: PathBuf) {
    stillpoint_cli::launch_by(launcher, file);
}

/// Digest by which a batch identifies a recording, and its size in bytes.
#[pyfunction]
pub(crate) fn input_digest(py: Python<'_>, path: PathBuf) -> PyResult<(String, u64)> {
    Ok(detached(py, || front::input_digest(&path))??)
}
