//! Camera: lens, size, and scale of depth values.

use crate::arguments::{self, is_bool, number, reals, value, words, wrong_type};
use crate::arrays;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyString, PyType};
use stillpoint::datasets::{CameraChoice, CameraModel};
use stillpoint::geometry::{BrownConrady, Camera as Lens};

/// A pinhole camera with OpenCV's lens distortion (k1, k2, p1, p2, k3). Pixel centres are at integers.
///
/// Args:
///     width, height: size of the images, px.
///     fx, fy, cx, cy: focal lengths and principal point, px.
///     distortion: k1, k2, p1, p2, k3, or the first of them; None for no distortion.
///     depth_scale: values of a uint16 depth image per metre: 1000 for millimetres, 5000 for TUM.
///     name: a name for messages; None for ``camera``.
///
/// >>> Camera(640, 480, 525.0, 525.0, 319.5, 239.5)
/// Camera(640, 480, 525.0, 525.0, 319.5, 239.5, depth_scale=1000.0)
/// >>> Camera.preset("tum_fr1").depth_scale
/// 5000.0
#[pyclass(frozen, eq, from_py_object, module = "stillpoint_slam")]
#[derive(Clone, PartialEq)]
pub(crate) struct Camera {
    pub(crate) model: CameraModel,
}

impl Camera {
    pub(crate) fn of(model: &CameraModel) -> Self {
        let model = model.clone();
        Self { model }
    }

    pub(crate) fn size(&self) -> [usize; 2] {
        [self.model.camera.width, self.model.camera.height].map(|n| n as usize)
    }

    /// Accepts a [`Camera`], a preset, a camera file, or a calibration object of another library.
    pub(crate) fn from_any(found: &Bound<'_, PyAny>) -> PyResult<Self> {
        if let Ok(camera) = found.cast::<Self>() {
            return Ok(camera.get().clone());
        }
        if found.is_none() {
            return Err(wrong_type(
                "camera",
                "a Camera, the name of a preset, a camera file or a CameraInfo",
                found,
            ));
        }
        if found.is_instance_of::<PyString>() || found.hasattr("__fspath__").unwrap_or(false) {
            let path = arguments::path("camera", found)?;
            return Self::choose(&path.to_string_lossy());
        }
        let info = found.py().import("stillpoint_slam._camera")?;
        let camera = info.call_method1("from_info", (found,))?;
        Ok(camera.cast::<Self>()?.get().clone())
    }

    /// A preset or a file.
    fn choose(text: &str) -> PyResult<Self> {
        let model = CameraModel::choose(&CameraChoice::from_argument(text));
        let model = model.map_err(|e| value("camera", e))?;
        Ok(Self { model })
    }
}

/// A valid image width or height, px.
fn side(name: &str, found: &Bound<'_, PyAny>) -> PyResult<u32> {
    let wrong = || wrong_type(name, "a whole number of pixels", found);
    if is_bool(found) || !found.hasattr("__index__").unwrap_or(false) {
        return Err(wrong());
    }
    let index = found.call_method0("__index__").map_err(|_| wrong())?;
    match index.extract::<u32>() {
        Ok(n) if (1..=1 << 16).contains(&n) => Ok(n),
        _ => Err(value(
            name,
            format!("expected 1 to 65536 px, found {index}"),
        )),
    }
}

