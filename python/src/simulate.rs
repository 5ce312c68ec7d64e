//! Simulated rooms with exact ground truth.

use crate::arguments::{count, is_bool, number, value, words, wrong_type, yes};
use crate::arrays;
use crate::camera::Camera;
use crate::detections::Detection;
use crate::guard::detached;
use crate::source::{Image, Images};
use crate::trajectory::Trajectory;
use numpy::PyArray2;
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use std::sync::Arc;
use stillpoint::datasets::StampedPose;
use stillpoint::detection::{BoundingBox, ClassId, Detection as Seen};
use stillpoint::simulator::{
    DetectionNoise, SimulatedImu, SimulatedOdometry, Simulator, SimulatorConfig, scene_names,
};

/// Maximum number of frames: three hours at 30 Hz.
const MOST: u64 = 324_000;

/// A simulated recording: frames are reproducible on every machine, and poses known exactly. Made by :func:`simulate`.
///
/// Args:
///     scene: one of :meth:`scenes`.
///     frames: number of frames; None for the scene's own length.
///     seed: determines layout, textures, tremor and noise.
///     rate: frames per second.
///     noise: whether images have the noise of a real camera, or are ideal.
///     camera: the camera; None for one of 640x480 px.
///     imu: whether frames have samples of an inertial sensor, a BMI055; its noise is independent of `noise`.
///     odometry: whether frames have wheel odometry of a base under the camera; its errors are independent of `noise`.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Simulation {
    simulator: Arc<Simulator>,
    config: SimulatorConfig,
    camera: Camera,
    imu: Option<SimulatedImu>,
    wheels: Option<SimulatedOdometry>,
}

#[pymethods]
impl Simulation {
    #[new]
    #[pyo3(signature = (scene=None, frames=None, *, seed=None, rate=None, noise=None, camera=None, imu=None, odometry=None))]
    #[allow(clippy::too_many_arguments)] // Named in Python.
    fn new(
        py: Python<'_>,
        scene: Option<&Bound<'_, PyAny>>,
        frames: Option<&Bound<'_, PyAny>>,
        seed: Option<&Bound<'_, PyAny>>,
        rate: Option<&Bound<'_, PyAny>>,
        noise: Option<&Bound<'_, PyAny>>,
        camera: Option<&Bound<'_, PyAny>>,
        imu: Option<&Bound<'_, PyAny>>,
        odometry: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let scene = scene.map_or(Ok("xyz".to_owned()), |s| words("scene", s))?;
        let frames = frames.map(|n| count("frames", n, MOST)).transpose()?;
        let mut config = SimulatorConfig {
            scene: scene.clone(),
            seed: seed.map_or(Ok(0), |s| count("seed", s, i64::MAX as u64))?,
            frames: frames.map(|n| n as usize),
            noise: noise.map_or(Ok(true), |n| yes("noise", n))?,
            ..SimulatorConfig::default()
        };
        if let Some(rate) = rate {
            config.rate = number("rate", rate, [1.0, 1000.0])?;
            config.depth_delay = config.depth_delay.min(0.3 / config.rate);
        }
        let mut model = Camera::of(&stillpoint::datasets::CameraModel {
            name: format!("simulated {scene}"),
            camera: config.camera,
            depth_scale: 5000.0,
            nominal: false,
            imu: None,
            odometry: None,
        });
        if let Some(camera) = camera {
            model = Camera::from_any(camera)?;
            config.camera = model.model.camera;
        }
        let imu = imu
            .map_or(Ok(false), |i| yes("imu", i))?
            .then(SimulatedImu::default);
        model.model.imu = imu.as_ref().map(|i| i.model);
        let wheels = odometry
            .map_or(Ok(false), |o| yes("odometry", o))?
            .then(SimulatedOdometry::default);
        model.model.odometry = wheels.as_ref().map(|w| w.model);
        let simulator = detached(py, || Simulator::new(&config))?;
        let simulator = simulator.map_err(|e| {
            use stillpoint::simulator::SimulatorError::{Camera, UnknownScene};
            let name = match &e {
                UnknownScene { .. } => "scene",
                Camera(_) => "camera",
                _ => "rate",
            };
            value(name, e)
        })?;
        Ok(Self {
            simulator: Arc::new(simulator),
            config,
            camera: model,
            imu,
            wheels,
        })
    }

