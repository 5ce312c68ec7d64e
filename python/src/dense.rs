//! Surface, mesh and grid of the static scene.

use crate::arguments::{self, number, reals, value};
use crate::arrays;
use crate::guard::detached;
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use std::path::Path;
use std::sync::Arc;
use stillpoint::dense::{
    DenseMap, Floor, Mesh as Surface, MeshOptions, Occupancy, Plan, PlanOptions,
};
use stillpoint::geometry::Vec3;

/// Maximum number of points per query.
const MOST: usize = 1 << 26;

/// The surface of the static scene at the time of the call.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Dense {
    map: Arc<DenseMap>,
}

impl Dense {
    pub(crate) fn new(map: DenseMap) -> Self {
        Self { map: Arc::new(map) }
    }
}

#[pymethods]
impl Dense {
    /// Voxel size, m.
    #[getter]
    fn voxel(&self) -> f64 {
        self.map.voxel()
    }

    /// The surface as triangles.
    ///
    /// Args:
    ///     min_area: minimum area of a connected piece, m^2; None for 0.01.
    #[pyo3(signature = (*, min_area=None))]
    fn mesh(&self, py: Python<'_>, min_area: Option<&Bound<'_, PyAny>>) -> PyResult<Mesh> {
        let mut options = MeshOptions::default();
        if let Some(area) = min_area {
            options.min_area = number("min_area", area, [0.0, 1e6])?;
        }
        let surface = detached(py, || self.map.mesh(&options))?;
        Ok(Mesh { surface })
    }

    /// The floor plan between two heights above the floor; None if no floor was seen.
    ///
    /// Args:
    ///     low, high: heights, m; None for 0.1 and 1.5.
    ///     up: the direction away from the floor in the world, (3,); None assumes that the camera was upright at the start.
    #[pyo3(signature = (*, low=None, high=None, up=None))]
    fn grid(
        &self,
        py: Python<'_>,
        low: Option<&Bound<'_, PyAny>>,
        high: Option<&Bound<'_, PyAny>>,
        up: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Option<Grid>> {
        let mut options = PlanOptions::default();
        if let Some(low) = low {
            options.low = number("low", low, [-10.0, 100.0])?;
        }
        if let Some(high) = high {
            options.high = number("high", high, [-10.0, 100.0])?;
        }
        if options.low >= options.high {
            return Err(value(
                "low",
                format!(
                    "expected less than high, found {} and {}",
                    options.low, options.high
                ),
            ));
        }
        let up = match up {
            None => -Vec3::y(),
            Some(found) => direction("up", found)?,
        };
        let plan = detached(py, || {
            let mesh = self.map.mesh(&MeshOptions::default());
            self.map.plan(&Floor::find(&mesh, &up)?, &options)
        })?;
        Ok(plan.map(|plan| Grid { plan }))
    }

    /// Signed distance of world points to the surface, (N,) float64, m: positive in front of it, NaN where unknown.
    ///
    /// Args:
    ///     points: (N, 3), m.
    fn distance<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        const EXPECTED: &str = "points of the world, (N, 3), m";
        let (shape, flat) = reals("points", EXPECTED, points, MOST)?;
        let fits = shape.len() == 2 && shape[1] == 3;
        if !fits && !flat.is_empty() {
            return Err(value(
                "points",
                format!("expected {EXPECTED}, found the shape {shape:?}"),
            ));
        }
        if flat.iter().any(|v| !v.is_finite() || v.abs() > 1e5) {
            return Err(value(
                "points",
                format!("expected {EXPECTED}, finite, found others"),
            ));
        }
        let at = |p: &[f64]| {
            self.map
                .distance(&Vec3::new(p[0], p[1], p[2]))
                .unwrap_or(f64::NAN)
        };
        let found = detached(py, || flat.chunks_exact(3).map(at).collect())?;
        Ok(arrays::row(py, found))
    }

    fn __repr__(&self) -> String {
        format!(
            "<Dense: voxels of {} m, {:.1} MB>",
            self.map.voxel(),
            self.map.bytes() as f64 / 1e6
        )
    }
}

