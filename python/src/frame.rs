//! What became of a frame.

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

/// A frame that went through tracking: pose, state, verdicts, mask, objects, health. It never changes.
///
/// Attributes are computed when they are asked for; images are views without a copy and cannot be written to.
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

    /// Stamp of its colour image, s.
    #[getter]
    fn stamp(&self) -> f64 {
        self.event.report.stamp
    }

    /// initialised (a map begins here), tracked, relocalised, carried (by a gyroscope or wheels) or lost.
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

    /// Why there is no pose, in words; None when there is one.
    #[getter]
    fn reason(&self) -> Option<String> {
        match (self.event.report.outcome, &self.event.health.loss) {
            (_, Some(loss)) => Some(loss.to_string()),
            (Outcome::Lost { reason, .. }, None) => Some(reason.to_string()),
            _ => None,
        }
    }

    /// Pose world_from_camera as known at this frame, (4, 4) float64, m; None when it is lost.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.pose_of().map(|p| arrays::pose(py, p)).transpose()
    }

    /// Position of the camera in the world, (3,) float64, m; None when it is lost.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let t = self.pose_of()?.translation;
        Some(arrays::row(py, vec![t.x, t.y, t.z]))
    }

    /// Rotation of the pose as x, y, z, w with w >= 0, (4,) float64; None when it is lost.
    #[getter]
    fn quaternion<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let pose = self.pose_of()?;
        Some(arrays::row(py, arrays::quaternion(pose).to_vec()))
    }

    /// Covariance of the pose as a twist [translation; rotation] in the axes of the camera, (6, 6) float64, in m and rad; None where it is
    /// not known.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let m = self.event.health.covariance.as_ref();
        m.map(|m| arrays::square(py, m)).transpose()
    }

    /// Landmark matches that agree with the pose.
    #[getter]
    fn inliers(&self) -> u32 {
        self.event.report.counts.inliers
    }

    /// How many features each step dealt with, by name.
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

    /// Whether it became a keyframe.
    #[getter]
    fn is_keyframe(&self) -> bool {
        self.event.report.is_keyframe
    }

    /// Number of the submap that the pose is in; None when it is lost.
    #[getter]
    fn submap(&self) -> Option<u32> {
        self.event.report.submap.map(|s| s.0)
    }

    /// Whether the pose may ride on somebody: as a map has just begun, until it is known who moves, when it may be replaced later; or as few landmarks
    /// hold it while much moves.
    #[getter]
    fn undecided(&self) -> bool {
        self.event.report.is_undecided()
    }

    /// What was said of each keypoint: whether it moves, and why.
    #[getter]
    fn verdicts(&self) -> Verdicts {
        Verdicts {
            all: Arc::clone(&self.event.report.verdicts),
        }
    }

    /// What moves, (height, width) uint8: 255 where the scene moves, 0 where it stands still or nothing is known.
    #[getter]
    fn mask<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let images = self.images()?;
        let segments = &self.event.report.segments;
        mask(py, || segments.mask(images))
    }

    /// The objects that detections led to, as they are expected in this frame.
    #[getter]
    fn objects(&self) -> Vec<Object> {
        Object::all(&self.event.report.objects)
    }

    /// How well things stand.
    #[getter]
    fn health(&self) -> Health {
        Health {
            standing: self.event.health.clone(),
        }
    }

    /// What is known of the inertial sensor, by name: ``state`` (unconfirmed, confirmed or ignored), ``reason`` why it is ignored, ``gyro_bias``
    /// (rad/s, its axes) and ``gyro_bias_sigma``, ``rotation`` (x, y, z, w: turns its axes to the camera's, as estimated) and ``rotation_sigma``
    /// (rad), ``time_offset`` (s, to be added to its stamps, as estimated) and ``time_offset_sigma``, ``up`` in the world, or None. None without one.
    #[getter]
    fn inertial<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let report = self.event.report.inertial.as_ref();
        report.map(|r| crate::inertial::report(py, r)).transpose()
    }

    /// What is known of the odometry, or of the poses that were handed over beforehand, by name: ``state`` (unconfirmed, confirmed or ignored), ``reason`` why it is ignored,
    /// or None, ``samples`` that were used so far, ``slips``: how often it went otherwise than the map bears out. None without any.
    #[getter]
    fn odometry<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let report = self.event.report.odometry.as_ref();
        report.map(|r| crate::odometry::report(py, r)).transpose()
    }

    /// The grey image that was tracked, (height, width) uint8; a view that cannot be written to.
    #[getter]
    fn gray<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        arrays::gray(&this.get().images()?.gray, this.clone().into_any())
    }

    /// The depth image that was tracked, (height, width) float32, m, 0 where there is none; a view that cannot be written to.
    #[getter]
    fn depth<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::depth(&this.get().images()?.depth, this.clone().into_any())
    }

    /// The colour image as RGB, (height, width, 3) uint8, where a detector or a surface wanted it, else None; a view that cannot be written to.
    #[getter]
    fn color<'py>(this: &Bound<'py, Self>) -> PyResult<Option<Bound<'py, PyArray3<u8>>>> {
        let colour = this.get().images()?.colour.as_ref();
        colour
            .map(|c| arrays::colour(c, this.clone().into_any()))
            .transpose()
    }

    /// Draws the frame with its keypoints and what moves by matplotlib, and returns the axes.
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

