//! Results of a frame.

use crate::arrays;
use crate::objects::Object;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;
use stillpoint::geometry::Se3;
use stillpoint::imaging::RgbdFrame;
use stillpoint::slam::{FeatureVerdict, FrameEvent, Health as Standing, Outcome};

/// A tracked frame: pose, state, verdicts, mask, objects, health. Immutable.
///
/// Attributes are computed on access; images are read-only views without a copy.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Frame {
    event: Arc<FrameEvent>,
}

impl Frame {
    pub(crate) fn new(event: Arc<FrameEvent>) -> Self {
        Self { event }
    }

    fn pose_of(&self) -> Option<&Se3> {
        self.event.report.world_from_camera.as_ref()
    }

    fn images(&self) -> PyResult<&Arc<RgbdFrame>> {
        self.event.frame.as_ref().ok_or_else(|| {
            PyRuntimeError::new_err(
                "expected a frame with its images, found one from the events of a run, which come without; take what track returns",
            )
        })
    }
}

#[pymethods]
impl Frame {
    /// Number of the frame, from 0.
    #[getter]
    fn index(&self) -> u32 {
        self.event.report.frame.0
    }

    /// Stamp of the colour image, s.
    #[getter]
    fn stamp(&self) -> f64 {
        self.event.report.stamp
    }

