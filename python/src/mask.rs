//! Masks of moving regions, without SLAM.

use crate::arguments::{pose, reals, value};
use crate::arrays;
use crate::camera::Camera;
use crate::config::Config;
use crate::frame::Verdicts;
use crate::guard::{Turn, detached};
use crate::images::{Handed, Intake, Order, refused};
use crate::objects::Object;
use numpy::PyArray2;
use pyo3::prelude::*;
use std::sync::Arc;
use stillpoint::detection::Detections;
use stillpoint::imaging::FrameId;
use stillpoint::slam::{self, MaskError, MovingThings};
use stillpoint_cli::front;

/// Maximum number of pixels per query.
const MOST_PIXELS: usize = 1 << 24;

/// Masks the moving pixels of a stream: the static filter without SLAM, for use with another SLAM system.
///
/// Args:
///     camera, config, color_order: as for :class:`Slam`.
///
/// >>> room = simulate("xyz", frames=2)
/// >>> filter = DynamicMask(room.camera)
/// >>> for image in room:
/// ...     moving = filter.step(image.stamp, image.color, image.depth)
/// >>> moving.mask.shape, moving.mask.dtype.name
/// ((480, 640), 'uint8')
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct DynamicMask {
    filter: Turn<Filter>,
    intake: Intake,
}

struct Filter {
    mask: slam::DynamicMask,
    next: u32,
}

#[pymethods]
impl DynamicMask {
    #[new]
    #[pyo3(signature = (camera, config=None, *, color_order=None))]
    fn new(
        camera: &Bound<'_, PyAny>,
        config: Option<&Bound<'_, PyAny>>,
        color_order: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let py = camera.py();
        let camera = Camera::from_any(camera)?;
        let order = Order::of(color_order)?;
        let config = Config::from_any(config)?;
        let simd = front::simd().map_err(|e| value("STILLPOINT_SIMD", e))?;
        let workers = front::workers(false).map_err(|e| value("STILLPOINT_WORKERS", e))?;
        let lens = camera.model.camera;
        let mask = detached(py, || {
            let mask = slam::DynamicMask::new(&config, lens, simd)?;
            Ok(mask.with_workers(workers))
        })?;
        let mask = mask.map_err(|e| {
            let of_camera = |p: &slam::ConfigProblem| p.path == "camera";
            let is_camera = matches!(&e, MaskError::Config(e) if e.0.iter().any(of_camera));
            value(if is_camera { "camera" } else { "config" }, e)
        })?;
        Ok(Self {
            filter: Turn::new(Filter { mask, next: 0 }),
            intake: Intake::new(camera, order, false),
        })
    }

    /// Processes the next frame, without the interpreter's lock.
    ///
    /// Args:
    ///     stamp, color, depth, detections, depth_stamp: as for :meth:`Slam.track`.
    ///     pose: your own pose world_from_camera of this frame, (4, 4), m; give one for every frame or for none.
    ///
    /// Raises:
    ///     ValueError, TypeError: invalid argument; the message names it.
    #[pyo3(signature = (stamp, color, depth, detections=None, *, pose=None, depth_stamp=None))]
    #[allow(clippy::too_many_arguments)] // Named in Python.
    fn step(
        &self,
        py: Python<'_>,
        stamp: &Bound<'_, PyAny>,
        color: &Bound<'_, PyAny>,
        depth: &Bound<'_, PyAny>,
        detections: Option<&Bound<'_, PyAny>>,
        pose: Option<&Bound<'_, PyAny>>,
        depth_stamp: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Moving> {
        let handed = Handed {
            stamp,
            colour: color,
            depth,
            depth_stamp,
            detections,
        };
        let given = pose.map(|p| self::pose("pose", p)).transpose()?;
        let (taken, seen) = self.intake.take(py, &handed)?;
        let looked = self.filter.with(py, |filter| {
            let id = FrameId(filter.next);
            let stamp = taken.stamp;
            let frame = Arc::new(taken.numbered(id));
            if let Some(items) = seen {
                filter.mask.detections(Detections {
                    frame: id,
                    stamp,
                    items,
                });
            }
            let looked = filter.mask.step(&frame, given.as_ref());
            filter.next = filter.next.saturating_add(u32::from(looked.is_ok()));
            looked
        })?;
        looked.map(|things| Moving { things }).map_err(refused)
    }

    /// The filter's verdicts on any raw pixels of the last frame, such as the keypoints of another system.
    ///
    /// Args:
    ///     pixels: (N, 2) as x, y, px.
    #[pyo3(signature = (pixels))]
    fn verdicts(&self, py: Python<'_>, pixels: &Bound<'_, PyAny>) -> PyResult<Verdicts> {
        const EXPECTED: &str = "pixels as x, y, (N, 2)";
        let (shape, flat) = reals("pixels", EXPECTED, pixels, MOST_PIXELS)?;
        let fits = shape.len() == 2 && shape[1] == 2;
        if !fits && !flat.is_empty() {
            return Err(value(
                "pixels",
                format!("expected {EXPECTED}, found the shape {shape:?}"),
            ));
        }
        if flat.iter().any(|v| !v.is_finite() || v.abs() > 1e6) {
            return Err(value(
                "pixels",
                format!("expected {EXPECTED}, finite, found others"),
            ));
        }
        let pixels: Vec<[f32; 2]> = flat
            .chunks_exact(2)
            .map(|p| [p[0] as f32, p[1] as f32])
            .collect();
        let all = self
            .filter
            .with(py, |filter| filter.mask.verdicts(&pixels))?;
        Ok(Verdicts { all: all.into() })
    }
}

/// Moving regions of one frame.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Moving {
    things: MovingThings,
}

#[pymethods]
impl Moving {
    /// Number of the frame, from 0.
    #[getter]
    fn index(&self) -> u32 {
        self.things.frame.id.0
    }

    /// Stamp of the colour image, s.
    #[getter]
    fn stamp(&self) -> f64 {
        self.things.frame.stamp
    }

    /// Mask of moving regions, (height, width) uint8: 255 where the scene moves, 0 where it is static or unknown.
    #[getter]
    fn mask<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        crate::frame::mask(py, || self.things.mask())
    }

    /// The pose world_from_camera used, (4, 4) float64, m: yours if given, else estimated from frame to frame, with drift; None if unknown,
    /// and then nothing is marked as moving.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let pose = self.things.world_from_camera.as_ref();
        pose.map(|p| arrays::pose(py, p)).transpose()
    }

    /// The filter's verdicts on its own keypoints.
    #[getter]
    fn verdicts(&self) -> Verdicts {
        Verdicts {
            all: Arc::clone(&self.things.verdicts),
        }
    }

    /// Objects tracked from detections.
    #[getter]
    fn objects(&self) -> Vec<Object> {
        Object::all(&self.things.objects)
    }

    fn __repr__(&self) -> String {
        format!(
            "<Moving in frame {} at {:.6} s>",
            self.things.frame.id, self.things.frame.stamp
        )
    }
}
