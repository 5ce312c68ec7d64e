//! Poses over time.

use crate::arguments::{self, matrix, reals, value, wrong_type};
use crate::arrays;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::exceptions::{PyFileNotFoundError, PyOSError};
use pyo3::prelude::*;
use pyo3::types::{PyTuple, PyType};
use std::path::PathBuf;
use stillpoint::datasets::{StampedPose, trajectory};
use stillpoint::evaluation::TimedPose;
use stillpoint::slam::TrajectoryEntry;

/// Maximum number of poses: an hour at a thousand a second.
const MOST: usize = 4_000_000;

/// N poses world_from_camera over time. Immutable.
///
/// Args:
///     stamps: (N,) s, ascending.
///     poses: (N, 4, 4), m.
///
/// >>> import numpy as np
/// >>> path = Trajectory([0.0, 0.1], [np.eye(4), np.eye(4)])
/// >>> len(path), path.poses.shape
/// (2, (2, 4, 4))
/// >>> print(path.to_tum().splitlines()[1])
/// 0.000000 0.000000000 0.000000000 0.000000000 0.000000000 0.000000000 0.000000000 1.000000000
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Trajectory {
    pub(crate) poses: Vec<StampedPose>,
    /// Frame numbers and inliers; empty if unknown.
    frames: Vec<(u32, u32)>,
}

impl Trajectory {
    pub(crate) fn of(poses: Vec<StampedPose>) -> Self {
        Self {
            poses,
            frames: Vec::new(),
        }
    }

    pub(crate) fn of_entries(entries: Vec<(TrajectoryEntry, StampedPose)>) -> Self {
        Self {
            frames: entries
                .iter()
                .map(|(e, _)| (e.frame.0, e.inliers))
                .collect(),
            poses: entries.into_iter().map(|(_, pose)| pose).collect(),
        }
    }

    /// For the evaluation.
    pub(crate) fn timed(&self) -> Vec<TimedPose> {
        let one = |p: &StampedPose| TimedPose {
            stamp: p.stamp,
            world_from_camera: p.world_from_camera,
        };
        self.poses.iter().map(one).collect()
    }

    /// Accepts a [`Trajectory`], a file, or stamps and poses.
    pub(crate) fn from_any(name: &str, found: &Bound<'_, PyAny>) -> PyResult<Vec<TimedPose>> {
        if let Ok(path) = found.cast::<Self>() {
            return Ok(path.get().timed());
        }
        if let Ok(pair) = found.cast::<PyTuple>()
            && pair.len() == 2
        {
            let (stamps, poses) = (pair.get_item(0)?, pair.get_item(1)?);
            return Ok(Self::parse(name, name, &stamps, &poses)?.timed());
        }
        if found.extract::<PathBuf>().is_err() {
            return Err(wrong_type(
                name,
                "a Trajectory, a file in the TUM format, or (stamps, poses)",
                found,
            ));
        }
        Ok(Self::read(name, &arguments::path(name, found)?)?.timed())
    }

    fn read(name: &str, path: &std::path::Path) -> PyResult<Self> {
        if !path.exists() {
            return Err(PyFileNotFoundError::new_err(format!(
                "{name}: {}: expected a trajectory, found no such file",
                path.display()
            )));
        }
        let poses = trajectory::read(path).map_err(|e| value(name, e))?;
        Ok(Self::of(poses))
    }

