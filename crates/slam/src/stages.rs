//! The stages of one run, made to fit each other: what every driver begins with.
//!
//! Answers: how stages are made for a configuration, a camera and perhaps a map that is there already. What a stage has to
//! tell the next is said by the answers themselves ([`MapperOut::for_loop_closer`](crate::MapperOut::for_loop_closer), ...); a driver
//! only decides when it is asked to.

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

/// What is done with a map that is there before the first frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MapUse {
    /// It is resumed and grows.
    #[default]
    Grow,
    /// It is only read: poses, but no keyframes and no new submaps.
    Localize,
}

/// Why a run cannot begin with a map.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum StartError {
    /// Its features come from another pyramid than this run's.
    Features {
        /// Levels of this run's pyramid.
        levels: usize,
        /// Factor between two of them.
        scale_factor: f32,
    },
    /// There is nothing in it to be localized in.
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
    /// Keeps out frames that do not follow the one before. A driver asks it before anything else.
    pub gate: FrameGate,
    /// Finds the pose of every frame.
    pub tracker: Tracker,
    /// Looks again at the first frames of a map, once it is known who moves.
    pub retracer: Retracer,
    /// Says how well things stand at every frame, from what the tracker says of it.
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
    /// [`ConfigError`] when a field is out of range, and for a camera that cannot be computed with ([`Camera::check`]) or has images of
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

    /// The stages with threads that share the work on a frame: see [`Tracker::with_workers`].
    #[must_use]
    pub fn with_workers(mut self, workers: Workers) -> Self {
        self.tracker = self.tracker.with_workers(workers);
        self
    }

    /// The stages with a map that is there already, to be resumed or to be localized in. Until a place in it is recognised
    /// the camera is lost.
    ///
    /// # Errors
    /// [`StartError`] when nothing can be recognised in that map.
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

    /// The stages with an inertial sensor on the camera, whose samples the tracker is given.
    ///
    /// # Errors
    /// [`FigureError`] for figures that no such sensor has.
    pub fn with_imu(mut self, model: ImuModel) -> Result<Self, FigureError> {
        model.check()?;
        self.fingerprint.text(&format!("{model:?}"));
        self.tracker = self.tracker.with_imu(model);
        Ok(self)
    }

    /// The stages with odometry of the base that carries the camera, whose samples the tracker is given.
    ///
    /// # Errors
    /// [`FigureError`] for figures that no odometry has.
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

    /// A number that tells this configuration, camera and first map from others: runs of two that differ are not comparable.
    #[must_use]
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint.value()
    }
}