const ANY: [f64; 2] = [-1e9, 1e9];

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (width, height, fx, fy, cx, cy, *, distortion=None, depth_scale=None, name=None))]
    #[allow(clippy::too_many_arguments)] // Named in Python.
    fn new(
        width: &Bound<'_, PyAny>,
        height: &Bound<'_, PyAny>,
        fx: &Bound<'_, PyAny>,
        fy: &Bound<'_, PyAny>,
        cx: &Bound<'_, PyAny>,
        cy: &Bound<'_, PyAny>,
        distortion: Option<&Bound<'_, PyAny>>,
        depth_scale: Option<&Bound<'_, PyAny>>,
        name: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let name = name.map(|n| words("name", n)).transpose()?;
        let size = [side("width", width)?, side("height", height)?];
        let lens = [
            number("fx", fx, [1e-3, 1e9])?,
            number("fy", fy, [1e-3, 1e9])?,
            number("cx", cx, ANY)?,
            number("cy", cy, ANY)?,
        ];
        let mut k = [0.0; 5];
        if let Some(found) = distortion {
            const EXPECTED: &str = "up to five coefficients k1, k2, p1, p2, k3";
            let (shape, given) = reals("distortion", EXPECTED, found, 5)?;
            if shape.len() != 1 || given.iter().any(|v| !v.is_finite()) {
                return Err(value(
                    "distortion",
                    format!("expected {EXPECTED}, finite, found {given:?}"),
                ));
            }
            k[..given.len()].copy_from_slice(&given);
        }
        let [k1, k2, p1, p2, k3] = k;
        let camera = Lens {
            distortion: BrownConrady { k1, k2, p1, p2, k3 },
            ..Lens::pinhole(size[0], size[1], lens)
        };
        camera.check().map_err(|e| value("camera", e))?;
        let depth_scale = depth_scale.map(|s| number("depth_scale", s, [1e-3, 1e9]));
        Ok(Self {
            model: CameraModel {
                name: name.unwrap_or_else(|| "camera".to_owned()),
                camera,
                depth_scale: depth_scale.transpose()?.unwrap_or(1000.0),
                nominal: false,
                imu: None,
                odometry: None,
            },
        })
    }

    /// A built-in camera, by its name (see :meth:`presets`) or a short one (``fr1``).
    ///
    /// Raises:
    ///     ValueError: unknown preset; the message lists all.
    #[classmethod]
    fn preset(_cls: &Bound<'_, PyType>, name: &Bound<'_, PyAny>) -> PyResult<Self> {
        let model = CameraModel::preset(&words("name", name)?).map_err(|e| value("name", e))?;
        Ok(Self { model })
    }

    /// The names of the presets.
    ///
    /// >>> "realsense_d435" in Camera.presets()
    /// True
    #[staticmethod]
    fn presets() -> Vec<&'static str> {
        CameraModel::preset_names().collect()
    }

    /// Reads a camera file, ``camera.toml`` or ``camera.txt``.
    #[classmethod]
    fn from_file(_cls: &Bound<'_, PyType>, path: &Bound<'_, PyAny>) -> PyResult<Self> {
        let model = CameraModel::from_file(&arguments::path("path", path)?)
            .map_err(|e| value("path", e))?;
        Ok(Self { model })
    }

    /// A camera from its matrix K (3x3), px.
    ///
    /// >>> Camera.from_k([[525, 0, 319.5], [0, 525, 239.5], [0, 0, 1]], 640, 480).fx
    /// 525.0
    #[classmethod]
    #[pyo3(signature = (k, width, height, *, distortion=None, depth_scale=None, name=None))]
    #[allow(clippy::too_many_arguments)] // Named in Python.
    fn from_k<'py>(
        cls: &Bound<'py, PyType>,
        k: &Bound<'py, PyAny>,
        width: &Bound<'py, PyAny>,
        height: &Bound<'py, PyAny>,
        distortion: Option<&Bound<'py, PyAny>>,
        depth_scale: Option<&Bound<'py, PyAny>>,
        name: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        const EXPECTED: &str = "a camera matrix as 3x3 numbers, fx 0 cx / 0 fy cy / 0 0 1";
        let (_, m) = reals("k", EXPECTED, k, 9)?;
        let fixed = [(1, 0.0), (3, 0.0), (6, 0.0), (7, 0.0), (8, 1.0)];
        if m.len() != 9 || fixed.iter().any(|(i, v)| m[*i] != *v) {
            return Err(value("k", format!("expected {EXPECTED}, found {m:?}")));
        }
        let py = cls.py();
        let [fx, cx, fy, cy] = [0, 2, 4, 5].map(|i| pyo3::types::PyFloat::new(py, m[i]).into_any());
        Self::new(
            width,
            height,
            &fx,
            &fy,
            &cx,
            &cy,
            distortion,
            depth_scale,
            name,
        )
    }

    /// A camera from calibration objects of other libraries, such as ROS's CameraInfo and librealsense's intrinsics: a dict or an object
    /// with ``width``, ``height`` and ``K``/``k`` (nine numbers) or ``fx``, ``fy`` and ``cx``/``ppx``, ``cy``/``ppy``, and optionally
    /// ``D``/``d``/``coeffs`` and ``distortion_model``/``model``.
    ///
    /// >>> info = {"width": 640, "height": 480, "K": [525, 0, 319.5, 0, 525, 239.5, 0, 0, 1], "D": []}
    /// >>> Camera.from_info(info).cx
    /// 319.5
    #[classmethod]
    #[pyo3(signature = (info, *, depth_scale=None))]
    fn from_info<'py>(
        cls: &Bound<'py, PyType>,
        info: &Bound<'py, PyAny>,
        depth_scale: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let module = cls.py().import("stillpoint_slam._camera")?;
        module.call_method1("from_info", (info, depth_scale))
    }

    /// The same camera with another number of depth values per metre.
    fn with_depth_scale(&self, depth_scale: &Bound<'_, PyAny>) -> PyResult<Self> {
        let mut model = self.model.clone();
        model.depth_scale = number("depth_scale", depth_scale, [1e-3, 1e9])?;
        Ok(Self { model })
    }

    /// Width of the images, px.
    #[getter]
    fn width(&self) -> u32 {
        self.model.camera.width
    }

    /// Height of the images, px.
    #[getter]
    fn height(&self) -> u32 {
        self.model.camera.height
    }

    /// Focal length along x, px.
    #[getter]
    fn fx(&self) -> f64 {
        self.model.camera.fx
    }

    /// Focal length along y, px.
    #[getter]
    fn fy(&self) -> f64 {
        self.model.camera.fy
    }

    /// Principal point along x, px.
    #[getter]
    fn cx(&self) -> f64 {
        self.model.camera.cx
    }

    /// Principal point along y, px.
    #[getter]
    fn cy(&self) -> f64 {
        self.model.camera.cy
    }

    /// Values of a uint16 depth image per metre.
    #[getter]
    fn depth_scale(&self) -> f64 {
        self.model.depth_scale
    }

    /// Name of the camera.
    #[getter]
    fn name(&self) -> &str {
        &self.model.name
    }

    /// Whether it was derived from a data sheet's field of view instead of a calibration.
    #[getter]
    fn nominal(&self) -> bool {
        self.model.nominal
    }

    /// The camera matrix, (3, 3) float64, px.
    #[getter]
    fn k<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let c = &self.model.camera;
        let rows = [[c.fx, 0.0, c.cx], [0.0, c.fy, c.cy], [0.0, 0.0, 1.0]];
        arrays::table(py, rows)
    }

    /// k1, k2, p1, p2, k3 as (5,) float64.
    #[getter]
    fn distortion<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let d = &self.model.camera.distortion;
        arrays::row(py, vec![d.k1, d.k2, d.p1, d.p2, d.k3])
    }

    fn __repr__(&self) -> String {
        let c = &self.model.camera;
        let d = &c.distortion;
        let lens = if d.is_zero() {
            String::new()
        } else {
            let k = [d.k1, d.k2, d.p1, d.p2, d.k3];
            format!(", distortion={k:?}")
        };
        format!(
            "Camera({}, {}, {:?}, {:?}, {:?}, {:?}{lens}, depth_scale={:?})",
            c.width, c.height, c.fx, c.fy, c.cx, c.cy, self.model.depth_scale
        )
    }
}