    fn parse(
        stamps_name: &str,
        poses_name: &str,
        stamps: &Bound<'_, PyAny>,
        poses: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let (shape, stamps) = reals(stamps_name, "stamps in seconds, (N,)", stamps, MOST)?;
        if shape.len() != 1 || stamps.iter().any(|s| !s.is_finite()) {
            return Err(value(
                stamps_name,
                format!("expected finite stamps in seconds, (N,), found the shape {shape:?}"),
            ));
        }
        if let Some(i) = stamps.windows(2).position(|w| w[0] >= w[1]) {
            return Err(value(
                stamps_name,
                format!(
                    "expected ascending stamps, found {} after {}",
                    stamps[i + 1],
                    stamps[i]
                ),
            ));
        }
        let (shape, flat) = reals(
            poses_name,
            "poses world_from_camera, (N, 4, 4)",
            poses,
            16 * MOST,
        )?;
        if shape != [stamps.len(), 4, 4] && !(stamps.is_empty() && flat.is_empty()) {
            return Err(value(
                poses_name,
                format!(
                    "expected poses world_from_camera, ({}, 4, 4), found the shape {shape:?}",
                    stamps.len()
                ),
            ));
        }
        let one = |(i, (stamp, m)): (usize, (&f64, &[f64]))| {
            let pose = matrix(m).map_err(|what| {
                value(
                    &format!("{poses_name}[{i}]"),
                    format!("expected a pose, found {what}"),
                )
            })?;
            Ok(StampedPose {
                stamp: *stamp,
                world_from_camera: pose,
            })
        };
        let all = stamps
            .iter()
            .zip(flat.chunks_exact(16))
            .enumerate()
            .map(one);
        Ok(Self::of(all.collect::<PyResult<_>>()?))
    }
}

#[pymethods]
impl Trajectory {
    #[new]
    fn new(stamps: &Bound<'_, PyAny>, poses: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::parse("stamps", "poses", stamps, poses)
    }

    /// Reads a file in the TUM format: ``timestamp tx ty tz qx qy qz qw``.
    ///
    /// Raises:
    ///     FileNotFoundError: the file does not exist.
    ///     ValueError: invalid line; the message names it.
    #[classmethod]
    fn from_file(_cls: &Bound<'_, PyType>, path: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::read("path", &arguments::path("path", path)?)
    }

    /// The text of a file in the TUM format, as the command line writes it.
    fn to_tum(&self) -> String {
        trajectory::format(&self.poses)
    }

    /// Writes a file in the TUM format, atomically.
    fn save(&self, path: &Bound<'_, PyAny>) -> PyResult<()> {
        let path = arguments::path("path", path)?;
        trajectory::write(&path, &self.poses).map_err(|e| PyOSError::new_err(format!("path: {e}")))
    }

    fn __len__(&self) -> usize {
        self.poses.len()
    }

    /// Stamps, (N,) float64, s.
    #[getter]
    fn stamps<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        arrays::row(py, self.poses.iter().map(|p| p.stamp).collect())
    }

    /// Poses world_from_camera, (N, 4, 4) float64, m.
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        arrays::poses(py, self.poses.iter().map(|p| &p.world_from_camera))
    }

    /// Positions, (N, 3) float64, m.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let at = |p: &StampedPose| p.world_from_camera.translation.into();
        arrays::table::<f64, 3>(py, self.poses.iter().map(at))
    }

    /// Rotations as x, y, z, w with w >= 0, (N, 4) float64.
    #[getter]
    fn quaternions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let turn = |p: &StampedPose| arrays::quaternion(&p.world_from_camera);
        arrays::table(py, self.poses.iter().map(turn))
    }

    /// Frame numbers, (N,) uint32; empty if unknown.
    #[getter]
    fn frames<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        arrays::row(py, self.frames.iter().map(|f| f.0).collect())
    }

    /// Inlier landmark matches of each pose, (N,) uint32; empty if unknown.
    #[getter]
    fn inliers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        arrays::row(py, self.frames.iter().map(|f| f.1).collect())
    }

    /// Length of the path, m.
    #[getter]
    fn length(&self) -> f64 {
        let at = |p: &StampedPose| p.world_from_camera.translation;
        self.poses
            .windows(2)
            .map(|w| (at(&w[1]) - at(&w[0])).norm())
            .sum()
    }

    /// Plots the path from above by matplotlib, optionally with the ground truth, and returns the axes.
    #[pyo3(signature = (truth=None, ax=None))]
    fn plot<'py>(
        this: &Bound<'py, Self>,
        truth: Option<&Bound<'py, PyAny>>,
        ax: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let module = this.py().import("stillpoint_slam._plot")?;
        module.call_method1("trajectory", (this, truth, ax))
    }

    fn _repr_html_<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let module = this.py().import("stillpoint_slam._html")?;
        module.call_method1("trajectory", (this,))
    }

    fn __repr__(&self) -> String {
        format!(
            "<Trajectory: {} poses, {:.3} m>",
            self.poses.len(),
            self.length()
        )
    }
}
