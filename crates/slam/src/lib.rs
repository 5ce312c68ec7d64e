//! The stages of the SLAM system, and the single-threaded drivers [`System`] and [`Replay`] (of a live run).
//!
//! A frame goes through [`System::step`], which returns [`Event`]s with the camera's pose and changes of the map. No
//! access to files, clocks or threads.

mod anchored_pose;
mod association;
mod config;
mod covariance;
mod dynamic_mask;
mod effort;
mod event;
mod evidence;
mod exchange;
mod fingerprint;
mod frame_state;
mod gate;
mod health;
mod inertial;
mod join;
mod landmark_set;
mod least_first;
mod loop_evidence;
mod looping;
mod loops;
mod map_shift;
mod mapping;
mod messages;
mod odometry;
mod pace;
mod recycle;
mod replay;
mod report;
mod retrace;
pub mod routing;
mod run_log;
mod sensor;
mod shutter;
mod smoothing;
mod stages;
mod static_filter;
mod subscriber;
#[cfg(test)]
mod synthetic;
mod system;
mod timing;
mod tracking;
mod trajectory;
mod trust;
mod up;
mod validation;
mod view_angle;

pub use anchored_pose::AnchoredPose;
pub use config::{Config, DetectorConfig, FeaturesConfig, Schedule};
pub use covariance::{
    CovarianceLog, MapCovariance, PoseCovariance, covariance_in_map, covariance_of_motion,
};
pub use dynamic_mask::{DynamicMask, MaskError, MovingThings};
pub use effort::{CostTable, MIN_FEATURES, Plan};
pub use event::{Event, FrameEvent};
pub use evidence::{Cells, Evidence, Scatter};
pub use exchange::{Exchange, NotSent};
pub use frame_state::FrameState;
pub use gate::{FrameGate, RefusalReason, RefusedFrame};
pub use health::{Health, HealthMonitor, Loss, LossCause, Quality};
pub use inertial::{InertialReport, InertialState, SensorFault};
pub use join::{JoinedMaps, Placed, join_maps};
pub use loop_evidence::LoopEvidence;
pub use looping::{LoopCloser, LoopCloserSetup, LoopingConfig};
pub use loops::Loops;
pub use map_shift::MapShift;
pub use mapping::{Mapper, MapperSetup, MappingConfig, MappingEffort};
pub use messages::{
    Exposure, LandmarkStatistic, LoopCloserMsg, LoopCloserOut, MapperMsg, MapperOut, MapperReport,
    NewKeyframe, Tracked,
};
pub use odometry::{OdometryFault, OdometryReport, OdometryState};
pub use replay::{Replay, ReplayError};
pub use report::{
    BundleCounts, CorrectionReport, FrameCounts, FrameReport, LoopOutcome, LoopReport, LostReason,
    MappingReport, Outcome, RejudgeReport, RevokeReport,
};
pub use retrace::Retracer;
pub use run_log::{LogEntry, LogError, RunLog};
pub use sensor::{DepthNoise, SensorConfig};
pub use stages::{MapUse, Stages, StartError};
pub use static_filter::{
    FeatureVerdict, FilterParts, FilterSetup, MOVER, Preset, Reasons, Segments, StaticFilterConfig,
};
pub use stillpoint_imaging::Simd;
pub use subscriber::{OnEvent, Subscriber};
pub use system::System;
pub use timing::Timing;
pub use tracking::{KeyframeConfig, Tracker, TrackerSetup, TrackingConfig};
pub use trajectory::{Trajectory, TrajectoryEntry};
pub use trust::SensorState;
pub use up::Up;
pub use validation::{ConfigError, ConfigProblem};