/// A mask as an array; it takes a while to draw.
pub(crate) fn mask(
    py: Python<'_>,
    draw: impl FnOnce() -> stillpoint::imaging::GrayImage + Send,
) -> PyResult<Bound<'_, PyArray2<u8>>> {
    let image = crate::guard::detached(py, draw)?;
    let shape = (image.height(), image.width());
    arrays::grid(py, shape, image.data().to_vec())
}

/// What the static filter says of keypoints, N of them, in the order of extraction.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Verdicts {
    pub(crate) all: Arc<[FeatureVerdict]>,
}

#[pymethods]
impl Verdicts {
    fn __len__(&self) -> usize {
        self.all.len()
    }

    /// Where they are, (N, 2) float32, raw px as x, y.
    #[getter]
    fn pixels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::table(py, self.all.iter().map(|v| v.pixel))
    }

    /// Whether each moves and is kept from tracking and mapping, (N,) bool.
    #[getter]
    fn dynamic<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        arrays::row(py, self.all.iter().map(|v| v.dynamic).collect())
    }

    /// Risk of keeping each, in log odds of "moving", (N,) float32.
    #[getter]
    fn risk<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        arrays::row(py, self.all.iter().map(|v| v.risk).collect())
    }

    /// Why, one text per keypoint, joined by +: object, epipolar, depth, rigid, age, parked, released; empty for no reason.
    #[getter]
    fn reasons(&self) -> Vec<String> {
        self.all.iter().map(|v| v.reasons.to_string()).collect()
    }

    fn __repr__(&self) -> String {
        let moving = self.all.iter().filter(|v| v.dynamic).count();
        format!("<Verdicts: {moving} of {} move>", self.all.len())
    }
}

/// How well things stand at a frame, for users who rely on the pose.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Health {
    standing: Standing,
}

#[pymethods]
impl Health {
    /// Quality of the pose, 0 (lost) to 1: the least of :attr:`parts`.
    #[getter]
    fn quality(&self) -> f64 {
        self.standing.quality.value()
    }

    /// What the quality is made of, by name, each 0 to 1.
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

    /// Standard deviation of the position, m; None where it is not known.
    #[getter]
    fn sigma_m(&self) -> Option<f64> {
        self.standing.sigma_m()
    }

    /// Standard deviation of the direction, rad; None where it is not known.
    #[getter]
    fn sigma_rad(&self) -> Option<f64> {
        self.standing.sigma_rad()
    }

    /// Share of the keypoints that stand still, 0 to 1.
    #[getter]
    fn static_share(&self) -> f64 {
        self.standing.static_share
    }

    /// Share of the keypoints that move, 0 to 1.
    #[getter]
    fn dynamic_share(&self) -> f64 {
        self.standing.dynamic_share
    }

    /// Share of the pixels that have a depth, 0 to 1.
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

    /// Why the camera is lost and what helps, in words; None when it is not.
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