fn direction(name: &str, found: &Bound<'_, PyAny>) -> PyResult<Vec3> {
    let (_, v) = reals(name, "a direction, (3,)", found, 3)?;
    if let [x, y, z] = v[..] {
        let v = Vec3::new(x, y, z);
        if v.norm().is_finite() && v.norm() > 1e-9 {
            return Ok(v / v.norm());
        }
    }
    Err(value(
        name,
        format!("expected a direction, (3,), not of length 0, found {v:?}"),
    ))
}

/// Triangles of a surface in the world.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Mesh {
    surface: Surface,
}

fn ending(path: &Path) -> String {
    let ending = path.extension().unwrap_or_default();
    ending.to_string_lossy().to_lowercase()
}

fn write(path: &Path, content: &[u8]) -> PyResult<()> {
    let written = stillpoint::datasets::write_atomic(path, content);
    written.map_err(|e| PyOSError::new_err(format!("path: {e}")))
}

#[pymethods]
impl Mesh {
    /// Vertices, (N, 3) float32, m.
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::table(py, self.surface.positions.iter().copied())
    }

    /// Outward normals of the vertices, (N, 3) float32.
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::table(py, self.surface.normals.iter().copied())
    }

    /// Colours of the vertices as RGB, (N, 3) uint8.
    #[getter]
    fn colors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        arrays::table(py, self.surface.colours.iter().copied())
    }

    /// Vertex indices of each triangle, (M, 3) uint32.
    #[getter]
    fn triangles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        arrays::table(py, self.surface.triangles.iter().copied())
    }

    /// Total area, m^2.
    #[getter]
    fn area(&self) -> f64 {
        self.surface.area()
    }

    /// Writes a ``.ply`` or ``.glb`` file, atomically.
    fn save(&self, py: Python<'_>, path: &Bound<'_, PyAny>) -> PyResult<()> {
        let path = arguments::path("path", path)?;
        let mut content = Vec::new();
        let written = match &*ending(&path) {
            "ply" => detached(py, || self.surface.write_ply(&mut content))?,
            "glb" => detached(py, || self.surface.write_glb(&mut content, None))?,
            _ => {
                return Err(value(
                    "path",
                    format!(
                        "expected a name that ends with .ply or .glb, found {}",
                        path.display()
                    ),
                ));
            }
        };
        written.map_err(|e| PyOSError::new_err(format!("path: {e}")))?;
        write(&path, &content)
    }

    fn __repr__(&self) -> String {
        format!(
            "<Mesh: {} triangles, {:.1} m^2>",
            self.surface.triangles.len(),
            self.surface.area()
        )
    }
}

/// A floor plan: free and occupied cells, seen from above.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Grid {
    plan: Plan,
}

#[pymethods]
impl Grid {
    /// Cells, (height, width) int8 as in ROS: 0 free, 100 occupied, -1 unknown; the first row has the lowest y.
    #[getter]
    fn cells<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i8>>> {
        let one = |cell: &Occupancy| match cell {
            Occupancy::Free => 0,
            Occupancy::Occupied => 100,
            Occupancy::Unknown => -1,
        };
        let shape = (self.plan.height, self.plan.width);
        arrays::grid(py, shape, self.plan.cells.iter().map(one).collect())
    }

    /// Cell size, m.
    #[getter]
    fn resolution(&self) -> f64 {
        self.plan.resolution
    }

    /// x and y of the lower left corner in the level frame, m.
    #[getter]
    fn origin(&self) -> (f64, f64) {
        (self.plan.origin[0], self.plan.origin[1])
    }

    /// Writes a map for ROS's map_server: a ``.yaml`` file and its image.
    fn save(&self, path: &Bound<'_, PyAny>) -> PyResult<()> {
        let path = arguments::path("path", path)?;
        if ending(&path) != "yaml" {
            return Err(value(
                "path",
                format!(
                    "expected a name that ends with .yaml, found {}",
                    path.display()
                ),
            ));
        }
        let image = path.with_extension("pgm");
        let mut content = Vec::new();
        let drawn = self.plan.write_pgm(&mut content);
        drawn.map_err(|e| PyOSError::new_err(format!("path: {e}")))?;
        write(&image, &content)?;
        let name = image.file_name().unwrap_or_default().to_string_lossy();
        write(&path, self.plan.yaml(&name).as_bytes())
    }

    fn __repr__(&self) -> String {
        let (w, h) = (self.plan.width, self.plan.height);
        format!("<Grid: {w}x{h} cells of {} m>", self.plan.resolution)
    }
}