    /// State: initialised (start of a map), tracked, relocalised, carried (by a gyroscope or wheel odometry) or lost.
    #[getter]
    fn state(&self) -> &'static str {
        match self.event.report.outcome {
            Outcome::Initialised => "initialised",
            Outcome::Tracked => "tracked",
            Outcome::Relocalised { .. } => "relocalised",
            Outcome::Carried { .. } => "carried",
            Outcome::Lost { .. } => "lost",
        }
    }

    /// Whether there is a pose.
    #[getter]
    fn is_tracked(&self) -> bool {
        self.pose_of().is_some()
    }

    /// Reason for the lack of a pose, as text; None if there is one.
    #[getter]
    fn reason(&self) -> Option<String> {
        match (self.event.report.outcome, &self.event.health.loss) {
            (_, Some(loss)) => Some(loss.to_string()),
            (Outcome::Lost { reason, .. }, None) => Some(reason.to_string()),
            _ => None,
        }
    }

    /// Pose world_from_camera as known at this frame, (4, 4) float64, m; None if lost.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.pose_of().map(|p| arrays::pose(py, p)).transpose()
    }

    /// Position of the camera in the world, (3,) float64, m; None if lost.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let t = self.pose_of()?.translation;
        Some(arrays::row(py, vec![t.x, t.y, t.z]))
    }

    /// Rotation of the pose as x, y, z, w with w >= 0, (4,) float64; None if lost.
    #[getter]
    fn quaternion<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let pose = self.pose_of()?;
        Some(arrays::row(py, arrays::quaternion(pose).to_vec()))
    }

    /// Covariance of the pose as a twist [translation; rotation] in the camera's frame, (6, 6) float64, in m and rad; None if unknown.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let m = self.event.health.covariance.as_ref();
        m.map(|m| arrays::square(py, m)).transpose()
    }

    /// Number of inlier landmark matches.
    #[getter]
    fn inliers(&self) -> u32 {
        self.event.report.counts.inliers
    }

    /// Numbers of features in each step, by name.
    #[getter]
    fn counts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let c = &self.event.report.counts;
        let counts = PyDict::new(py);
        for (name, count) in [
            ("keypoints", c.keypoints),
            ("dynamic", c.dynamic),
            ("released", c.released),
            ("with_depth", c.with_depth),
            ("frame_matches", c.frame_matches),
            ("local_visible", c.local_visible),
            ("map_matches", c.map_matches),
            ("inliers", c.inliers),
            ("detections_too_late", c.detections_too_late),
            ("detections_without_pose", c.detections_without_pose),
        ] {
            counts.set_item(name, count)?;
        }
        Ok(counts)
    }

    /// Whether the frame became a keyframe.
    #[getter]
    fn is_keyframe(&self) -> bool {
        self.event.report.is_keyframe
    }

    /// Number of the pose's submap; None if lost.
    #[getter]
    fn submap(&self) -> Option<u32> {
        self.event.report.submap.map(|s| s.0)
    }

    /// Whether it is undecided which surfaces move, so that the pose may follow a moving object and be replaced later: the map was just
    /// started, or few landmarks support the pose while much moves.
    #[getter]
    fn undecided(&self) -> bool {
        self.event.report.is_undecided()
    }

    /// The static filter's verdict on each keypoint, with reasons.
    #[getter]
    fn verdicts(&self) -> Verdicts {
        Verdicts {
            all: Arc::clone(&self.event.report.verdicts),
        }
    }

    /// Mask of moving regions, (height, width) uint8: 255 where the scene moves, 0 where it is static or unknown.
    #[getter]
    fn mask<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let images = self.images()?;
        let segments = &self.event.report.segments;
        mask(py, || segments.mask(images))
    }

    /// Objects tracked from detections, as predicted in this frame.
    #[getter]
    fn objects(&self) -> Vec<Object> {
        Object::all(&self.event.report.objects)
    }

    /// Health of tracking.
    #[getter]
    fn health(&self) -> Health {
        Health {
            standing: self.event.health.clone(),
        }
    }

    /// State of the inertial sensor, by name: ``state`` (unconfirmed, confirmed or ignored), ``reason`` (why it is ignored), ``gyro_bias``
    /// (rad/s, sensor frame) and ``gyro_bias_sigma``, ``rotation`` (estimated, sensor to camera frame: x, y, z, w) and ``rotation_sigma``
    /// (rad), ``time_offset`` (estimated, added to the sensor's stamps, s) and ``time_offset_sigma``, ``up`` in the world, or None. None
    /// without a sensor.
    #[getter]
    fn inertial<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let report = self.event.report.inertial.as_ref();
        report.map(|r| crate::inertial::report(py, r)).transpose()
    }

    /// State of the odometry or of priors, by name: ``state`` (unconfirmed, confirmed or ignored), ``reason`` (why it is ignored) or None,
    /// ``samples`` used, ``slips``: number of motions that the map contradicted. None without either.
    #[getter]
    fn odometry<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let report = self.event.report.odometry.as_ref();
        report.map(|r| crate::odometry::report(py, r)).transpose()
    }

    /// The tracked grey image, (height, width) uint8; a read-only view.
    #[getter]
    fn gray<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        arrays::gray(&this.get().images()?.gray, this.clone().into_any())
    }

    /// The tracked depth image, (height, width) float32, m, 0 if unmeasured; a read-only view.
    #[getter]
    fn depth<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::depth(&this.get().images()?.depth, this.clone().into_any())
    }

    /// The colour image as RGB, (height, width, 3) uint8, if a detector or the surface needs colours, else None; a read-only view.
    #[getter]
    fn color<'py>(this: &Bound<'py, Self>) -> PyResult<Option<Bound<'py, PyArray3<u8>>>> {
        let colour = this.get().images()?.colour.as_ref();
        colour
            .map(|c| arrays::colour(c, this.clone().into_any()))
            .transpose()
    }

    /// Plots the frame with its keypoints and moving regions by matplotlib, and returns the axes.
    #[pyo3(signature = (ax=None))]
    fn plot<'py>(
        this: &Bound<'py, Self>,
        ax: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let module = this.py().import("stillpoint_slam._plot")?;
        module.call_method1("frame", (this, ax))
    }

    fn _repr_html_<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let module = this.py().import("stillpoint_slam._html")?;
        module.call_method1("frame", (this,))
    }

    fn __repr__(&self) -> String {
        let (report, health) = (&self.event.report, &self.event.health);
        format!(
            "<Frame {} at {:.6} s: {}, {health}>",
            report.frame,
            report.stamp,
            self.state()
        )
    }
}

