//! Wheel odometry, and priors of the camera's pose: mount, samples as arrays, and state.

use crate::arguments::{is_bool, matrix, number, reals, value, wrong_type, yes};
use crate::arrays;
use crate::camera::Camera;
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use stillpoint::geometry::{OdometryModel, Se3};
use stillpoint::imaging::OdometrySample;
use stillpoint::slam::{OdometryReport, OdometryState};

/// Maximum number of samples per call: an hour at 1 kHz.
const MOST: usize = 3_600_000;
/// Numbers of a sample, with and without standard deviations.
const ROW: usize = 10;
const SHORT_ROW: usize = 8;
/// Keys of a dict, with ranges; the first is a matrix.
const FIGURES: [(&str, [f64; 2]); 5] = [
    (MOUNT, [0.0; 2]),
    ("time_offset", [-1.0, 1.0]),
    ("slip_per_metre", [1e-6, 1.0]),
    ("slip_per_radian", [1e-6, 1.0]),
    ("turn_per_metre", [1e-6, 1.0]),
];
const MOUNT: &str = "base_from_camera";

/// The odometry model from the argument `odometry`, if any.
pub(crate) fn model(
    found: Option<&Bound<'_, PyAny>>,
    camera: &Camera,
) -> PyResult<Option<OdometryModel>> {
    const EXPECTED: &str = "True, or how the camera stands on the base as a 4x4 matrix of float64, base_from_camera in metres, or a dict with that as base_from_camera, time_offset, slip_per_metre, slip_per_radian, turn_per_metre";
    let Some(found) = found.filter(|f| !f.is_none()) else {
        return Ok(None);
    };
    if is_bool(found) {
        if !yes("odometry", found)? {
            return Ok(None);
        }
        let own = camera.model.odometry.ok_or_else(|| {
            value(
                "odometry",
                "expected a camera of a file with a table [odometry], or of a recording with odometry, found one without; hand over base_from_camera",
            )
        });
        return own.map(Some);
    }
    let dict = found.cast::<PyDict>().ok();
    let mount = match dict {
        Some(dict) => dict.get_item(MOUNT)?.ok_or_else(|| {
            value(
                "odometry",
                format!("expected {EXPECTED}, found no base_from_camera"),
            )
        })?,
        None => found.clone(),
    };
    let (shape, m) = reals("odometry", EXPECTED, &mount, 16)?;
    if shape != [4, 4] {
        return Err(wrong_type("odometry", EXPECTED, &mount));
    }
    let pose = matrix(&m);
    let pose =
        pose.map_err(|what| value("odometry", format!("expected {EXPECTED}, found {what}")))?;
    let model = OdometryModel::mounted(pose);
    let model = dict.map_or(Ok(model), |d| stated("odometry", d, model, &FIGURES))?;
    model.check().map_err(|e| value("odometry", e))?;
    Ok(Some(model))
}

/// The model of pose priors from the argument `prior`, if any.
pub(crate) fn prior(found: Option<&Bound<'_, PyAny>>) -> PyResult<Option<OdometryModel>> {
    let Some(found) = found.filter(|f| !f.is_none()) else {
        return Ok(None);
    };
    let model = OdometryModel::mounted(Se3::identity());
    match found.cast::<PyDict>() {
        // Each pose has the stamp of its frame.
        Ok(dict) => stated("prior", dict, model, &FIGURES[2..]).map(Some),
        Err(_) if is_bool(found) => Ok(yes("prior", found)?.then_some(model)),
        Err(_) => Err(wrong_type(
            "prior",
            "True, or a dict with slip_per_metre, slip_per_radian, turn_per_metre",
            found,
        )),
    }
}

/// A model with the values of a dict, limited to `known` keys.
fn stated(
    name: &str,
    dict: &Bound<'_, PyDict>,
    mut model: OdometryModel,
    known: &[(&str, [f64; 2])],
) -> PyResult<OdometryModel> {
    for (key, found) in dict.iter() {
        let key: String = key.extract().unwrap_or_default();
        let Some((_, range)) = known.iter().find(|(figure, _)| *figure == key) else {
            let names: Vec<&str> = known.iter().map(|(figure, _)| *figure).collect();
            let what = format!("expected keys of {}, found {key:?}", names.join(", "));
            return Err(value(name, what));
        };
        if key == MOUNT {
            continue;
        }
        let figure = number(&format!("{name}: {key}"), &found, *range)?;
        match key.as_str() {
            "time_offset" => model.time_offset = figure,
            "slip_per_metre" => model.slip_per_metre = figure,
            "slip_per_radian" => model.slip_per_radian = figure,
            _ => model.turn_per_metre = figure,
        }
    }
    Ok(model)
}

