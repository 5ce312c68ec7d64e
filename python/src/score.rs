//! Error of an estimate relative to ground truth.

use crate::arguments::{number, value, words, yes};
use crate::arrays;
use crate::guard::detached;
use crate::trajectory::Trajectory;
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use stillpoint::evaluation::{Delta, EvalOptions, Evaluation, Score as Found, Statistics, score};

/// Scores an estimate as ``stillpoint eval`` does (Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012).
///
/// Args:
///     truth, estimate: a Trajectory, a file in the TUM format, or (stamps, poses).
///     with_scale: whether to align the scale too, by Sim(3) instead of SE(3).
///     max_dt: maximum time difference of associated poses, s.
///     delta: interval of the relative error: seconds (``1s``) or frames (``30f``).
///
/// Raises:
///     ValueError: no overlap in time, or too few poses.
///
/// >>> room = simulate("xyz", frames=30)
/// >>> evaluate(room.truth, room.truth).ate_rmse < 1e-9
/// True
#[pyfunction]
#[pyo3(signature = (truth, estimate, *, with_scale=None, max_dt=None, delta=None))]
pub(crate) fn evaluate(
    py: Python<'_>,
    truth: &Bound<'_, PyAny>,
    estimate: &Bound<'_, PyAny>,
    with_scale: Option<&Bound<'_, PyAny>>,
    max_dt: Option<&Bound<'_, PyAny>>,
    delta: Option<&Bound<'_, PyAny>>,
) -> PyResult<Score> {
    let truth = Trajectory::from_any("truth", truth)?;
    let estimate = Trajectory::from_any("estimate", estimate)?;
    let delta = delta.map_or(Ok("1s".to_owned()), |d| words("delta", d))?;
    let delta: Delta = delta.parse().map_err(|e: String| value("delta", e))?;
    let with_scale = with_scale.map_or(Ok(false), |w| yes("with_scale", w))?;
    let mut options = EvalOptions {
        with_scale,
        delta,
        ..EvalOptions::default()
    };
    if let Some(max_dt) = max_dt {
        options.max_dt = number("max_dt", max_dt, [0.0, 1e6])?;
    }
    let found = detached(py, || score(&truth, &estimate, &options))?;
    let found = found.map_err(|e| PyValueError::new_err(format!("truth, estimate: {e}")))?;
    Ok(Score { found })
}

/// Absolute and relative errors, or the drift if the camera stands still in the ground truth.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Score {
    found: Found,
}

impl Score {
    fn moving(&self) -> Option<&Evaluation> {
        match &self.found {
            Found::Moving(e) => Some(e),
            Found::Fixed(_) => None,
        }
    }
}

fn statistics<'py>(py: Python<'py>, s: &Statistics) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    all.set_item("count", s.count)?;
    all.set_item("rmse", s.rmse)?;
    all.set_item("sd", s.sd)?;
    all.set_item("mean", s.mean)?;
    all.set_item("median", s.median)?;
    all.set_item("max", s.max)?;
    Ok(all)
}

#[pymethods]
impl Score {
    /// RMSE of the absolute trajectory error after alignment, m; of the distances from the first pose if the camera stands still.
    #[getter]
    fn ate_rmse(&self) -> f64 {
        match &self.found {
            Found::Moving(e) => e.ate.statistics.rmse,
            Found::Fixed(d) => d.drift.rmse,
        }
    }

    /// RMSE of the relative translation error over the delta, m; None if the estimate is too short.
    #[getter]
    fn rpe_rmse(&self) -> Option<f64> {
        Some(self.moving()?.rpe.as_ref()?.translation.rmse)
    }

    /// RMSE of the relative rotation error over the delta, degrees; None if the estimate is too short.
    #[getter]
    fn rpe_rotation_deg(&self) -> Option<f64> {
        Some(self.moving()?.rpe.as_ref()?.rotation_deg.rmse)
    }

    /// Number of poses with ground truth.
    #[getter]
    fn pairs(&self) -> usize {
        match &self.found {
            Found::Moving(e) => e.pairs,
            Found::Fixed(d) => d.drift.count,
        }
    }

    /// Whether the camera stands still in the ground truth, so that the drift is scored.
    #[getter]
    fn is_fixed(&self) -> bool {
        self.moving().is_none()
    }

    /// Statistics of the absolute error, m: count, rmse, sd, mean, median, max.
    #[getter]
    fn ate<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        match &self.found {
            Found::Moving(e) => statistics(py, &e.ate.statistics),
            Found::Fixed(d) => statistics(py, &d.drift),
        }
    }

    /// Error of each pair, (N,) float64, m; empty if the camera stands still.
    #[getter]
    fn errors<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let pairs = self.moving().map(|e| e.ate.pairs.as_slice());
        arrays::row(
            py,
            pairs.unwrap_or_default().iter().map(|p| p.error).collect(),
        )
    }

    /// Positions of the estimate after alignment, (N, 3) float64, m; empty if the camera stands still.
    #[getter]
    fn aligned<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let pairs = self.moving().map(|e| e.ate.pairs.as_slice());
        let at = |p: &stillpoint::evaluation::PairError| p.estimate.into();
        arrays::table::<f64, 3>(py, pairs.unwrap_or_default().iter().map(at))
    }

    /// Positions of the ground truth, (N, 3) float64, m; empty if the camera stands still.
    #[getter]
    fn reference<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let pairs = self.moving().map(|e| e.ate.pairs.as_slice());
        let at = |p: &stillpoint::evaluation::PairError| p.reference.into();
        arrays::table::<f64, 3>(py, pairs.unwrap_or_default().iter().map(at))
    }

    fn __repr__(&self) -> String {
        let mm = 1e3 * self.ate_rmse();
        match &self.found {
            Found::Moving(e) => format!("<Score: ATE RMSE {mm:.2} mm over {} pairs>", e.pairs),
            Found::Fixed(_) => {
                format!("<Score: drift RMSE {mm:.2} mm of a camera that stands still>")
            }
        }
    }

    fn _repr_html_<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let module = this.py().import("stillpoint_slam._html")?;
        module.call_method1("score", (this,))
    }
}
