//! Validation of Python arguments; exceptions name the argument.

use numpy::{
    PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyFloat, PyString};
use std::path::PathBuf;
use stillpoint::geometry::nalgebra::Matrix4;
use stillpoint::geometry::{Mat3, Se3, Vec3};

/// Maximum absolute stamp, s: the year 5138.
const LATEST: f64 = 1e11;

pub(crate) fn value(name: &str, what: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(format!("{name}: {what}"))
}

pub(crate) fn wrong_type(name: &str, expected: &str, found: &Bound<'_, PyAny>) -> PyErr {
    PyTypeError::new_err(format!(
        "{name}: expected {expected}, found {}",
        describe(found)
    ))
}

fn describe(found: &Bound<'_, PyAny>) -> String {
    if found.is_none() {
        return "None".to_owned();
    }
    if let Ok(array) = found.cast::<PyUntypedArray>() {
        return format!(
            "an array of {} with the shape {:?}",
            dtype(array),
            array.shape()
        );
    }
    let name = found.get_type().fully_qualified_name();
    name.map_or_else(|_| "something else".to_owned(), |n| n.to_string())
}

fn dtype(array: &Bound<'_, PyUntypedArray>) -> String {
    array.dtype().to_string()
}

pub(crate) fn stamp(name: &str, found: &Bound<'_, PyAny>) -> PyResult<f64> {
    const EXPECTED: &str = "seconds as a float or nanoseconds as an int";
    let wrong = || wrong_type(name, EXPECTED, found);
    if is_bool(found) || found.cast::<PyUntypedArray>().is_ok() {
        return Err(wrong());
    }
    let seconds = if found.is_instance_of::<PyFloat>() || is_numpy_float(found)? {
        found.extract::<f64>().map_err(|_| wrong())?
    } else if found.hasattr("__index__").unwrap_or(false) {
        let number = found.call_method0("__index__").map_err(|_| wrong())?;
        let ns: i64 = number
            .extract()
            .map_err(|_| value(name, "expected nanoseconds within 64 bits, found more"))?;
        // All nanoseconds since 1970 as one double would be off by about a hundred.
        ns.div_euclid(1_000_000_000) as f64 + ns.rem_euclid(1_000_000_000) as f64 / 1e9
    } else {
        return Err(wrong());
    };
    if seconds.is_finite() && seconds.abs() <= LATEST {
        return Ok(seconds);
    }
    Err(value(
        name,
        format!("expected a time of at most {LATEST:e} s, found {seconds}"),
    ))
}

/// Most of NumPy's float types are not subclasses of Python's.
fn is_numpy_float(found: &Bound<'_, PyAny>) -> PyResult<bool> {
    let floating = found.py().import("numpy")?.getattr("floating")?;
    found.is_instance(&floating)
}

/// Python's and NumPy's truth values also convert to integers.
pub(crate) fn is_bool(found: &Bound<'_, PyAny>) -> bool {
    let numpy = || found.py().import("numpy")?.getattr("bool_");
    found.is_instance_of::<PyBool>()
        || numpy().is_ok_and(|truth| found.is_instance(&truth).unwrap_or(false))
}

pub(crate) fn number(name: &str, found: &Bound<'_, PyAny>, range: [f64; 2]) -> PyResult<f64> {
    let wrong = || wrong_type(name, "a number", found);
    if is_bool(found) {
        return Err(wrong());
    }
    let number: f64 = found.extract().map_err(|_| wrong())?;
    let [low, high] = range;
    if (low..=high).contains(&number) {
        return Ok(number);
    }
    Err(value(
        name,
        format!("expected a number from {low} to {high}, found {number}"),
    ))
}

pub(crate) fn words(name: &str, found: &Bound<'_, PyAny>) -> PyResult<String> {
    let text = found
        .cast::<PyString>()
        .map_err(|_| wrong_type(name, "a text", found))?;
    let text = text.to_str();
    let unreadable = |_| value(name, "expected a text, found one that is not Unicode");
    text.map(ToOwned::to_owned).map_err(unreadable)
}

/// A `str` or path-like object.
pub(crate) fn path(name: &str, found: &Bound<'_, PyAny>) -> PyResult<PathBuf> {
    let unusable = |_| wrong_type(name, "a path", found);
    let path: PathBuf = found.extract().map_err(unusable)?;
    if path.as_os_str().is_empty() || path.as_os_str().as_encoded_bytes().contains(&0) {
        return Err(value(name, format!("expected a path, found {path:?}")));
    }
    Ok(path)
}

