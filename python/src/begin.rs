//! Start of a run: from the arguments of `Slam` to a system.

use crate::arguments::{number, path, value, wrong_type, yes};
use crate::camera::Camera;
use crate::config::Config;
use crate::detector::Detector as Kept;
use crate::driver::{Driver, Inline};
use crate::guard::{Turn, detached};
use crate::images::{Intake, Order};
use crate::live::{Called, Live};
use crate::result::About;
use crate::sensors::{Models, Sensors};
use crate::slam::Slam;
use crate::{inertial, odometry};
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBool;
use std::path::PathBuf;
use stillpoint::dense::{Dense as Fusing, DenseConfig, DenseMap};
use stillpoint::detection::{Detector, DetectorInfo, NoDetector};
use stillpoint::imaging::Simd;
use stillpoint::slam::{MapUse, Stages, System};
use stillpoint_cli::front;

pub(crate) struct Begin {
    camera: Camera,
    config: stillpoint::slam::Config,
    order: Order,
    detector: Named,
    dense: Option<DenseConfig>,
    models: Models,
    live: bool,
    map: Option<(PathBuf, MapUse)>,
}

enum Named {
    Nobody,
    Function(Py<PyAny>),
    Words(String),
    Kept(Py<Kept>),
}

/// Arguments common to all constructors.
pub(crate) struct Options<'a, 'py> {
    pub(crate) camera: &'a Bound<'py, PyAny>,
    pub(crate) config: Option<&'a Bound<'py, PyAny>>,
    pub(crate) detector: Option<&'a Bound<'py, PyAny>>,
    pub(crate) live: Option<&'a Bound<'py, PyAny>>,
    pub(crate) color_order: Option<&'a Bound<'py, PyAny>>,
    pub(crate) dense: Option<&'a Bound<'py, PyAny>>,
    pub(crate) imu: Option<&'a Bound<'py, PyAny>>,
    pub(crate) odometry: Option<&'a Bound<'py, PyAny>>,
    pub(crate) prior: Option<&'a Bound<'py, PyAny>>,
}

impl Options<'_, '_> {
    pub(crate) fn check(&self, map: Option<(PathBuf, MapUse)>) -> PyResult<Begin> {
        let camera = Camera::from_any(self.camera)?;
        if camera.size().contains(&0) {
            return Err(value(
                "camera",
                "expected a camera with the size of its images, found one without; add width and height",
            ));
        }
        Ok(Begin {
            models: self.models(&camera)?,
            camera,
            config: Config::from_any(self.config)?,
            order: Order::of(self.color_order)?,
            detector: named(self.detector)?,
            dense: voxel(self.dense)?,
            live: self.live.map_or(Ok(false), |l| yes("live", l))?,
            map,
        })
    }

    fn models(&self, camera: &Camera) -> PyResult<Models> {
        let base = odometry::model(self.odometry, camera)?;
        let prior = odometry::prior(self.prior)?;
        if base.is_some() && prior.is_some() {
            return Err(value(
                "prior",
                "expected odometry of a base or poses of the camera, found both; begin with one of them",
            ));
        }
        Ok(Models {
            imu: inertial::model(self.imu, camera)?,
            odometry: base.or(prior),
            has_prior: prior.is_some(),
        })
    }
}

fn named(found: Option<&Bound<'_, PyAny>>) -> PyResult<Named> {
    let Some(found) = found else {
        return Ok(Named::Nobody);
    };
    if let Ok(kept) = found.cast::<Kept>() {
        return Ok(Named::Kept(kept.clone().unbind()));
    }
    if found.extract::<PathBuf>().is_ok() {
        let words = path("detector", found)?;
        return Ok(Named::Words(words.to_string_lossy().into_owned()));
    }
    if found.is_callable() {
        return Ok(Named::Function(found.clone().unbind()));
    }
    Err(wrong_type(
        "detector",
        "None, a Detector, a function, or words as --detector takes them",
        found,
    ))
}

fn voxel(found: Option<&Bound<'_, PyAny>>) -> PyResult<Option<DenseConfig>> {
    let Some(found) = found else {
        return Ok(None);
    };
    let mut config = DenseConfig::default();
    if let Ok(wanted) = found.cast::<PyBool>() {
        return Ok(wanted.is_true().then_some(config));
    }
    config.voxel = number("dense", found, [1e-3, 1.0])?;
    config.validate().map_err(|e| value("dense", e))?;
    Ok(Some(config))
}

