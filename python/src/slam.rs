//! SLAM, frame by frame.

use crate::arguments::{count, path, value};
use crate::arrays;
use crate::begin::Options;
use crate::camera::Camera;
use crate::dense::Dense;
use crate::detections::answer;
use crate::driver::Driver;
use crate::events::Events;
use crate::frame::Frame;
use crate::guard::Turn;
use crate::images::{Handed, Intake, trouble};
use crate::map::Map;
use crate::result::{About, Read};
use crate::sensors::{Beside, Sensors};
use crate::trajectory::Trajectory;
use pyo3::exceptions::{PyFileNotFoundError, PyOSError, PyRuntimeError};
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use pyo3::types::PyType;
use std::path::PathBuf;
use stillpoint::detection::Detection;
use stillpoint::slam::MapUse;
use stillpoint_cli::front;

/// RGB-D SLAM for dynamic scenes.
///
/// Args:
///     camera: a Camera, the name of a preset, a camera file, or a calibration object of another library (see :meth:`Camera.from_info`).
///     config: a Config, a TOML file or a dict of values; None for the defaults.
///     detector: None for none; a function that takes an image ((height, width, 3) uint8, RGB) and returns detections as for :meth:`track`;
///         or a name as for ``stillpoint run --detector`` (``scripted:FILE.csv``, ``FILE.onnx``, the name of a model in the cache,
///         ``auto``).
///     live: whether detection, mapping and loop closure run in separate threads while the next frames are tracked. Otherwise every frame
///         waits for them, and results are reproducible to the bit.
///     color_order: order of the bytes of a colour pixel, ``rgb`` or ``bgr`` (OpenCV).
///     dense: whether a surface of the static scene is fused (see :attr:`dense`); a number sets the voxel size, m.
///     imu: pose camera_from_imu of an inertial sensor whose samples are passed to :meth:`track`, (4, 4) float64, m; True for that of the
///         camera's file or recording; None for no sensor. The noise model is that of a BMI055, unless the camera's file gives another.
///     odometry: pose base_from_camera on a base whose wheel odometry is passed to :meth:`track`, (4, 4) float64, m (base frame: x forward,
///         y left, z up); a dict with that and ``time_offset``, ``slip_per_metre``, ``slip_per_radian``, ``turn_per_metre``; True for that
///         of the camera's file or recording; None for no odometry.
///     prior: whether :meth:`track` gets priors of the camera's pose, such as from your own odometry: True, or a dict with
///         ``slip_per_metre``, ``slip_per_radian``, ``turn_per_metre``, their minimum errors. Excludes odometry.
///
/// Raises:
///     ValueError, TypeError: invalid argument; the message names it.
///
/// >>> room = simulate("xyz", frames=3)
/// >>> slam = Slam(room.camera)
/// >>> for image in room:
/// ...     frame = slam.track(image.stamp, image.color, image.depth)
/// >>> frame.state, frame.pose.shape
/// ('tracked', (4, 4))
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Slam {
    pub(crate) driver: Turn<Driver>,
    pub(crate) intake: Intake,
    /// The user's function, in a single-threaded run.
    pub(crate) function: Option<Py<PyAny>>,
    pub(crate) sensors: Sensors,
    pub(crate) about: About,
}

fn map_file(found: &Bound<'_, PyAny>) -> PyResult<PathBuf> {
    let path = path("path", found)?;
    if path.exists() {
        return Ok(path);
    }
    Err(PyFileNotFoundError::new_err(format!(
        "path: {}: expected a map file, found no such file",
        path.display()
    )))
}

