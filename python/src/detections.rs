//! Detections of the user's detector.

use crate::arguments::{is_bool, number, reals, value, words, wrong_type};
use crate::guard::calling;
use numpy::PyUntypedArray;
use pyo3::exceptions::{PyRuntimeError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyList, PyString, PyTuple};
use stillpoint::detection::{BoundingBox, ClassId, Detection as Seen};

/// Maximum number of detections per frame; more indicate a wrong detector.
const MOST: usize = 10_000;

/// Columns of a row.
const ROW: &str = "x0, y0, x1, y1, score, class";

/// A detected object.
///
/// Args:
///     class_name: name of a class of COCO (``person``), or its number among the 80.
///     score: confidence of the detector, 0 to 1.
///     box: x0, y0, x1, y1 in the raw image, px; the pixel centred at (0, 0) spans -0.5 to 0.5.
///
/// >>> Detection("person", 0.9, (10, 20, 110, 220))
/// Detection('person', 0.9, (10.0, 20.0, 110.0, 220.0))
#[pyclass(frozen, eq, from_py_object, module = "stillpoint_slam")]
#[derive(Clone, PartialEq)]
pub(crate) struct Detection {
    pub(crate) seen: Seen,
}

#[pymethods]
impl Detection {
    #[new]
    #[pyo3(signature = (class_name, score, r#box))]
    fn new(
        class_name: &Bound<'_, PyAny>,
        score: &Bound<'_, PyAny>,
        r#box: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let class = class_of(class_name)?;
        let score = number("score", score, [0.0, 1.0])?;
        let (_, sides) = reals("box", "four numbers x0, y0, x1, y1", r#box, 4)?;
        let [x0, y0, x1, y1] = sides[..] else {
            return Err(value(
                "box",
                format!("expected x0, y0, x1, y1, found {sides:?}"),
            ));
        };
        let bounds = BoundingBox { x0, y0, x1, y1 };
        check(&bounds).map_err(|what| value("box", what))?;
        let score = score as f32;
        Ok(Self {
            seen: Seen {
                class,
                score,
                bounds,
            },
        })
    }

    /// Name of the class.
    #[getter]
    fn class_name(&self) -> &'static str {
        self.seen.class.name()
    }

    /// Number of the class among the 80 of COCO.
    #[getter]
    fn class_id(&self) -> u8 {
        self.seen.class.0
    }

    /// Confidence of the detector, 0 to 1.
    #[getter]
    fn score(&self) -> f32 {
        self.seen.score
    }

    /// x0, y0, x1, y1 in the raw image, px.
    #[getter]
    fn r#box(&self) -> (f64, f64, f64, f64) {
        let b = &self.seen.bounds;
        (b.x0, b.y0, b.x1, b.y1)
    }

    fn __repr__(&self) -> String {
        let (class, score) = (self.seen.class.name(), self.seen.score);
        format!("Detection('{class}', {score:?}, {:?})", self.r#box())
    }
}

fn class_of(found: &Bound<'_, PyAny>) -> PyResult<ClassId> {
    if found.is_instance_of::<PyString>() {
        let name = &words("class_name", found)?;
        return ClassId::from_name(name).ok_or_else(|| {
            let near = ClassId::nearest(name).map(|c| format!("; did you mean {c}?"));
            let near = near.unwrap_or_default();
            value(
                "class_name",
                format!("expected a class of COCO, found \"{name}\"{near}"),
            )
        });
    }
    if is_bool(found) || !found.hasattr("__index__").unwrap_or(false) {
        return Err(wrong_type(
            "class_name",
            "the name or number of a class of COCO",
            found,
        ));
    }
    let number = found
        .call_method0("__index__")
        .and_then(|n| n.extract::<u8>());
    match number {
        Ok(n) if usize::from(n) < ClassId::COUNT => Ok(ClassId(n)),
        _ => Err(value("class_name", "expected a number from 0 to 79")),
    }
}