impl Begin {
    pub(crate) fn begin(mut self, py: Python<'_>) -> PyResult<Slam> {
        let keep = self.dense.is_some();
        let (camera, order) = (self.camera.clone(), self.order);
        let (detector, looks, function) = match std::mem::replace(&mut self.detector, Named::Nobody)
        {
            Named::Nobody => (None, false, None),
            Named::Function(function) if self.live => {
                let called: Box<dyn Detector> = Box::new(Called(function));
                (Some(called), true, None)
            }
            Named::Function(function) => (None, true, Some(function)),
            Named::Kept(kept) => {
                let (detector, looks) = kept.get().parts();
                (detector, looks, None)
            }
            Named::Words(words) => {
                let found = detached(py, || front::detector(&words))?;
                let (detector, looks) = found.map_err(|e| value("detector", e))?;
                (detector, looks, None)
            }
        };
        let sensors = Sensors::new(self.models);
        let (driver, about) = detached(py, || self.driver(detector, function.is_some()))??;
        Ok(Slam {
            driver: Turn::new(driver),
            intake: Intake::new(camera, order, keep || looks),
            function,
            sensors,
            about,
        })
    }

    fn driver(
        mut self,
        detector: Option<Box<dyn Detector>>,
        calls: bool,
    ) -> PyResult<(Driver, About)> {
        let simd = front::simd().map_err(|e| PyValueError::new_err(e.to_string()))?;
        let workers = front::workers(self.live);
        let workers = workers.map_err(|e| PyValueError::new_err(e.to_string()))?;
        let lens = self.camera.model.camera;
        let loaded = match &self.map {
            None => None,
            Some((path, map_use)) => {
                let map = front::load_map(path, &mut self.config, &lens);
                Some((map.map_err(|e| value("path", e))?, *map_use))
            }
        };
        let stride = self.config.detector.stride;
        let mut about = About {
            config: self.config.clone(),
            detector: about_detector(detector.as_deref(), calls),
            simd,
            keyframes: 0,
        };
        let stages = Stages::new(self.config, lens, simd).map_err(|e| {
            let is_camera = e.0.iter().any(|p| p.path == "camera");
            value(if is_camera { "camera" } else { "config" }, e)
        })?;
        let stages = stages.with_workers(workers);
        let stages = match self.models.imu {
            Some(model) => stages.with_imu(model).map_err(|e| value("imu", e))?,
            None => stages,
        };
        let stages = match self.models.odometry {
            Some(model) => stages
                .with_odometry(model)
                .map_err(|e| value("odometry", e))?,
            None => stages,
        };
        let mut known = None;
        let stages = match loaded {
            None => stages,
            Some(((map, surface), map_use)) => {
                about.keyframes = map.view().keyframe_bound();
                known = surface;
                stages
                    .with_map(map, map_use)
                    .map_err(|e| value("path", e))?
            }
        };
        let dense = self
            .dense
            .map(|config| fusing(config, &lens, simd, (known, about.keyframes)));
        let dense = dense.transpose()?;
        if self.live {
            let live = Live::start(stages, detector, dense);
            let live = live.map_err(|e| {
                PyOSError::new_err(format!("expected to start threads, found: {e}"))
            })?;
            return Ok((Driver::Live(Box::new(live)), about));
        }
        let mut system = System::from(stages);
        if let Some(detector) = detector {
            system = system.with_detector(detector);
        }
        let inline = Inline::new(system, stride, dense);
        Ok((Driver::Inline(Box::new(inline)), about))
    }
}

/// The detector as named in a result.
fn about_detector(detector: Option<&dyn Detector>, calls: bool) -> DetectorInfo {
    match detector {
        Some(detector) => detector.info(),
        None if calls => Called::about(),
        None => NoDetector.info(),
    }
}

/// The surface, continuing that of a loaded map.
fn fusing(
    mut config: DenseConfig,
    lens: &stillpoint::geometry::Camera,
    simd: Simd,
    (known, keyframes): (Option<DenseMap>, usize),
) -> PyResult<Fusing> {
    if let Some(known) = &known {
        config.voxel = known.voxel();
    }
    let dense = Fusing::new(&config, lens, simd).map_err(|e| value("dense", e))?;
    let dense = dense.with_first_keyframe(keyframes);
    Ok(match known {
        Some(known) => dense.starting_with(known),
        None => dense,
    })
}