#[pymethods]
impl Slam {
    #[new]
    #[pyo3(signature = (camera, config=None, detector=None, live=None, *, color_order=None, dense=None, imu=None, odometry=None, prior=None))]
    #[allow(clippy::too_many_arguments)] // Named in Python.
    fn new(
        camera: &Bound<'_, PyAny>,
        config: Option<&Bound<'_, PyAny>>,
        detector: Option<&Bound<'_, PyAny>>,
        live: Option<&Bound<'_, PyAny>>,
        color_order: Option<&Bound<'_, PyAny>>,
        dense: Option<&Bound<'_, PyAny>>,
        imu: Option<&Bound<'_, PyAny>>,
        odometry: Option<&Bound<'_, PyAny>>,
        prior: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let py = camera.py();
        let options = Options {
            camera,
            config,
            detector,
            live,
            color_order,
            dense,
            imu,
            odometry,
            prior,
        };
        options.check(None)?.begin(py)
    }

    /// Continues with a map written by :meth:`save` or ``stillpoint run --save-map``: the camera is lost until it is relocalised in the
    /// map. The other arguments are those of the class.
    ///
    /// Raises:
    ///     FileNotFoundError: the file does not exist.
    ///     ValueError: not a map, or one of another camera.
    #[classmethod]
    #[pyo3(signature = (path, camera, config=None, detector=None, live=None, *, color_order=None, dense=None, imu=None, odometry=None, prior=None))]
    #[allow(clippy::too_many_arguments)] // Those of the class, and the path.
    fn load(
        _cls: &Bound<'_, PyType>,
        path: &Bound<'_, PyAny>,
        camera: &Bound<'_, PyAny>,
        config: Option<&Bound<'_, PyAny>>,
        detector: Option<&Bound<'_, PyAny>>,
        live: Option<&Bound<'_, PyAny>>,
        color_order: Option<&Bound<'_, PyAny>>,
        dense: Option<&Bound<'_, PyAny>>,
        imu: Option<&Bound<'_, PyAny>>,
        odometry: Option<&Bound<'_, PyAny>>,
        prior: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let path = map_file(path)?;
        let py = camera.py();
        let options = Options {
            camera,
            config,
            detector,
            live,
            color_order,
            dense,
            imu,
            odometry,
            prior,
        };
        options.check(Some((path, MapUse::Grow)))?.begin(py)
    }

    /// Localises the camera in a map without changing it. The arguments are those of :meth:`load`.
    #[classmethod]
    #[pyo3(signature = (path, camera, config=None, detector=None, live=None, *, color_order=None, imu=None, odometry=None, prior=None))]
    #[allow(clippy::too_many_arguments)] // As for `load`.
    fn localize(
        _cls: &Bound<'_, PyType>,
        path: &Bound<'_, PyAny>,
        camera: &Bound<'_, PyAny>,
        config: Option<&Bound<'_, PyAny>>,
        detector: Option<&Bound<'_, PyAny>>,
        live: Option<&Bound<'_, PyAny>>,
        color_order: Option<&Bound<'_, PyAny>>,
        imu: Option<&Bound<'_, PyAny>>,
        odometry: Option<&Bound<'_, PyAny>>,
        prior: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let path = map_file(path)?;
        let py = camera.py();
        let options = Options {
            camera,
            config,
            detector,
            live,
            color_order,
            dense: None,
            imu,
            odometry,
            prior,
        };
        options.check(Some((path, MapUse::Localize)))?.begin(py)
    }

