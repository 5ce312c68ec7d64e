//! The configuration of the whole system: one struct per stage, gathered here.

use crate::looping::LoopingConfig;
use crate::mapping::MappingConfig;
use crate::sensor::SensorConfig;
use crate::static_filter::StaticFilterConfig;
use crate::tracking::{KeyframeConfig, TrackingConfig};
use serde::{Deserialize, Serialize};
use stillpoint_detection::{MotionWeights, ObjectsConfig};
use stillpoint_features::OrbConfig;

/// Everything that can be set. Defaults are meant for an RGB-D camera of 640x480 at 30 Hz.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Seed of every random choice. Range: any. The same seed gives the same result, bit for bit.
    pub seed: u64,
    /// Feature extraction.
    pub features: OrbConfig,
    /// The depth sensor's range and noise.
    pub sensor: SensorConfig,
    /// Rejection of what moves.
    pub static_filter: StaticFilterConfig,
    /// Objects that a detector sees.
    pub objects: ObjectsConfig,
    /// How likely each class of objects is to move, 0 (ignored) to 5 (moves by itself). Classes left out keep their defaults.
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
    pub looper: u32,
}

/// One thing that is wrong with a configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigProblem {
    /// Where, e.g. `tracking.min_inliers`.
    pub path: String,
    /// What was expected and found.
    pub message: String,
}

impl std::fmt::Display for ConfigProblem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.path, self.message)
    }
}

/// All problems of a configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigError(pub Vec<ConfigProblem>);

impl std::fmt::Display for ConfigError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "the configuration is not valid:")?;
        self.0.iter().try_for_each(|p| write!(f, "\n  {p}"))
    }
}

impl std::error::Error for ConfigError {}

/// Collects range violations with their paths.
pub(crate) struct Checker<'a> {
    pub(crate) section: &'a str,
    pub(crate) problems: &'a mut Vec<ConfigProblem>,
}

impl Checker<'_> {
    /// Notes a problem unless `low <= value <= high` (false for NaN too).
    pub(crate) fn range(&mut self, name: &str, value: f64, low: f64, high: f64) {
        if !(low..=high).contains(&value) {
            self.problems.push(ConfigProblem {
                path: format!("{}.{name}", self.section),
                message: format!("expected {low} to {high}, found {value}"),
            });
        }
    }
}

impl Config {
    /// Checks every field's range and reports all problems at once.
    ///
    /// # Errors
    /// [`ConfigError`] with one entry per field out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let mut problems = Vec::new();
        let mut section = |section: &'static str, f: &dyn Fn(&mut Checker<'_>)| {
            f(&mut Checker {
                section,
                problems: &mut problems,
            });
        };
        section("features", &|c| {
            let f = &self.features;
            c.range("features", f.features as f64, 100.0, 10_000.0);
            c.range("levels", f.levels as f64, 1.0, 16.0);
            c.range("scale_factor", f64::from(f.scale_factor), 1.05, 2.0);
            c.range("fast_threshold", f64::from(f.fast_threshold), 1.0, 255.0);
            c.range(
                "fast_threshold_low",
                f64::from(f.fast_threshold_low),
                1.0,
                f64::from(f.fast_threshold),
            );
        });
        section("sensor", &|c| self.sensor.check(c));
        section("static_filter", &|c| self.static_filter.check(c));
        section("tracking", &|c| self.tracking.check(c));
        section("keyframes", &|c| self.keyframes.check(c));
        section("mapping", &|c| self.mapping.check(c));
        section("looping", &|c| self.looping.check(c));
        section("detector", &|c| {
            c.range("stride", f64::from(self.detector.stride), 1.0, 100.0);
        });
        section("schedule", &|c| {
            c.range("detector", f64::from(self.schedule.detector), 0.0, 1000.0);
            c.range("mapper", f64::from(self.schedule.mapper), 0.0, 1000.0);
            c.range("looper", f64::from(self.schedule.looper), 0.0, 1000.0);
        });
        for problem in self.objects.problems() {
            let (field, message) = problem.split_once(": ").unwrap_or(("", &problem));
            problems.push(ConfigProblem {
                path: format!("objects.{field}"),
                message: message.to_owned(),
            });
        }
        if problems.is_empty() {
            Ok(())
        } else {
            Err(ConfigError(problems))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strides_are_one_to_a_hundred() {
        for (stride, valid) in [(0, false), (1, true), (100, true), (101, false)] {
            let mut config = Config::default();
            config.detector.stride = stride;
            let problems = config.validate().err().map(|e| e.to_string());
            assert_eq!(problems.is_none(), valid, "{stride}");
            assert!(problems.is_none_or(|p| p.contains("detector.stride: expected 1 to 100")));
        }
    }
}
