//! Frames of data set folders and recordings.

use crate::arguments::{self, count, value, yes};
use crate::arrays;
use crate::camera::Camera;
use crate::guard::{Turn, detached};
use crate::trajectory::Trajectory;
use crate::{inertial, odometry};
use numpy::{PyArray2, PyArray3};
use pyo3::exceptions::{PyFileNotFoundError, PyRuntimeWarning, PyStopIteration, PyValueError};
use pyo3::prelude::*;
use std::ffi::CString;
use std::sync::Arc;
use stillpoint::datasets::{CameraChoice, FrameOptions, ReadAhead};
use stillpoint::geometry::Se3;
use stillpoint::imaging::{FrameSource, ImuSample, OdometrySample, RgbdFrame};
use stillpoint::recordings::{self, Input, OpenOptions};

/// A recorded colour image with its depth image. Arrays are read-only views without a copy.
#[pyclass(frozen, name = "RgbdFrame", module = "stillpoint_slam")]
pub(crate) struct Image {
    frame: RgbdFrame,
    truth: Option<Se3>,
    inertial: Vec<ImuSample>,
    odometry: Vec<OdometrySample>,
}

impl Image {
    pub(crate) fn new(frame: RgbdFrame, truth: Option<Se3>) -> Self {
        Self {
            frame,
            truth,
            inertial: Vec::new(),
            odometry: Vec::new(),
        }
    }
}

#[pymethods]
impl Image {
    /// Number in the stream, from 0.
    #[getter]
    fn index(&self) -> u32 {
        self.frame.id.0
    }

    /// Stamp of the colour image, s.
    #[getter]
    fn stamp(&self) -> f64 {
        self.frame.stamp
    }

    /// Stamp of the depth image, s.
    #[getter]
    fn depth_stamp(&self) -> f64 {
        self.frame.depth_stamp
    }

    /// Grey image, (height, width) uint8.
    #[getter]
    fn gray<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        arrays::gray(&this.get().frame.gray, this.clone().into_any())
    }

    /// Colour image as RGB, (height, width, 3) uint8.
    ///
    /// Raises:
    ///     ValueError: the recording was opened without colours.
    #[getter]
    fn color<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        match &this.get().frame.colour {
            Some(colour) => arrays::colour(colour, this.clone().into_any()),
            None => Err(PyValueError::new_err(
                "color: expected a frame with its colours, found one without; open the recording with color=True, or take gray",
            )),
        }
    }

    /// Depth, (height, width) float32, m; 0 if unmeasured.
    #[getter]
    fn depth<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::depth(&this.get().frame.depth, this.clone().into_any())
    }

    /// Samples of the inertial sensor since the previous frame, and the first one after this frame, as for :meth:`Slam.track`: (N, 7)
    /// float64. N is 0 without a sensor.
    #[getter]
    fn imu<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        inertial::rows(py, &self.inertial)
    }

    /// Wheel odometry of the base since the previous frame, and the first sample after this frame, as for :meth:`Slam.track`: (N, 10)
    /// float64, NaN for unknown deviations. N is 0 without odometry.
    #[getter]
    fn odometry<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        odometry::rows(py, &self.odometry)
    }

    /// The exact pose world_from_camera of a simulated frame, (4, 4) float64, m; else None.
    #[getter]
    fn truth<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.truth.as_ref().map(|p| arrays::pose(py, p)).transpose()
    }

    fn __repr__(&self) -> String {
        let gray = &self.frame.gray;
        format!(
            "<RgbdFrame {} at {:.6} s, {}x{}>",
            self.frame.id,
            self.frame.stamp,
            gray.width(),
            gray.height()
        )
    }
}

/// Frames in sequence, read ahead in a separate thread.
#[pyclass(frozen, name = "RgbdFrames", module = "stillpoint_slam")]
pub(crate) struct Images {
    source: Turn<Reading>,
}

struct Reading {
    frames: Box<dyn FrameSource>,
    truth: Option<Truth>,
    skipped: usize,
    /// Samples of unreadable frames, to be passed with the next frame.
    inertial: Vec<ImuSample>,
    odometry: Vec<OdometrySample>,
}

/// The exact pose at a stamp, s.
pub(crate) type Truth = Box<dyn Fn(f64) -> Se3 + Send>;

impl Images {
    pub(crate) fn new<S: FrameSource + 'static>(frames: S, truth: Option<Truth>) -> Self {
        let frames: Box<dyn FrameSource> = Box::new(ReadAhead::new(frames));
        Self {
            source: Turn::new(Reading {
                frames,
                truth,
                skipped: 0,
                inertial: Vec::new(),
                odometry: Vec::new(),
            }),
        }
    }
}

