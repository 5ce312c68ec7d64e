//! A version of the map.

use crate::arrays;
use crate::trajectory::Trajectory;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use std::sync::Arc;
use stillpoint::datasets::StampedPose;
use stillpoint::map::MapView;

/// Landmarks and keyframes of the map at the time of the call. Immutable.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Map {
    view: Arc<MapView>,
}

impl Map {
    pub(crate) fn new(view: Arc<MapView>) -> Self {
        Self { view }
    }
}

#[pymethods]
impl Map {
    /// Version, increased by every change.
    #[getter]
    fn version(&self) -> u64 {
        self.view.version()
    }

    /// Landmarks in the world, (N, 3) float64, m.
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let at = |(id, _)| self.view.landmark_position(id).map(Into::into);
        arrays::table::<f64, 3>(py, self.view.landmarks().filter_map(at))
    }

    /// Ids of the landmarks, (N,) uint32, in the order of :attr:`points`; never reused.
    #[getter]
    fn point_ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let known = |(id, _)| self.view.landmark_position(id).map(|_| id.number());
        arrays::row(py, self.view.landmarks().filter_map(known).collect())
    }

    /// Number of keyframes that observe each landmark, (N,) uint32, in the order of :attr:`points`.
    #[getter]
    fn observers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let count = |(id, l): (_, &stillpoint::map::Landmark)| {
            self.view.landmark_position(id).map(|_| l.observers)
        };
        arrays::row(py, self.view.landmarks().filter_map(count).collect())
    }

    /// Poses of the K keyframes as a trajectory.
    #[getter]
    fn keyframes(&self) -> Trajectory {
        let one = |k: &Arc<stillpoint::map::Keyframe>| StampedPose {
            stamp: k.data.stamp,
            world_from_camera: k.world_from_camera,
        };
        Trajectory::of(self.view.keyframes().map(one).collect())
    }

    /// Ids of the keyframes, (K,) uint32: their frame numbers, in a run that started without a map.
    #[getter]
    fn keyframe_ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        arrays::row(py, self.view.keyframes().map(|k| k.id.0).collect())
    }

    /// Poses world_from_camera of the keyframes, (K, 4, 4) float64, m.
    #[getter]
    fn keyframe_poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        arrays::poses(py, self.view.keyframes().map(|k| &k.world_from_camera))
    }

    /// Number of the submap of each keyframe, (K,) uint32: each submap has its own frame of reference.
    #[getter]
    fn submaps<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        arrays::row(py, self.view.keyframes().map(|k| k.submap.0).collect())
    }

    /// Covisibility edges of keyframes, (E, 3) uint32: two ids, the lower first, and the number of shared landmarks.
    #[getter]
    fn covisibility<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let edges = self.view.keyframes().flat_map(|k| {
            let later = k.covisible.iter().filter(move |(other, _)| *other > k.id);
            later.map(move |(other, shared)| [k.id.0, other.0, *shared])
        });
        arrays::table(py, edges)
    }

    /// Closed loops, (L, 2) uint32: the ids of their keyframes, the older first.
    #[getter]
    fn loops<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let edges = self.view.loops().map(|l| [l.old.0, l.new.0]);
        arrays::table(py, edges)
    }

    /// Plots landmarks and keyframes from above by matplotlib, and returns the axes.
    #[pyo3(signature = (ax=None))]
    fn plot<'py>(
        this: &Bound<'py, Self>,
        ax: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let module = this.py().import("stillpoint_slam._plot")?;
        module.call_method1("map", (this, ax))
    }

    fn _repr_html_<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let module = this.py().import("stillpoint_slam._html")?;
        module.call_method1("map", (this,))
    }

    fn __repr__(&self) -> String {
        let (keyframes, landmarks) = (self.view.keyframe_count(), self.view.landmark_count());
        format!(
            "<Map version {}: {keyframes} keyframes, {landmarks} landmarks>",
            self.view.version()
        )
    }
}