fn check(b: &BoundingBox) -> Result<(), String> {
    let sides = [b.x0, b.y0, b.x1, b.y1];
    let usable = sides.iter().all(|v| v.is_finite() && v.abs() < 1e6);
    if usable && b.x0 <= b.x1 && b.y0 <= b.y1 {
        return Ok(());
    }
    Err(format!(
        "expected finite sides with x0 <= x1 and y0 <= y1, found {sides:?}"
    ))
}

/// Detections from an array of N x 6 (x0, y0, x1, y1, score, class), or a list of such rows and of [`Detection`]s. Sorted stably by
/// descending score, as the trackers expect.
pub(crate) fn detections(name: &str, found: &Bound<'_, PyAny>) -> PyResult<Vec<Seen>> {
    let mut all = if found.cast::<PyUntypedArray>().is_ok() {
        rows(name, found)?
    } else {
        list(name, found)?
    };
    all.sort_by(|a, b| b.score.total_cmp(&a.score));
    Ok(all)
}

fn list(name: &str, found: &Bound<'_, PyAny>) -> PyResult<Vec<Seen>> {
    if found.cast::<PyList>().is_err() && found.cast::<PyTuple>().is_err() {
        let expected = format!("an array of N x 6 ({ROW}) or a list of Detection");
        return Err(wrong_type(name, &expected, found));
    }
    let count = found.len()?;
    if count > MOST {
        return Err(value(
            name,
            format!("expected at most {MOST} detections, found {count}"),
        ));
    }
    let mut all = Vec::with_capacity(count);
    for (i, item) in found.try_iter()?.enumerate() {
        let item = item?;
        if let Ok(detection) = item.cast::<Detection>() {
            all.push(detection.get().seen);
            continue;
        }
        let place = format!("{name}[{i}]");
        let (_, row) = reals(
            &place,
            &format!("a Detection or six numbers ({ROW})"),
            &item,
            6,
        )?;
        all.push(seen(&row).map_err(|what| value(&place, what))?);
    }
    Ok(all)
}

fn rows(name: &str, found: &Bound<'_, PyAny>) -> PyResult<Vec<Seen>> {
    let expected = format!("an array of N x 6 ({ROW}), N at most {MOST}");
    let (shape, flat) = reals(name, &expected, found, 6 * MOST)?;
    if flat.is_empty() {
        return Ok(Vec::new());
    }
    if shape.len() != 2 || shape[1] != 6 {
        return Err(value(
            name,
            format!("expected {expected}, found the shape {shape:?}"),
        ));
    }
    let row =
        |(i, row): (usize, &[f64])| seen(row).map_err(|what| value(&format!("{name}[{i}]"), what));
    flat.chunks_exact(6).enumerate().map(row).collect()
}

fn seen(row: &[f64]) -> Result<Seen, String> {
    let [x0, y0, x1, y1, score, class] = row[..] else {
        return Err(format!("expected six numbers ({ROW}), found {}", row.len()));
    };
    let bounds = BoundingBox { x0, y0, x1, y1 };
    check(&bounds)?;
    if !(0.0..=1.0).contains(&score) {
        return Err(format!("expected a score from 0 to 1, found {score}"));
    }
    if class.fract() != 0.0 || !(0.0..ClassId::COUNT as f64).contains(&class) {
        return Err(format!(
            "expected the number of a class, 0 to 79, found {class}"
        ));
    }
    let (class, score) = (ClassId(class as u8), score as f32);
    Ok(Seen {
        class,
        score,
        bounds,
    })
}

/// Calls the user's detector on an image.
pub(crate) fn answer(callable: &Bound<'_, PyAny>, image: Bound<'_, PyAny>) -> PyResult<Vec<Seen>> {
    let ends = || PyRuntimeError::new_err("the interpreter ends");
    let said = calling(|| callable.call1((image,))).ok_or_else(ends)??;
    detections("detector", &said).map_err(|e| {
        let py = callable.py();
        let what = format!("what it returned: {}", e.value(py));
        if e.is_instance_of::<PyTypeError>(py) {
            PyTypeError::new_err(what)
        } else {
            value("detector", what)
        }
    })
}