pub(crate) fn samples(found: &Bound<'_, PyAny>) -> PyResult<Vec<OdometrySample>> {
    const EXPECTED: &str = "an array of N x 8: stamp (s), place x, y, z (m), orientation x, y, z, w of length 1; or N x 10, with standard deviations of place (m) and direction (rad), both NaN where they are not known; in order of time";
    let (shape, numbers) = reals("odometry", EXPECTED, found, ROW * MOST)?;
    if numbers.is_empty() {
        return Ok(Vec::new());
    }
    let width = match shape.as_slice() {
        [_, width @ (SHORT_ROW | ROW)] => *width,
        _ => {
            return Err(value(
                "odometry",
                format!("expected {EXPECTED}, found an array with the shape {shape:?}"),
            ));
        }
    };
    let samples: Vec<OdometrySample> = numbers.chunks_exact(width).map(sample).collect();
    let is_good =
        |s: &OdometrySample| s.is_pose() && s.sigmas.is_none_or(|s| s.iter().all(|v| *v >= 0.0));
    let is_late = |pair: &[OdometrySample]| pair[1].stamp > pair[0].stamp;
    let wrong = samples.iter().position(|s| !is_good(s));
    let wrong = wrong.or_else(|| Some(1 + samples.windows(2).position(|p| !is_late(p))?));
    match wrong {
        None => Ok(samples),
        Some(row) => Err(value(
            "odometry",
            format!(
                "expected {EXPECTED}, found row {row}: {:?}",
                &numbers[width * row..width * (row + 1)]
            ),
        )),
    }
}

fn sample(row: &[f64]) -> OdometrySample {
    let sigmas = match row.get(SHORT_ROW..) {
        Some([place, turn]) if !(place.is_nan() && turn.is_nan()) => Some([*place, *turn]),
        _ => None,
    };
    OdometrySample {
        stamp: row[0],
        position: [row[1], row[2], row[3]],
        orientation: [row[4], row[5], row[6], row[7]],
        sigmas,
    }
}

/// Samples as rows, (N, 10) float64.
pub(crate) fn rows<'py>(
    py: Python<'py>,
    samples: &[OdometrySample],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let row = |s: &OdometrySample| {
        let ([x, y, z], [i, j, k, w]) = (s.position, s.orientation);
        let [place, turn] = s.sigmas.unwrap_or([f64::NAN; 2]);
        [s.stamp, x, y, z, i, j, k, w, place, turn]
    };
    arrays::grid(
        py,
        (samples.len(), ROW),
        samples.iter().flat_map(row).collect(),
    )
}

/// A prior of the camera's pose, with variances of its motion since the previous one: position, m^2, and orientation, rad^2.
pub(crate) struct Known {
    pose: Se3,
    variances: Option<[f64; 2]>,
}

impl Known {
    /// From a pose, or a pair of a pose and the covariance of its motion.
    pub(crate) fn of(found: &Bound<'_, PyAny>) -> PyResult<Self> {
        const EXPECTED: &str = "the pose of the camera as a 4x4 matrix of float64, in metres, or a pair of that and the covariance of its motion since the prior before, (6, 6), [translation; rotation] in m and rad";
        let pair = found.cast::<PyTuple>().ok().filter(|pair| pair.len() == 2);
        let (pose, covariance) = match pair {
            Some(pair) => (pair.get_item(0)?, Some(pair.get_item(1)?)),
            None => (found.clone(), None),
        };
        let (shape, m) = reals("prior", EXPECTED, &pose, 16)?;
        if shape != [4, 4] {
            return Err(value(
                "prior",
                format!("expected {EXPECTED}, found an array with the shape {shape:?}"),
            ));
        }
        let pose = matrix(&m);
        let pose =
            pose.map_err(|what| value("prior", format!("expected {EXPECTED}, found {what}")))?;
        let Some(covariance) = covariance.filter(|c| !c.is_none()) else {
            return Ok(Self {
                pose,
                variances: None,
            });
        };
        let (shape, c) = reals("prior", EXPECTED, &covariance, 36)?;
        if shape != [6, 6] {
            return Err(value(
                "prior",
                format!("expected {EXPECTED}, found a covariance with the shape {shape:?}"),
            ));
        }
        let diagonal = [0, 1, 2, 3, 4, 5].map(|k| c[7 * k]);
        if let Some(bad) = diagonal.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
            return Err(value(
                "prior",
                format!("expected {EXPECTED}, found a variance of {bad}"),
            ));
        }
        let largest = |part: &[f64]| part.iter().copied().fold(0.0, f64::max);
        let variances = Some([largest(&diagonal[..3]), largest(&diagonal[3..])]);
        Ok(Self { pose, variances })
    }

    /// The pose with cumulative deviations; `sum` are the variances summed over all motions.
    pub(crate) fn sample(&self, stamp: f64, sum: &mut [f64; 2]) -> OdometrySample {
        for (sum, variance) in sum.iter_mut().zip(self.variances.unwrap_or_default()) {
            *sum += variance;
        }
        let (t, q) = (self.pose.translation, self.pose.rotation);
        OdometrySample {
            stamp,
            position: t.into(),
            orientation: [q.i, q.j, q.k, q.w],
            sigmas: Some(sum.map(f64::sqrt)),
        }
    }
}

/// The state of the odometry, by name.
pub(crate) fn report<'py>(
    py: Python<'py>,
    report: &OdometryReport,
) -> PyResult<Bound<'py, PyDict>> {
    let said = PyDict::new(py);
    let (state, reason) = match report.state {
        OdometryState::Unconfirmed => ("unconfirmed", None),
        OdometryState::Confirmed => ("confirmed", None),
        OdometryState::Ignored(fault) => ("ignored", Some(fault.to_string())),
    };
    said.set_item("state", state)?;
    said.set_item("reason", reason)?;
    said.set_item("samples", report.samples)?;
    said.set_item("slips", report.slips)?;
    Ok(said)
}
