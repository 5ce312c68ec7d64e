//! A detector that is loaded once and used by several runs.

use crate::arguments::{path, value};
use crate::guard::detached;
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};
use stillpoint::detection::{DetectError, Detections, Detector as Looks, DetectorInfo};
use stillpoint::imaging::RgbdFrame;
use stillpoint_cli::front;

/// A detector that is loaded once for many runs: pass it as ``detector=`` of :class:`Slam` and :func:`run`. Simultaneous runs take turns.
///
/// Args:
///     name: as for ``stillpoint run --detector`` (``FILE.onnx``, the name of a model in the cache, ``scripted:FILE.csv``, ``auto``,
///         ``none``).
///
/// Raises:
///     ValueError: unknown or unusable detector.
///
/// >>> Detector("none")
/// Detector('none')
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Detector {
    name: String,
    /// `None` for the detector `none`.
    kept: Option<Kept>,
    looks_at_colours: bool,
}

impl Detector {
    /// The detector, and whether it needs colour images.
    pub(crate) fn parts(&self) -> (Option<Box<dyn Looks>>, bool) {
        let kept = self.kept.clone();
        let looks = kept.map(|k| -> Box<dyn Looks> { Box::new(k) });
        (looks, self.looks_at_colours)
    }
}

#[pymethods]
impl Detector {
    #[new]
    fn new(py: Python<'_>, name: &Bound<'_, PyAny>) -> PyResult<Self> {
        let name = path("name", name)?.to_string_lossy().into_owned();
        let found = detached(py, || front::detector(&name))?;
        let (detector, looks_at_colours) = found.map_err(|e| value("name", e))?;
        Ok(Self {
            name,
            kept: detector.map(|d| Kept(Arc::new(Mutex::new(d)))),
            looks_at_colours,
        })
    }

    fn __repr__(&self) -> String {
        format!("Detector('{}')", self.name)
    }
}

/// A detector shared by several runs.
#[derive(Clone)]
struct Kept(Arc<Mutex<Box<dyn Looks>>>);

impl Looks for Kept {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        // A panic does not affect later frames.
        let mut detector = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        detector.detect(frame)
    }

    fn info(&self) -> DetectorInfo {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).info()
    }
}