#[pymethods]
impl Images {
    fn __iter__(this: Bound<'_, Self>) -> Bound<'_, Self> {
        this
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Image> {
        loop {
            let next = self.source.with(py, |reading| {
                let next = reading.frames.next_frame()?;
                let is_damaged = next.as_ref().is_err_and(|e| e.recoverable);
                reading.skipped += usize::from(is_damaged);
                reading.inertial.extend(reading.frames.take_inertial());
                reading.odometry.extend(reading.frames.take_odometry());
                Some(next.map(|frame| {
                    let truth = reading.truth.as_ref().map(|t| t(frame.stamp));
                    Image {
                        inertial: std::mem::take(&mut reading.inertial),
                        odometry: std::mem::take(&mut reading.odometry),
                        ..Image::new(frame, truth)
                    }
                }))
            })?;
            match next {
                None => return Err(PyStopIteration::new_err(())),
                Some(Ok(image)) => return Ok(image),
                // A damaged image does not end the recording.
                Some(Err(e)) if e.recoverable => {
                    let text = CString::new(format!("skipped: {e}").replace('\0', " "))?;
                    PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &text, 1)?;
                }
                Some(Err(e)) => return Err(PyValueError::new_err(e.to_string())),
            }
        }
    }

    /// Number of damaged images skipped.
    #[getter]
    fn skipped(&self, py: Python<'_>) -> PyResult<usize> {
        self.source.with(py, |reading| reading.skipped)
    }
}

/// A data set folder or a recording: frames, camera, ground truth. Made by :func:`open`.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Recording {
    input: Arc<Input>,
    options: FrameOptions,
}

#[pymethods]
impl Recording {
    #[new]
    #[pyo3(signature = (path, camera=None, *, color=None, start=None, max_frames=None))]
    fn new(
        py: Python<'_>,
        path: &Bound<'_, PyAny>,
        camera: Option<&Bound<'_, PyAny>>,
        color: Option<&Bound<'_, PyAny>>,
        start: Option<&Bound<'_, PyAny>>,
        max_frames: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let path = arguments::path("path", path)?;
        let camera = camera.map(|c| arguments::path("camera", c)).transpose()?;
        let start = start.map_or(Ok(0), |n| count("start", n, u64::from(u32::MAX)))?;
        let most = max_frames.map(|n| count("max_frames", n, u64::from(u32::MAX)));
        if !path.exists() {
            return Err(PyFileNotFoundError::new_err(format!(
                "path: {}: expected a data set folder or a recording, found nothing there",
                path.display()
            )));
        }
        let options = OpenOptions {
            camera: camera.map(|c| CameraChoice::from_argument(&c.to_string_lossy())),
            ..OpenOptions::default()
        };
        let input = detached(py, || recordings::open(&path, &options))?;
        let input = input.map_err(|e| value("path", e))?;
        let options = FrameOptions {
            start: start as usize,
            max_frames: most.transpose()?.map(|n| n as usize),
            keep_colour: color.map_or(Ok(true), |c| yes("color", c))?,
        };
        // Checks that `start` is not after the last frame.
        input.frames(&options).map_err(|e| value("start", e))?;
        Ok(Self {
            input: Arc::new(input),
            options,
        })
    }

    fn __iter__(&self) -> PyResult<Images> {
        let frames = self.input.frames(&self.options);
        let frames = frames.map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok(Images::new(frames, None))
    }

    fn __len__(&self) -> usize {
        let left = self.input.stamps().len().saturating_sub(self.options.start);
        self.options.max_frames.map_or(left, |n| n.min(left))
    }

    /// The camera.
    #[getter]
    fn camera(&self) -> Camera {
        Camera::of(self.input.camera())
    }

    /// Whether the frames have samples of an inertial sensor with a known mount, as needed by ``Slam(recording.camera, imu=True)``.
    #[getter]
    fn has_imu(&self) -> bool {
        self.input.imu().is_some()
    }

    /// Whether the frames have odometry of a base with a known mount of the camera, as needed by ``Slam(recording.camera, odometry=True)``.
    #[getter]
    fn has_odometry(&self) -> bool {
        self.input.odometry().is_some()
    }

    /// Layout of the folder or format of the file.
    #[getter]
    fn kind(&self) -> String {
        self.input.kind()
    }

    /// Guesses with their reasons, and warnings, one sentence each.
    #[getter]
    fn notes(&self) -> Vec<String> {
        let both = self.input.guesses().iter().chain(self.input.warnings());
        both.cloned().collect()
    }

    /// The ground truth, or None.
    #[getter]
    fn truth(&self) -> PyResult<Option<Trajectory>> {
        let truth = self.input.ground_truth();
        let truth = truth.map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok(truth.map(Trajectory::of))
    }

    fn __repr__(&self) -> String {
        format!(
            "<Recording: {}, {} frames>",
            self.input.kind(),
            self.__len__()
        )
    }
}
