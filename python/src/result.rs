//! The result folder of a run over a whole recording, as the command line leaves it.

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

/// What a run was begun with, as its result says it.
pub(crate) struct About {
    pub(crate) config: Config,
    pub(crate) detector: DetectorInfo,
    pub(crate) simd: Simd,
    /// Ids that the map had before the first frame.
    pub(crate) keyframes: usize,
}

/// Facts about the run that the reader of the recording knows.
pub(crate) struct Read<'a> {
    /// What was run on, its layout, and where the camera comes from.
    pub(crate) input: [String; 3],
    pub(crate) command: String,
    pub(crate) truth: Option<&'a Trajectory>,
    /// Frames that could not be read.
    pub(crate) skipped: usize,
    /// s.
    pub(crate) seconds: f64,
}

impl About {
    pub(crate) fn recorder(&self, pictures: bool) -> ResultRecorder {
        ResultRecorder::new(pictures, self.keyframes)
    }

    /// Writes the folder of a run that is over.
    pub(crate) fn write(&self, driver: &Driver, folder: &Path, read: Read<'_>) -> PyResult<()> {
        let known = driver.known();
        let running = driver.detector();
        let timing = driver.with_map(|_, timing| timing.copied());
        let run = Driven {
            input: read.input,
            command: read.command,
            config: &self.config,
            simd: self.simd,
            // A network knows the size of its input when it has seen an image.
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
