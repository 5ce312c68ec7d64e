//! The result folder of a run on a whole recording, as written by the command line.

use crate::arguments::value;
use crate::driver::Driver;
use crate::trajectory::Trajectory;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::path::Path;
use stillpoint::detection::DetectorInfo;
use stillpoint::imaging::Simd;
use stillpoint::slam::Config;
use stillpoint_cli::front::{Driven, ResultRecorder};

/// Arguments of a run, for its result.
pub(crate) struct About {
    pub(crate) config: Config,
    pub(crate) detector: DetectorInfo,
    pub(crate) simd: Simd,
    /// Ids in the map before the first frame.
    pub(crate) keyframes: usize,
}

/// Facts about a run known from reading the recording.
pub(crate) struct Read<'a> {
    /// Path, layout, and source of the camera.
    pub(crate) input: [String; 3],
    pub(crate) command: String,
    pub(crate) truth: Option<&'a Trajectory>,
    /// Unreadable frames.
    pub(crate) skipped: usize,
    /// Duration, s.
    pub(crate) seconds: f64,
}

impl About {
    pub(crate) fn recorder(&self, pictures: bool) -> ResultRecorder {
        ResultRecorder::new(pictures, self.keyframes)
    }

    pub(crate) fn write(&self, driver: &Driver, folder: &Path, read: Read<'_>) -> PyResult<()> {
        let known = driver.known();
        let running = driver.detector();
        let timing = driver.with_map(|_, timing| timing.copied());
        let run = Driven {
            input: read.input,
            command: read.command,
            config: &self.config,
            simd: self.simd,
            // A network knows its input size only after the first image.
            detector: running.as_ref().unwrap_or(&self.detector),
            trajectory: &known.trajectory,
            view: known.view,
            timing: timing.flatten().unwrap_or_default(),
            surface: driver.counted_surface(),
            truth: read.truth.map(|t| &t.poses[..]),
            skipped: read.skipped,
            seconds: read.seconds,
        };
        let written = driver.with_result(|result| result.write(folder, "out", run));
        match written {
            Some(written) => written.map_err(|e| value("out", e)),
            None => Err(PyRuntimeError::new_err(
                "expected a run whose result was kept, found another",
            )),
        }
    }
}
