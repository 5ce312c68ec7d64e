//! The inertial sensor: mount, samples as arrays, and state.

use crate::arguments::{is_bool, matrix, reals, value, wrong_type, yes};
use crate::arrays;
use crate::camera::Camera;
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use stillpoint::geometry::ImuModel;
use stillpoint::imaging::ImuSample;
use stillpoint::slam::{InertialReport, InertialState};

/// Maximum number of samples per call: an hour at 1 kHz.
const MOST: usize = 3_600_000;
const ROW: usize = 7;

/// The sensor model from the argument `imu`, if any.
pub(crate) fn model(
    found: Option<&Bound<'_, PyAny>>,
    camera: &Camera,
) -> PyResult<Option<ImuModel>> {
    const EXPECTED: &str = "True, or how the sensor stands to the camera as a 4x4 matrix of float64, camera_from_imu in metres";
    let Some(found) = found.filter(|f| !f.is_none()) else {
        return Ok(None);
    };
    if is_bool(found) {
        if !yes("imu", found)? {
            return Ok(None);
        }
        let own = camera.model.imu.ok_or_else(|| {
            value(
                "imu",
                "expected a camera of a file with a table [imu], or of a recording with such a sensor, found one without; hand over camera_from_imu",
            )
        });
        return own.map(Some);
    }
    let (shape, m) = reals("imu", EXPECTED, found, 16)?;
    if shape != [4, 4] {
        return Err(wrong_type("imu", EXPECTED, found));
    }
    let pose = matrix(&m);
    let pose = pose.map_err(|what| value("imu", format!("expected {EXPECTED}, found {what}")))?;
    let model = ImuModel::bmi055().mounted(pose);
    model.check().map_err(|e| value("imu", e))?;
    Ok(Some(model))
}

pub(crate) fn samples(found: &Bound<'_, PyAny>) -> PyResult<Vec<ImuSample>> {
    const EXPECTED: &str = "an array of N x 7: stamp (s), angular rate x, y, z (rad/s), specific force x, y, z (m/s^2), in order of time";
    let (shape, numbers) = reals("imu", EXPECTED, found, ROW * MOST)?;
    if numbers.is_empty() {
        return Ok(Vec::new());
    }
    if shape.len() != 2 || shape[1] != ROW {
        return Err(value(
            "imu",
            format!("expected {EXPECTED}, found an array with the shape {shape:?}"),
        ));
    }
    let samples: Vec<ImuSample> = numbers.chunks_exact(ROW).map(sample).collect();
    let is_late = |pair: &[ImuSample]| pair[1].stamp > pair[0].stamp;
    let wrong = samples.iter().position(|s| !s.is_finite());
    let wrong = wrong.or_else(|| Some(1 + samples.windows(2).position(|p| !is_late(p))?));
    match wrong {
        None => Ok(samples),
        Some(row) => Err(value(
            "imu",
            format!(
                "expected {EXPECTED}, and finite, found row {row}: {:?}",
                &numbers[ROW * row..ROW * (row + 1)]
            ),
        )),
    }
}

fn sample(row: &[f64]) -> ImuSample {
    ImuSample {
        stamp: row[0],
        angular_rate: [row[1], row[2], row[3]],
        specific_force: [row[4], row[5], row[6]],
    }
}

/// Samples as rows, (N, 7) float64.
pub(crate) fn rows<'py>(
    py: Python<'py>,
    samples: &[ImuSample],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let row = |s: &ImuSample| {
        let ([p, q, r], [x, y, z]) = (s.angular_rate, s.specific_force);
        [s.stamp, p, q, r, x, y, z]
    };
    arrays::grid(
        py,
        (samples.len(), ROW),
        samples.iter().flat_map(row).collect(),
    )
}

/// The state of the sensor, by name.
pub(crate) fn report<'py>(
    py: Python<'py>,
    report: &InertialReport,
) -> PyResult<Bound<'py, PyDict>> {
    let said = PyDict::new(py);
    let state = match report.state {
        InertialState::Unconfirmed => "unconfirmed",
        InertialState::Confirmed => "confirmed",
        InertialState::Ignored(_) => "ignored",
    };
    said.set_item("state", state)?;
    let reason = match report.state {
        InertialState::Ignored(fault) => Some(fault.to_string()),
        _ => None,
    };
    said.set_item("reason", reason)?;
    said.set_item("gyro_bias", arrays::row(py, report.gyro_bias.to_vec()))?;
    said.set_item("gyro_bias_sigma", report.gyro_bias_sigma)?;
    let q = report.camera_from_imu.coords;
    said.set_item("rotation", arrays::row(py, vec![q.x, q.y, q.z, q.w]))?;
    said.set_item("rotation_sigma", report.mount_sigma)?;
    said.set_item("time_offset", report.time_offset)?;
    said.set_item("time_offset_sigma", report.time_offset_sigma)?;
    said.set_item("up", report.up.map(|up| arrays::row(py, up.to_vec())))?;
    Ok(said)
}