    /// Tracks the next frame, without the interpreter's lock.
    ///
    /// Args:
    ///     stamp: time of the colour image: seconds as a float, or nanoseconds as an int. Must ascend.
    ///     color: (height, width, 3) uint8 in the order of color_order, or grey as (height, width) uint8. Any strides; copied.
    ///     depth: registered to the colour image, (height, width): uint16 in the camera's unit, or float32 or float64 in metres; 0 or NaN
    ///         if unmeasured.
    ///     detections: detections in this frame: an array of N x 6 (x0, y0, x1, y1, score, class of COCO), or a list of such rows and of
    ///         Detection. Empty means that the detector found nothing; None that it did not run.
    ///     depth_stamp: time of the depth image, as stamp; None for the same time.
    ///     imu: samples since the previous frame, and the first one after this frame if available: (N, 7), stamp (s), angular rate x, y, z
    ///         (rad/s), specific force x, y, z (m/s^2). Only with ``Slam(..., imu=...)``.
    ///     odometry: poses of the base since the previous frame, and the first one after this frame if available: (N, 8), stamp (s),
    ///         position x, y, z (m), orientation x, y, z, w; or (N, 10), with cumulative standard deviations of position (m) and
    ///         orientation (rad). Only motions between samples are used. Only with ``Slam(..., odometry=...)``.
    ///     prior: pose of the camera (x right, y down, z forward) at this frame in your own frame of reference, (4, 4) float64, m; or a
    ///         pair of that and the covariance of the motion since the previous prior, (6, 6), [translation; rotation] in the camera's
    ///         frame, m and rad, of which the largest variances are used. Only motions between priors are used. Only with ``Slam(...,
    ///         prior=...)``.
    ///
    /// Returns:
    ///     The results of the frame.
    ///
    /// Raises:
    ///     ValueError, TypeError: invalid argument; the message names it, and the state is unchanged.
    ///     RuntimeError: the run is finished.
    #[pyo3(signature = (stamp, color, depth, detections=None, *, depth_stamp=None, imu=None, odometry=None, prior=None))]
    #[allow(clippy::too_many_arguments)] // Named in Python.
    fn track(
        &self,
        py: Python<'_>,
        stamp: &Bound<'_, PyAny>,
        color: &Bound<'_, PyAny>,
        depth: &Bound<'_, PyAny>,
        detections: Option<&Bound<'_, PyAny>>,
        depth_stamp: Option<&Bound<'_, PyAny>>,
        imu: Option<&Bound<'_, PyAny>>,
        odometry: Option<&Bound<'_, PyAny>>,
        prior: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Frame> {
        let mut samples = self.sensors.check(&Beside {
            imu,
            odometry,
            prior,
        })?;
        let handed = Handed {
            stamp,
            colour: color,
            depth,
            depth_stamp,
            detections,
        };
        let (taken, mut seen) = self.intake.take(py, &handed)?;
        if let (None, Some(function)) = (&seen, &self.function) {
            seen = self.ask(py, function, taken.colour.as_ref())?;
        }
        let tracked = self.driver.with(py, |driver| {
            driver.receive_odometry(self.sensors.odometry(&mut samples, taken.stamp));
            driver.receive_inertial(samples.inertial);
            driver.track(taken, seen)
        })?;
        tracked.map(Frame::new).map_err(trouble)
    }

    /// Final, smoothed poses of all frames tracked, after all corrections: those of the submap with most frames. After :meth:`finish`
    /// :meth:`Trajectory.save` writes the same bytes as the command line's ``trajectory.txt``.
    fn trajectory(&self, py: Python<'_>) -> PyResult<Trajectory> {
        let entries = self.driver.with(py, |driver| driver.known().poses())?;
        Ok(Trajectory::of_entries(entries))
    }

    /// The current map.
    #[getter]
    fn map(&self, py: Python<'_>) -> PyResult<Map> {
        Ok(Map::new(
            self.driver.with(py, |driver| driver.known().view)?,
        ))
    }

    /// The current surface: mesh and grid. After :meth:`finish` it is fused at the final poses.
    ///
    /// Raises:
    ///     RuntimeError: run without ``dense``.
    #[getter]
    fn dense(&self, py: Python<'_>) -> PyResult<Dense> {
        let map = self.driver.with(py, |driver| driver.surface())?;
        map.map(Dense::new).ok_or_else(|| {
            PyRuntimeError::new_err("expected a run with a surface, found one without; begin it with Slam(..., dense=True)")
        })
    }

    /// Events from the time of the call, as an iterator; a queue of more than `room` events (1024) drops the oldest.
    #[pyo3(signature = (room=None))]
    fn events(&self, py: Python<'_>, room: Option<&Bound<'_, PyAny>>) -> PyResult<Events> {
        let room = room.map_or(Ok(1024), |r| count("room", r, 1_000_000))?;
        let room = usize::try_from(room).unwrap_or(1).max(1);
        Ok(Events::new(
            self.driver.with(py, |driver| driver.listen(room))?,
        ))
    }

    /// Writes a map file for :meth:`load`, :meth:`localize` and the command line, with the surface if there is one; atomically, at any
    /// time.
    ///
    /// Raises:
    ///     ValueError: there is no map yet, or it cannot be written.
    fn save(&self, py: Python<'_>, path: &Bound<'_, PyAny>) -> PyResult<()> {
        let path = self::path("path", path)?;
        let saved = self.driver.with(py, |driver| {
            let surface = driver.surface();
            driver.with_map(|map, timing| front::save_map(&path, map, timing, surface.as_ref()))
        })?;
        match saved {
            Some(saved) => saved.map_err(|e| value("path", e)),
            None => Err(PyRuntimeError::new_err(
                "expected a map to save, found none: mapping ended",
            )),
        }
    }

    /// Ends the stream and completes pending work. Results stay readable; idempotent.
    fn finish(&self, py: Python<'_>) -> PyResult<()> {
        self.driver.with(py, Driver::finish)
    }

    /// Whether :meth:`finish` was called.
    #[getter]
    fn is_finished(&self, py: Python<'_>) -> PyResult<bool> {
        self.driver.with(py, |driver| driver.is_over())
    }

    /// The camera.
    #[getter]
    fn camera(&self) -> Camera {
        self.intake.camera.clone()
    }

    /// Records the result folder of a run over a recording, optionally with pictures for the report.
    fn _keep_result(&self, py: Python<'_>, pictures: bool) -> PyResult<()> {
        if pictures {
            self.intake.keep_colour();
        }
        let recorder = self.about.recorder(pictures);
        let kept = self
            .driver
            .with(py, |driver| driver.keep_result(recorder))?;
        kept.map_err(|e| PyOSError::new_err(format!("expected to start a thread, found: {e}")))
    }

    /// Writes the result folder. `input` is path, layout and source of the camera; `how` is the command to repeat the run, the number of
    /// unreadable frames, and the duration, s.
    fn _write_result(
        &self,
        py: Python<'_>,
        folder: PathBuf,
        input: [String; 3],
        how: (String, usize, f64),
        truth: Option<Bound<'_, Trajectory>>,
    ) -> PyResult<()> {
        let (command, skipped, seconds) = how;
        let read = Read {
            input,
            command,
            truth: truth.as_ref().map(Bound::get),
            skipped,
            seconds,
        };
        let about = &self.about;
        self.driver
            .with(py, |driver| about.write(driver, &folder, read))?
    }

    fn __enter__(this: Bound<'_, Self>) -> Bound<'_, Self> {
        this
    }

    #[pyo3(signature = (*_how))]
    fn __exit__(&self, py: Python<'_>, _how: &Bound<'_, PyAny>) -> PyResult<()> {
        self.finish(py)
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.function.as_ref().map_or(Ok(()), |f| visit.call(f))
    }

    fn _repr_html_<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let module = this.py().import("stillpoint_slam._html")?;
        module.call_method1("slam", (this,))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (frames, keyframes, landmarks) = self.driver.with(py, |driver| {
            let known = driver.known();
            let view = &known.view;
            (
                known.trajectory.entries().len(),
                view.keyframe_count(),
                view.landmark_count(),
            )
        })?;
        Ok(format!(
            "<Slam: {frames} frames with a pose, {keyframes} keyframes, {landmarks} landmarks>"
        ))
    }
}

impl Slam {
    /// Calls the user's function, if it is due for this frame.
    fn ask(
        &self,
        py: Python<'_>,
        function: &Py<PyAny>,
        colour: Option<&std::sync::Arc<stillpoint::imaging::ColourImage>>,
    ) -> PyResult<Option<Vec<Detection>>> {
        let asks = self.driver.with(py, |driver| driver.asks())?;
        let Some(colour) = colour.filter(|_| asks) else {
            return Ok(None);
        };
        let image = arrays::shared_colour(py, colour.clone())?;
        answer(function.bind(py), image).map(Some)
    }
}
