//! The stages of the SLAM system, and the drivers that run them in one thread: [`System`], and [`Replay`] of a live run.
//!
//! Answers: where the camera is and what the map becomes, frame by frame. A frame goes through [`System::step`]; what
//! happened comes back as [`Event`]s. Knows no files, clocks or threads.

mod association;
mod config;
mod effort;
mod event;
mod evidence;
mod fingerprint;
mod gate;
mod health;
mod join;
mod looping;
mod mapping;
mod messages;
mod replay;
mod run_log;
mod sensor;
mod stages;
mod static_filter;
mod system;
mod tracking;
mod trajectory;
mod validation;

pub use config::{Config, DetectorConfig, Schedule};
pub use effort::{CostTable, MIN_FEATURES, Plan};
pub use event::{
    BundleCounts, CorrectionReport, Event, FrameCounts, FrameReport, LoopOutcome, LoopReport,
    LostReason, MappingReport, Outcome, RejudgeReport, tell_applied,
};
pub use evidence::{Cells, Evidence};
pub use gate::{FrameGate, RefusalReason, RefusedFrame};
pub use health::{Health, HealthMonitor, Loss, LossCause, Quality};
pub use join::{JoinedMaps, join_maps};
pub use looping::{Looper, LooperSetup, LoopingConfig};
pub use mapping::{Mapper, MapperSetup, MappingConfig, MappingEffort};
pub use messages::{
    LandmarkStatistic, LooperMsg, LooperOut, MapperMsg, MapperOut, MapperReport, NewKeyframe,
    Tracked,
};
pub use replay::{Replay, ReplayError};
pub use run_log::{LogEntry, LogError, RunLog};
pub use sensor::{DepthNoise, SensorConfig, Timing};
pub use stages::{MapUse, Stages, StartError};
pub use static_filter::{
    FeatureVerdict, FilterSetup, MOVER, Preset, Reasons, Segments, StaticFilterConfig,
};
pub use stillpoint_imaging::Simd;
pub use system::System;
pub use tracking::{KeyframeConfig, Tracker, TrackerSetup, TrackingConfig};
pub use trajectory::{Trajectory, TrajectoryEntry};
pub use validation::{ConfigError, ConfigProblem};
