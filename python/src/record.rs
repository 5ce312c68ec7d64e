//! Recording of frames into a data set folder or a file.

use crate::arguments::{path, pose, yes};
use crate::camera::Camera;
use crate::guard::{Turn, detached};
use crate::images::{Handed, Intake, Order};
use pyo3::exceptions::{PyOSError, PyRuntimeError};
use pyo3::prelude::*;
use stillpoint::datasets::{self, ColourFormat, StampedPose};
use stillpoint::geometry::Se3;
use stillpoint::imaging::FrameId;
use stillpoint::recordings::McapRecorder;

/// Writes frames into a folder in TUM's layout, or into an MCAP file if the path ends with ``.mcap``. Made by :func:`record`.
///
/// The folder or file appears only on :meth:`close`, which is called at the end of a ``with`` block.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Recorder {
    writer: Turn<Option<Writer>>,
    intake: Intake,
}

enum Writer {
    Folder(Box<datasets::Recorder>),
    File(Box<McapRecorder>),
}

impl Writer {
    fn add(
        &mut self,
        frame: &stillpoint::imaging::RgbdFrame,
        truth: Option<&Se3>,
    ) -> Result<(), String> {
        match self {
            Self::Folder(folder) => folder.add(frame, truth).map_err(|e| e.to_string()),
            Self::File(file) => {
                file.add(frame).map_err(|e| e.to_string())?;
                let Some(world_from_camera) = truth.copied() else {
                    return Ok(());
                };
                let pose = StampedPose {
                    stamp: frame.stamp,
                    world_from_camera,
                };
                file.add_truth(&pose).map_err(|e| e.to_string())
            }
        }
    }

    fn finish(self) -> Result<(), String> {
        match self {
            Self::Folder(folder) => folder.finish().map_err(|e| e.to_string()),
            Self::File(file) => file.finish().map_err(|e| e.to_string()),
        }
    }
}

#[pymethods]
impl Recorder {
    #[new]
    #[pyo3(signature = (path, camera, *, color_order=None, jpeg=None))]
    fn new(
        py: Python<'_>,
        path: &Bound<'_, PyAny>,
        camera: &Bound<'_, PyAny>,
        color_order: Option<&Bound<'_, PyAny>>,
        jpeg: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let path = self::path("path", path)?;
        let jpeg = jpeg.map_or(Ok(false), |j| yes("jpeg", j))?;
        let camera = Camera::from_any(camera)?;
        let order = Order::of(color_order)?;
        let (lens, name) = (camera.model.camera, camera.model.name.clone());
        let writer = detached(py, || {
            if path
                .extension()
                .is_some_and(|e| e.eq_ignore_ascii_case("mcap"))
            {
                let file = McapRecorder::create(&path, &lens).map_err(|e| e.to_string())?;
                return Ok(Writer::File(Box::new(file)));
            }
            let format = if jpeg {
                ColourFormat::Jpeg
            } else {
                ColourFormat::Png
            };
            let folder = datasets::Recorder::create(&path, &lens, &name, format);
            folder
                .map(|f| Writer::Folder(Box::new(f)))
                .map_err(|e| e.to_string())
        })?;
        let writer = writer.map_err(|e: String| PyOSError::new_err(format!("path: {e}")))?;
        Ok(Self {
            writer: Turn::new(Some(writer)),
            intake: Intake::new(camera, order, true),
        })
    }

    /// Writes a frame.
    ///
    /// Args:
    ///     stamp, color, depth, depth_stamp: as for :meth:`Slam.track`.
    ///     truth: the true pose world_from_camera, (4, 4), m, if known.
    ///
    /// Raises:
    ///     ValueError, TypeError: invalid argument; the message names it.
    ///     OSError: the frame cannot be written, or stamps do not ascend.
    #[pyo3(signature = (stamp, color, depth, *, depth_stamp=None, truth=None))]
    fn add(
        &self,
        py: Python<'_>,
        stamp: &Bound<'_, PyAny>,
        color: &Bound<'_, PyAny>,
        depth: &Bound<'_, PyAny>,
        depth_stamp: Option<&Bound<'_, PyAny>>,
        truth: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let handed = Handed {
            stamp,
            colour: color,
            depth,
            depth_stamp,
            detections: None,
        };
        let truth = truth.map(|p| pose("truth", p)).transpose()?;
        let (taken, _) = self.intake.take(py, &handed)?;
        let written = self.writer.with(py, |writer| {
            let writer = writer.as_mut()?;
            Some(writer.add(&taken.numbered(FrameId(0)), truth.as_ref()))
        })?;
        let written = written.ok_or_else(|| {
            PyRuntimeError::new_err("expected a recording that is open, found one that was closed")
        })?;
        written.map_err(|e| PyOSError::new_err(format!("path: {e}")))
    }

    /// Completes the recording; idempotent.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let closed = self
            .writer
            .with(py, |writer| writer.take().map(Writer::finish))?;
        closed
            .unwrap_or(Ok(()))
            .map_err(|e| PyOSError::new_err(format!("path: {e}")))
    }

    fn __enter__(this: Bound<'_, Self>) -> Bound<'_, Self> {
        this
    }

    #[pyo3(signature = (*_how))]
    fn __exit__(&self, py: Python<'_>, _how: &Bound<'_, PyAny>) -> PyResult<()> {
        self.close(py)
    }

    fn __repr__(&self) -> String {
        let [w, h] = self.intake.camera.size();
        format!("<Recorder of {w}x{h} px>")
    }
}