    /// Names of the scenes.
    ///
    /// >>> "walking_xyz" in Simulation.scenes()
    /// True
    #[staticmethod]
    fn scenes() -> Vec<&'static str> {
        scene_names().to_vec()
    }

    /// Whether the frames have samples of an inertial sensor.
    #[getter]
    fn has_imu(&self) -> bool {
        self.imu.is_some()
    }

    /// Whether the frames have wheel odometry.
    #[getter]
    fn has_odometry(&self) -> bool {
        self.wheels.is_some()
    }

    fn __len__(&self) -> usize {
        self.simulator.len()
    }

    fn __iter__(&self, py: Python<'_>) -> PyResult<Images> {
        let twin = detached(py, || Simulator::new(&self.config))?;
        let twin = twin.map_err(|e| value("scene", e))?;
        let exact = Arc::clone(&self.simulator);
        let truth = Box::new(move |stamp| exact.world_from_camera(stamp));
        let mut source = twin.source().with_colour();
        if let Some(imu) = &self.imu {
            source = source.with_imu(imu);
        }
        if let Some(wheels) = &self.wheels {
            source = source.with_odometry(wheels);
        }
        Ok(Images::new(source, Some(truth)))
    }

    fn __getitem__(&self, py: Python<'_>, index: &Bound<'_, PyAny>) -> PyResult<Image> {
        let index = self.index(index)?;
        let simulator = &self.simulator;
        let frame = detached(py, || simulator.frame_with_colour(index))?;
        let truth = simulator.world_from_camera(frame.stamp);
        Ok(Image::new(frame, Some(truth)))
    }

    /// The exact mask of moving pixels of a frame, (height, width) uint8: 255 where something moves, else 0.
    fn mask<'py>(
        &self,
        py: Python<'py>,
        index: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let index = self.index(index)?;
        let truth = detached(py, || self.simulator.truth(index))?;
        let mask = truth.mask;
        let moving = |k: &u8| if *k > 0 { 255 } else { 0 };
        let shape = (mask.height(), mask.width());
        arrays::grid(py, shape, mask.data().iter().map(moving).collect())
    }

    /// Detections of a frame as from a small network: some are missed, and borders are off by some pixels.
    fn detections(&self, py: Python<'_>, index: &Bound<'_, PyAny>) -> PyResult<Vec<Detection>> {
        let index = self.index(index)?;
        let noise = DetectionNoise {
            seed: self.config.seed,
            ..DetectionNoise::default()
        };
        let found = detached(py, || self.simulator.detections(index, &noise))?;
        let one = |d: stillpoint::simulator::ScriptedDetection| {
            let (x0, y0, x1, y1) = (d.x0, d.y0, d.x1, d.y1);
            Some(Detection {
                seen: Seen {
                    class: ClassId::from_name(d.class)?,
                    score: d.score,
                    bounds: BoundingBox { x0, y0, x1, y1 },
                },
            })
        };
        Ok(found.into_iter().filter_map(one).collect())
    }

    /// The camera.
    #[getter]
    fn camera(&self) -> Camera {
        self.camera.clone()
    }

    /// The exact poses at the colour stamps.
    #[getter]
    fn truth(&self) -> Trajectory {
        let all = self.simulator.ground_truth().into_iter();
        let one = |(stamp, world_from_camera)| StampedPose {
            stamp,
            world_from_camera,
        };
        Trajectory::of(all.map(one).collect())
    }

    fn __repr__(&self) -> String {
        format!(
            "<Simulation: {}, {} frames>",
            self.config.scene,
            self.simulator.len()
        )
    }
}

impl Simulation {
    fn index(&self, found: &Bound<'_, PyAny>) -> PyResult<usize> {
        let length = self.simulator.len();
        let wrong = || wrong_type("index", "the number of a frame", found);
        if is_bool(found) || !found.hasattr("__index__").unwrap_or(false) {
            return Err(wrong());
        }
        let index: isize = found
            .call_method0("__index__")
            .map_err(|_| wrong())?
            .extract()
            .unwrap_or(isize::MIN);
        let at = if index < 0 {
            index.saturating_add(length as isize)
        } else {
            index
        };
        usize::try_from(at)
            .ok()
            .filter(|i| *i < length)
            .ok_or_else(|| {
                PyIndexError::new_err(format!(
                    "index: expected one of {length} frames, found {index}"
                ))
            })
    }
}
