//! The configuration of the whole system: one struct per stage, gathered here.
//!
//! Stands above the stages, which know nothing of it: `setup.rs` gives each its own part.

mod sections;
mod setup;
mod validate;

pub use sections::FeaturesConfig;

use crate::looping::LoopingConfig;
use crate::mapping::MappingConfig;
use crate::sensor::SensorConfig;
use crate::static_filter::StaticFilterConfig;
use crate::tracking::{KeyframeConfig, TrackingConfig};
use serde::{Deserialize, Serialize};
use stillpoint_detection::MotionWeights;

/// Everything that can be set. Defaults are meant for an RGB-D camera of 640x480 at 30 Hz.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Seed of every random choice. Range: any. The same seed gives the same result, bit for bit.
    pub seed: u64,
    /// Feature extraction.
    pub features: FeaturesConfig,
    /// The depth sensor's range and noise.
    pub sensor: SensorConfig,
    /// Rejection of what moves.
    pub static_filter: StaticFilterConfig,
    /// How likely classes of objects are to move, 0 (ignored) to 5 (moves by itself), e.g. `chair = 2`: only those that differ from their
    /// defaults. The names are those of COCO.
    pub motion_weights: MotionWeights,
    /// Pose tracking.
    pub tracking: TrackingConfig,
    /// When a frame becomes a keyframe.
    pub keyframes: KeyframeConfig,
    /// Map building.
    pub mapping: MappingConfig,
    /// Loop closing.
    pub looping: LoopingConfig,
    /// Which frames the detector looks at.
    pub detector: DetectorConfig,
    /// Delays of the background stages in the inline driver.
    pub schedule: Schedule,
}

/// Which frames the detector looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DetectorConfig {
    /// The detector looks at every so many frames, from the first on. Range: 1 to 100. With `schedule.detector` as large it
    /// stands for a detector that always takes the newest frame and is busy for so many: it does not look at those in
    /// between, and tracking keeps its rate.
    pub stride: u32,
}

impl Default for DetectorConfig {
    fn default() -> Self {
        Self { stride: 1 }
    }
}

/// Delays of replies in the inline driver, in frames; 0 means before the next frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Schedule {
    /// Frames between an image and the detections in it. Range: 0 to 1000. 0: detections are there before their frame is
    /// tracked, as when a data set is processed at leisure.
    pub detector: u32,
    /// Frames between a keyframe and the map view that holds it. Range: 0 to 1000. 0: mapping keeps up with the camera.
    pub mapper: u32,
    /// Frames between a keyframe and the correction that it led to. Range: 0 to 1000. 0: loops are closed at once.
    pub loop_closer: u32,
}
