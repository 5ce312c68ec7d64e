//! Objects tracked from detections.

use crate::arrays;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use stillpoint::detection::{Motion, Object as Tracked, ObjectState};

/// A tracked object at a frame: class, position and motion.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Object {
    tracked: Tracked,
}

impl Object {
    pub(crate) fn all(objects: &[Tracked]) -> Vec<Self> {
        let one = |tracked: &Tracked| Self {
            tracked: tracked.clone(),
        };
        objects.iter().map(one).collect()
    }
}

#[pymethods]
impl Object {
    /// Id, never reused.
    #[getter]
    fn id(&self) -> u32 {
        self.tracked.id.0
    }

    /// Name of the class (COCO).
    #[getter]
    fn class_name(&self) -> &'static str {
        self.tracked.class.name()
    }

    /// Score of its last detection, 0 to 1.
    #[getter]
    fn score(&self) -> f32 {
        self.tracked.score
    }

    /// State of the track: tentative, confirmed, coasting or hidden.
    #[getter]
    fn state(&self) -> &'static str {
        match self.tracked.state {
            ObjectState::Tentative => "tentative",
            ObjectState::Confirmed => "confirmed",
            ObjectState::Coasting => "coasting",
            ObjectState::Hidden => "hidden",
        }
    }

    /// State of motion: unknown, moving or parked.
    #[getter]
    fn motion(&self) -> &'static str {
        match self.tracked.motion {
            Motion::Unknown => "unknown",
            Motion::Moving => "moving",
            Motion::Parked => "parked",
        }
    }

    /// Predicted box in the raw image: x0, y0, x1, y1, px.
    #[getter]
    fn r#box(&self) -> (f64, f64, f64, f64) {
        let b = &self.tracked.bounds;
        (b.x0, b.y0, b.x1, b.y1)
    }

    /// Centre of the visible surface in the world, (3,) float64, m; None before its depth was measured.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let p = self.tracked.position?;
        Some(arrays::row(py, vec![p.x, p.y, p.z]))
    }

    /// Velocity in the world, (3,) float64, m/s; None without a position.
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let v = self.tracked.velocity?;
        Some(arrays::row(py, vec![v.x, v.y, v.z]))
    }

    /// Covariance of position and velocity, (6, 6) float64, in m and s; None without a position.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let m = self.tracked.covariance.as_ref();
        m.map(|m| arrays::square(py, m)).transpose()
    }

    /// Width and height, m; None without a position.
    #[getter]
    fn size(&self) -> Option<(f64, f64)> {
        self.tracked.size.map(|[w, h]| (w, h))
    }

    /// Stamp of the last detection, s.
    #[getter]
    fn last_seen(&self) -> f64 {
        self.tracked.last_seen
    }

    fn __repr__(&self) -> String {
        let (id, class) = (self.tracked.id.0, self.tracked.class.name());
        format!("<Object {id}: {class}, {}>", self.motion())
    }
}