pub(crate) fn yes(name: &str, found: &Bound<'_, PyAny>) -> PyResult<bool> {
    let found_bool = found.cast::<PyBool>();
    Ok(found_bool
        .map_err(|_| wrong_type(name, "True or False", found))?
        .is_true())
}

/// A whole number of at most `most`.
pub(crate) fn count(name: &str, found: &Bound<'_, PyAny>, most: u64) -> PyResult<u64> {
    let wrong = || wrong_type(name, "a whole number", found);
    if is_bool(found) || found.cast::<PyUntypedArray>().is_ok() {
        return Err(wrong());
    }
    if !found.hasattr("__index__").unwrap_or(false) {
        return Err(wrong());
    }
    let index = found.call_method0("__index__").map_err(|_| wrong())?;
    let number = index.extract::<u64>().ok().filter(|n| *n <= most);
    number.ok_or_else(|| {
        value(
            name,
            format!("expected a whole number from 0 to {most}, found another"),
        )
    })
}

/// Copies the elements into `into`, row by row, with any strides. The caller has checked the shape.
pub(crate) fn elements<T: numpy::Element + Copy>(
    name: &str,
    array: &Bound<'_, PyArrayDyn<T>>,
    mut into: Vec<T>,
) -> PyResult<Vec<T>> {
    let unusual = |e: &dyn std::fmt::Display| {
        value(
            name,
            format!("expected an array that can be read, found: {e}"),
        )
    };
    let plain = if array.is_c_contiguous() && is_aligned(array)? {
        array.clone()
    } else {
        // NumPy handles unusual strides.
        let numpy = array.py().import("numpy")?;
        let copy = numpy.call_method1("require", (array, array.py().None(), ["C", "A"]))?;
        let copy = copy.cast_into::<PyArrayDyn<T>>();
        copy.map_err(|_| unusual(&"another kind"))?
    };
    let read = plain.try_readonly().map_err(|e| unusual(&e))?;
    into.clear();
    into.extend_from_slice(read.as_slice().map_err(|e| unusual(&e))?);
    Ok(into)
}

fn is_aligned<T: numpy::Element>(array: &Bound<'_, PyArrayDyn<T>>) -> PyResult<bool> {
    array.getattr("flags")?.getattr("aligned")?.extract()
}

/// Whether the bytes of an array are in native order.
fn is_native(array: &Bound<'_, PyUntypedArray>) -> bool {
    array.dtype().is_native_byteorder().unwrap_or(true)
}

/// A colour or grey image, row by row.
pub(crate) enum Pixels {
    Gray(Vec<u8>),
    /// Interleaved, in the order stated by the user.
    Colour(Vec<u8>),
}

/// A colour image (height x width x 3) or a grey one (height x width); `size` is width first. Reuses `spare` for colours.
pub(crate) fn colour(
    found: &Bound<'_, PyAny>,
    size: [usize; 2],
    spare: Vec<u8>,
) -> PyResult<Pixels> {
    let [w, h] = size;
    let expected = format!(
        "a numpy array of uint8 with the shape ({h}, {w}, 3) or, where it is grey, ({h}, {w})"
    );
    let wrong = || wrong_type("color", &expected, found);
    let array = found.cast::<PyUntypedArray>().map_err(|_| wrong())?;
    let bytes = found.cast::<PyArrayDyn<u8>>().map_err(|_| wrong())?;
    let shape = array.shape();
    if shape == [h, w] {
        return Ok(Pixels::Gray(elements("color", bytes, Vec::new())?));
    }
    if shape == [h, w, 3] {
        return Ok(Pixels::Colour(elements("color", bytes, spare)?));
    }
    Err(value(
        "color",
        format!("expected {expected}, found {}", describe(found)),
    ))
}

/// A depth image, row by row.
pub(crate) enum Depths {
    /// In the camera's unit.
    Raw(Vec<u16>),
    Metres(Vec<f32>),
}

