//! Values as NumPy arrays: moved if made for the call, else read-only views.

use numpy::ndarray::{Array2, Array3, ArrayView2, ArrayView3};
use numpy::{Element, PyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use stillpoint::geometry::Se3;
use stillpoint::imaging::{ColourImage, DepthImage, GrayImage};

fn impossible(e: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(format!(
        "a defect of stillpoint_slam, please report it: {e}"
    ))
}

/// An array of `rows` x `N`.
pub(crate) fn table<T: Element, const N: usize>(
    py: Python<'_>,
    rows: impl IntoIterator<Item = [T; N]>,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    let flat: Vec<T> = rows.into_iter().flatten().collect();
    let shape = (flat.len() / N, N);
    grid(py, shape, flat)
}

/// An array of `shape`, rows first.
pub(crate) fn grid<T: Element>(
    py: Python<'_>,
    shape: (usize, usize),
    data: Vec<T>,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    let array = Array2::from_shape_vec(shape, data).map_err(impossible)?;
    Ok(PyArray2::from_owned_array(py, array))
}

pub(crate) fn row<T: Element>(py: Python<'_>, data: Vec<T>) -> Bound<'_, PyArray1<T>> {
    PyArray1::from_vec(py, data)
}

/// The sixteen numbers of a pose's matrix, row by row.
fn numbers(pose: &Se3) -> impl Iterator<Item = f64> {
    let m = pose.to_matrix();
    (0..16).map(move |i| m[(i / 4, i % 4)])
}

pub(crate) fn pose<'py>(py: Python<'py>, pose: &Se3) -> PyResult<Bound<'py, PyArray2<f64>>> {
    grid(py, (4, 4), numbers(pose).collect())
}

pub(crate) fn poses<'py, 'a>(
    py: Python<'py>,
    poses: impl Iterator<Item = &'a Se3>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let flat: Vec<f64> = poses.flat_map(numbers).collect();
    let array = Array3::from_shape_vec((flat.len() / 16, 4, 4), flat).map_err(impossible)?;
    Ok(PyArray3::from_owned_array(py, array))
}

/// The rotation of a pose as `[x, y, z, w]` with `w >= 0`.
pub(crate) fn quaternion(pose: &Se3) -> [f64; 4] {
    let q = pose.rotation.coords;
    // Adding 0.0 turns -0.0 into 0.0.
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [q.x, q.y, q.z, q.w].map(|v| sign * v + 0.0)
}

/// A read-only view of an image in `owner`, which must never change it.
pub(crate) fn depth<'py>(
    image: &DepthImage,
    owner: Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let shape = (image.height(), image.width());
    let view = ArrayView2::from_shape(shape, image.data()).map_err(impossible)?;
    borrowed(&view, owner)
}

/// As [`depth`].
pub(crate) fn gray<'py>(
    image: &GrayImage,
    owner: Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<u8>>> {
    let shape = (image.height(), image.width());
    let view = ArrayView2::from_shape(shape, image.data()).map_err(impossible)?;
    borrowed(&view, owner)
}

/// As [`depth`].
pub(crate) fn colour<'py>(
    image: &ColourImage,
    owner: Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let shape = (image.height(), image.width(), 3);
    let view = ArrayView3::from_shape(shape, image.data()).map_err(impossible)?;
    borrowed(&view, owner)
}

/// A read-only view of data that `owner` keeps alive.
#[allow(unsafe_code)]
fn borrowed<'py, T: Element, D: numpy::ndarray::Dimension>(
    view: &numpy::ndarray::ArrayView<'_, T, D>,
    owner: Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray<T, D>>> {
    // SAFETY: the callers pass the owner of this immutable, never moved data (behind an `Arc`, in a frozen class); the array keeps it
    // alive, and is read-only before it is returned.
    let array = unsafe { PyArray::borrow_from_array(view, owner) };
    let writable = array.try_readwrite().map_err(impossible)?;
    drop(writable.make_nonwriteable());
    Ok(array)
}

/// Keeps a colour image alive for views of it.
#[pyclass(frozen)]
struct Keeper(std::sync::Arc<ColourImage>);

/// A colour image as a read-only array, without a copy.
pub(crate) fn shared_colour(
    py: Python<'_>,
    image: std::sync::Arc<ColourImage>,
) -> PyResult<Bound<'_, PyAny>> {
    let keeper = Bound::new(py, Keeper(image))?;
    let array = colour(&keeper.get().0, keeper.clone().into_any())?;
    Ok(array.into_any())
}

pub(crate) fn square<'py>(
    py: Python<'py>,
    m: &stillpoint::geometry::Mat6,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    grid(py, (6, 6), (0..36).map(|i| m[(i / 6, i % 6)]).collect())
}
