//! The command line, which the wheel holds too.

use crate::guard::detached;
use pyo3::prelude::*;
use std::ffi::OsString;

/// Carries out a command line, the program's name first, and returns the exit code. For the program `stillpoint` alone: it listens to signals, and
/// says what it says on the process's own standard streams.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, typed: Vec<OsString>) -> PyResult<u8> {
    detached(py, || stillpoint_cli::run(typed))
}

/// Says how the command line is started in a process of its own: models from elsewhere are tried there first.
#[pyfunction]
pub(crate) fn launch_by(launcher: Vec<OsString>) {
    stillpoint_cli::launch_by(launcher);
}