/// A depth image (height x width); `size` is width first. Reuses `spare` for raw values.
pub(crate) fn depth(
    found: &Bound<'_, PyAny>,
    size: [usize; 2],
    spare: Vec<u16>,
) -> PyResult<Depths> {
    let [w, h] = size;
    let expected = format!(
        "a numpy array of uint16 or, in metres, float32 or float64, with the shape ({h}, {w})"
    );
    let array = found
        .cast::<PyUntypedArray>()
        .map_err(|_| wrong_type("depth", &expected, found))?;
    if !is_native(array) {
        return Err(wrong_type(
            "depth",
            &format!("{expected}, in this machine's byte order"),
            found,
        ));
    }
    let shaped = || {
        if array.shape() == [h, w] {
            return Ok(());
        }
        Err(value(
            "depth",
            format!("expected {expected}, found {}", describe(found)),
        ))
    };
    if let Ok(raw) = found.cast::<PyArrayDyn<u16>>() {
        shaped()?;
        return Ok(Depths::Raw(elements("depth", raw, spare)?));
    }
    if let Ok(metres) = found.cast::<PyArrayDyn<f32>>() {
        shaped()?;
        return Ok(Depths::Metres(elements("depth", metres, Vec::new())?));
    }
    if let Ok(metres) = found.cast::<PyArrayDyn<f64>>() {
        shaped()?;
        let metres = elements("depth", metres, Vec::new())?;
        return Ok(Depths::Metres(
            metres.into_iter().map(|z| z as f32).collect(),
        ));
    }
    Err(wrong_type("depth", &expected, found))
}

/// Any value convertible to an array of float64 with at most `most` elements.
pub(crate) fn reals(
    name: &str,
    expected: &str,
    found: &Bound<'_, PyAny>,
    most: usize,
) -> PyResult<(Vec<usize>, Vec<f64>)> {
    let py = found.py();
    let wrong = || wrong_type(name, expected, found);
    if found.is_none() {
        return Err(wrong());
    }
    let numpy = py.import("numpy")?;
    let array = match found.cast::<PyUntypedArray>() {
        Ok(array) => array.clone().into_any(),
        Err(_) => numpy
            .call_method1("asarray", (found,))
            .map_err(|_| wrong())?,
    };
    let array = array.cast_into::<PyUntypedArray>().map_err(|_| wrong())?;
    if !matches!(array.dtype().kind(), b'f' | b'i' | b'u') && array.len() > 0 {
        return Err(wrong());
    }
    if array.len() > most {
        return Err(value(
            name,
            format!("expected {expected}, found {}", describe(array.as_any())),
        ));
    }
    let array = numpy
        .call_method1("asarray", (&array, "float64"))
        .map_err(|_| wrong())?;
    let array = array.cast_into::<PyArrayDyn<f64>>().map_err(|_| wrong())?;
    Ok((array.shape().to_vec(), elements(name, &array, Vec::new())?))
}

/// A pose as a 4x4 matrix; its rotation is accepted within 1e-3.
pub(crate) fn pose(name: &str, found: &Bound<'_, PyAny>) -> PyResult<Se3> {
    const EXPECTED: &str = "a pose as a 4x4 matrix of float64, world_from_camera in metres";
    let (shape, m) = reals(name, EXPECTED, found, 16)?;
    if shape != [4, 4] {
        return Err(wrong_type(name, EXPECTED, found).into_value_error(found.py()));
    }
    matrix(&m).map_err(|what| value(name, format!("expected {EXPECTED}, found {what}")))
}

trait IntoValueError {
    fn into_value_error(self, py: Python<'_>) -> PyErr;
}

impl IntoValueError for PyErr {
    fn into_value_error(self, py: Python<'_>) -> PyErr {
        PyValueError::new_err(self.value(py).to_string())
    }
}

/// A rigid motion from the sixteen numbers of its matrix, row by row.
pub(crate) fn matrix(m: &[f64]) -> Result<Se3, &'static str> {
    if m.len() != 16 || !m.iter().all(|v| v.is_finite()) {
        return Err("numbers that are not finite");
    }
    let m = Matrix4::from_row_slice(m);
    let rotation: Mat3 = m.fixed_view::<3, 3>(0, 0).into_owned();
    let off = (rotation * rotation.transpose() - Mat3::identity()).norm();
    if off > 1e-3 || rotation.determinant() < 0.0 {
        return Err("a matrix whose upper left 3x3 is no rotation");
    }
    let bottom = m.row(3);
    if (bottom[0], bottom[1], bottom[2], bottom[3]) != (0.0, 0.0, 0.0, 1.0) {
        return Err("a matrix whose last row is not 0 0 0 1");
    }
    Ok(Se3::from_matrix(
        &rotation,
        Vec3::new(m[(0, 3)], m[(1, 3)], m[(2, 3)]),
    ))
}
