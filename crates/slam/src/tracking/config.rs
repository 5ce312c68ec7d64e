//! How poses are tracked.

use super::keyframe::KeyframeConfig;
use crate::sensor::SensorConfig;
use crate::static_filter::FilterSetup;
use crate::validation::Checker;
use serde::{Deserialize, Serialize};
use stillpoint_features::OrbConfig;

/// The part of the configuration that the tracker uses, made from a [`Config`](crate::Config).
#[derive(Clone, Debug, PartialEq)]
pub struct TrackerSetup {
    /// How poses are tracked.
    pub tracking: TrackingConfig,
    /// When a frame becomes a keyframe.
    pub keyframes: KeyframeConfig,
    /// How features are extracted.
    pub features: OrbConfig,
    /// The depth sensor's range and noise.
    pub sensor: SensorConfig,
    /// The setup of the static filter.
    pub filter: FilterSetup,
    /// Seed of every random choice.
    pub seed: u64,
}

/// How poses are tracked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackingConfig {
    /// A pose counts as measured with at least this many inliers. Range: 10 to 1000. Fewer agree by chance.
    pub min_inliers: usize,
    /// A new submap is begun after frames for so long, s, that show enough and nothing that is known. Range: 0.03 to 3600. Frames of a
    /// covered lens do not count, and a frame stands for 0.1 s at most.
    pub new_submap_seconds: f64,
}

impl Default for TrackingConfig {
    fn default() -> Self {
        // The number of inliers is that of ORB-SLAM2 (Mur-Artal, Tardos 2017).
        Self {
            min_inliers: 30,
            new_submap_seconds: 1.0,
        }
    }
}

/// A map begins with a frame of at least this many features with depth: a hundred points hold the next frame, and a blank wall with a poster on it
/// does not begin one. The code of ORB-SLAM2 (Mur-Artal, Tardos 2017) asks for as many where a single camera begins a map.
pub(crate) const MIN_INITIAL_POINTS: usize = 100;

impl TrackingConfig {
    /// A camera that was lost is found again with at least this many inliers: two thirds more than tracking needs, as nothing else
    /// speaks for the pose.
    pub(crate) fn min_relocalisation_inliers(&self) -> usize {
        self.min_inliers * 5 / 3
    }

    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("min_inliers", self.min_inliers as f64, 10.0, 1e3);
        c.range("new_submap_seconds", self.new_submap_seconds, 0.03, 3600.0);
    }
}