/// A mask as an array. Drawing it takes time, so without the interpreter's lock.
pub(crate) fn mask(
    py: Python<'_>,
    draw: impl FnOnce() -> stillpoint::imaging::GrayImage + Send,
) -> PyResult<Bound<'_, PyArray2<u8>>> {
    let image = crate::guard::detached(py, draw)?;
    let shape = (image.height(), image.width());
    arrays::grid(py, shape, image.data().to_vec())
}

/// The static filter's verdicts on N keypoints, in the order of extraction.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Verdicts {
    pub(crate) all: Arc<[FeatureVerdict]>,
}

#[pymethods]
impl Verdicts {
    fn __len__(&self) -> usize {
        self.all.len()
    }

    /// Positions, (N, 2) float32, raw px as x, y.
    #[getter]
    fn pixels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::table(py, self.all.iter().map(|v| v.pixel))
    }

    /// Whether each is dynamic and excluded from tracking and mapping, (N,) bool.
    #[getter]
    fn dynamic<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        arrays::row(py, self.all.iter().map(|v| v.dynamic).collect())
    }

    /// Risk of each, as log odds of "moving", (N,) float32.
    #[getter]
    fn risk<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        arrays::row(py, self.all.iter().map(|v| v.risk).collect())
    }

    /// Reasons, one text per keypoint, joined by +: object, epipolar, depth, rigid, age, parked, released; empty for none.
    #[getter]
    fn reasons(&self) -> Vec<String> {
        self.all.iter().map(|v| v.reasons.to_string()).collect()
    }

    fn __repr__(&self) -> String {
        let moving = self.all.iter().filter(|v| v.dynamic).count();
        format!("<Verdicts: {moving} of {} move>", self.all.len())
    }
}

/// Health of tracking at a frame, for users who rely on the pose.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Health {
    standing: Standing,
}

#[pymethods]
impl Health {
    /// Quality of the pose, 0 (lost) to 1: the minimum of :attr:`parts`.
    #[getter]
    fn quality(&self) -> f64 {
        self.standing.quality.value()
    }

    /// Components of the quality, by name, each 0 to 1.
    #[getter]
    fn parts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let q = &self.standing.quality;
        let parts = PyDict::new(py);
        parts.set_item("inliers", q.inliers)?;
        parts.set_item("agreement", q.agreement)?;
        parts.set_item("spread", q.spread)?;
        parts.set_item("certainty", q.certainty)?;
        Ok(parts)
    }

    /// Standard deviation of the position, m; None if unknown.
    #[getter]
    fn sigma_m(&self) -> Option<f64> {
        self.standing.sigma_m()
    }

    /// Standard deviation of the orientation, rad; None if unknown.
    #[getter]
    fn sigma_rad(&self) -> Option<f64> {
        self.standing.sigma_rad()
    }

    /// Share of static keypoints, 0 to 1.
    #[getter]
    fn static_share(&self) -> f64 {
        self.standing.static_share
    }

    /// Share of dynamic keypoints, 0 to 1.
    #[getter]
    fn dynamic_share(&self) -> f64 {
        self.standing.dynamic_share
    }

    /// Share of pixels with depth, 0 to 1.
    #[getter]
    fn depth_share(&self) -> f64 {
        self.standing.depth_share
    }

    /// Age of the newest detections, s; None before the first.
    #[getter]
    fn detections_age(&self) -> Option<f64> {
        self.standing.detections_age
    }

    /// Age of the map that tracking uses, s; None before its first change.
    #[getter]
    fn map_age(&self) -> Option<f64> {
        self.standing.map_age
    }

    /// Reason for the loss, with advice, as text; None if the camera is not lost.
    #[getter]
    fn loss(&self) -> Option<String> {
        self.standing.loss.as_ref().map(ToString::to_string)
    }

    fn __str__(&self) -> String {
        self.standing.to_string()
    }

    fn __repr__(&self) -> String {
        format!("<Health: {}>", self.standing)
    }
}
