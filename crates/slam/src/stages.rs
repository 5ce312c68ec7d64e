//! Construction of the stages of one run, for all drivers.

use crate::config::Config;
use crate::fingerprint::Fingerprint;
use crate::gate::FrameGate;
use crate::health::HealthMonitor;
use crate::looping::LoopCloser;
use crate::mapping::Mapper;
use crate::messages::LoopCloserMsg;
use crate::retrace::Retracer;
use crate::tracking::Tracker;
use crate::validation::{ConfigError, check_camera};
use std::sync::Arc;
use stillpoint_geometry::{Camera, FigureError, ImuModel, OdometryModel};
use stillpoint_imaging::{Simd, Workers};
use stillpoint_map::Map;

/// Use of a map that exists before the first frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MapUse {
    /// It is extended.
    #[default]
    Grow,
    /// It is only read: poses, but no keyframes and no new submaps.
    Localize,
}

/// Why a run cannot start with a map.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum StartError {
    /// Its features come from a different pyramid.
    Features {
        /// Levels of this run's pyramid.
        levels: usize,
        /// Scale factor between levels.
        scale_factor: f32,
    },
    /// It is empty, so localisation is impossible.
    Empty,
}

impl std::fmt::Display for StartError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Features {
                levels,
                scale_factor,
            } => write!(
                f,
                "expected a map with features from {levels} levels of factor {scale_factor}, found others: make the map again"
            ),
            Self::Empty => write!(
                f,
                "expected a map with keyframes to be localized in, found an empty one: make it again"
            ),
        }
    }
}

impl std::error::Error for StartError {}

/// The stages of one run before its first frame.
pub struct Stages {
    /// Refuses out-of-order frames. Drivers call it first.
    pub gate: FrameGate,
    /// Estimates the pose of every frame.
    pub tracker: Tracker,
    /// Tracks the first frames of a map again.
    pub retracer: Retracer,
    /// Judges the quality of every pose.
    pub health: HealthMonitor,
    /// Builds the map.
    pub mapper: Mapper,
    /// Closes loops.
    pub loop_closer: LoopCloser,
    config: Config,
    fingerprint: Fingerprint,
}

impl Stages {
    /// Stages for one camera.
    ///
    /// # Errors
    /// [`ConfigError`] if a field is out of range, or for a camera that is invalid ([`Camera::check`]) or has images of
    /// over four megapixels.
    pub fn new(config: Config, camera: Camera, simd: Simd) -> Result<Self, ConfigError> {
        config.validate()?;
        check_camera(&camera)?;
        let mut fingerprint = Fingerprint::default();
        fingerprint.text(&format!("{config:?} {camera:?}"));
        Ok(Self {
            gate: FrameGate::new(&camera),
            health: HealthMonitor::new(&config),
            mapper: Mapper::new(&config),
            retracer: Retracer::new(&config),
            loop_closer: LoopCloser::new(&config),
            tracker: Tracker::new(&config, camera, simd),
            config,
            fingerprint,
        })
    }

    /// Shares the work on a frame among threads: see [`Tracker::with_workers`].
    #[must_use]
    pub fn with_workers(mut self, workers: Workers) -> Self {
        self.tracker = self.tracker.with_workers(workers);
        self
    }

    /// Starts with an existing map. The camera is lost until a place in it is recognised.
    ///
    /// # Errors
    /// [`StartError`] if places of that map cannot be recognised.
    pub fn with_map(mut self, map: Map, map_use: MapUse) -> Result<Self, StartError> {
        let features = self.config.features.orb();
        let (levels, scale_factor) = (features.levels, features.scale_factor);
        if !map.fits(levels, scale_factor) {
            return Err(StartError::Features {
                levels,
                scale_factor,
            });
        }
        if map.view().keyframe_count() == 0 && map_use == MapUse::Localize {
            return Err(StartError::Empty);
        }
        self.mapper = self.mapper.with_map(map);
        let view = self.mapper.publish();
        let known = self.loop_closer.step(LoopCloserMsg::Known {
            view: Arc::clone(&view),
        });
        self.fingerprint.text(&format!("{map_use:?}"));
        for k in view.keyframes() {
            self.fingerprint.number(u64::from(k.id.0));
            self.fingerprint.pose(&k.world_from_camera);
        }
        self.fingerprint.number(view.landmark_count() as u64);
        self.tracker = self.tracker.in_map(view, map_use == MapUse::Grow);
        self.tracker.receive_places(known.places);
        Ok(self)
    }

    /// Adds an inertial sensor on the camera. Its samples go to the tracker.
    ///
    /// # Errors
    /// [`FigureError`] for invalid figures of the model.
    pub fn with_imu(mut self, model: ImuModel) -> Result<Self, FigureError> {
        model.check()?;
        self.fingerprint.text(&format!("{model:?}"));
        self.tracker = self.tracker.with_imu(model);
        Ok(self)
    }

    /// Adds odometry of the base that carries the camera. Its samples go to the tracker.
    ///
    /// # Errors
    /// [`FigureError`] for invalid figures of the model.
    pub fn with_odometry(mut self, model: OdometryModel) -> Result<Self, FigureError> {
        model.check()?;
        self.fingerprint.text(&format!("{model:?}"));
        self.tracker = self.tracker.with_odometry(model);
        Ok(self)
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Hash of configuration, camera and initial map: runs with different hashes are not comparable.
    #[must_use]
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint.value()
    }
}
