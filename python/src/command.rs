//! The command line contained in the wheel.

use crate::guard::detached;
use pyo3::prelude::*;
use std::ffi::OsString;
use std::path::PathBuf;
use stillpoint_cli::front;

/// Runs a command line, the program's name first, and returns the exit code. Only for the program `stillpoint`: it handles signals, and
/// writes to the process's standard streams.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, typed: Vec<OsString>) -> PyResult<u8> {
    detached(py, || stillpoint_cli::run(typed))
}

/// Sets the command that starts the command line in a separate process, and the library that contains it: models from other sources are
/// first tried there.
#[pyfunction]
pub(crate) fn launch_by(launcher: Vec<OsString>, file: PathBuf) {
    stillpoint_cli::launch_by(launcher, file);
}

/// The digest that identifies a recording in a batch, and the recording's size in bytes.
#[pyfunction]
pub(crate) fn input_digest(py: Python<'_>, path: PathBuf) -> PyResult<(String, u64)> {
    Ok(detached(py, || front::input_digest(&path))??)
}
