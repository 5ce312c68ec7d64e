//! Configuration of the whole system, one struct per stage. Stages do not depend on it: `setup.rs` gives each its own
//! part.

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

/// All settings. Defaults suit an RGB-D camera of 640x480 at 30 Hz.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Seed of all random choices. Range: any. The same seed gives bit-identical results.
    pub seed: u64,
    /// Feature extraction.
    pub features: FeaturesConfig,
    /// The depth sensor's range and noise.
    pub sensor: SensorConfig,
    /// Rejection of moving objects.
    pub static_filter: StaticFilterConfig,
    /// How likely classes of objects are to move, from 0 (ignored) to 5 (moves by itself), e.g. `chair = 2`. Classes
    /// not given keep their defaults. Names are those of COCO.
    pub motion_weights: MotionWeights,
    /// Pose tracking.
    pub tracking: TrackingConfig,
    /// When a frame becomes a keyframe.
    pub keyframes: KeyframeConfig,
    /// Map building.
    pub mapping: MappingConfig,
    /// Loop closing.
    pub looping: LoopingConfig,
    /// Which frames are sent to the detector.
    pub detector: DetectorConfig,
    /// Delays of the background stages in the inline driver.
    pub schedule: Schedule,
}

/// Which frames are sent to the detector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DetectorConfig {
    /// The detector processes every n-th frame, starting with the first. Range: 1 to 100. With the same value of
    /// `schedule.detector`, it simulates a detector that always takes the newest frame and is busy for n frames.
    pub stride: u32,
}

impl Default for DetectorConfig {
    fn default() -> Self {
        Self { stride: 1 }
    }
}

/// Delays of replies in the inline driver, frames; 0 means before the next frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Schedule {
    /// Frames between an image and its detections. Range: 0 to 1000. 0: detections are available before their frame is
    /// tracked, as in offline processing.
    pub detector: u32,
    /// Frames between a keyframe and the map view that holds it. Range: 0 to 1000. 0: mapping keeps up with the camera.
    pub mapper: u32,
    /// Frames between a keyframe and the loop correction it leads to. Range: 0 to 1000. 0: loops are closed at once.
    pub loop_closer: u32,
}
