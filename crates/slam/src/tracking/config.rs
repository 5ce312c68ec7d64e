//! Settings of tracking.

use super::keyframe::KeyframeConfig;
use crate::sensor::SensorConfig;
use crate::static_filter::FilterSetup;
use crate::validation::Checker;
use serde::{Deserialize, Serialize};
use stillpoint_features::OrbConfig;

/// Settings of the tracker, made from a [`Config`](crate::Config).
#[derive(Clone, Debug, PartialEq)]
pub struct TrackerSetup {
    /// Settings of tracking.
    pub tracking: TrackingConfig,
    /// When a frame becomes a keyframe.
    pub keyframes: KeyframeConfig,
    /// Feature extraction.
    pub features: OrbConfig,
    /// The depth sensor's range and noise.
    pub sensor: SensorConfig,
    /// Settings of the static filter.
    pub filter: FilterSetup,
    /// Seed of all random choices.
    pub seed: u64,
}

/// Settings of tracking.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackingConfig {
    /// Minimum number of inliers of a measured pose. Range: 10 to 1000. Fewer may agree by chance.
    pub min_inliers: usize,
    /// Duration of frames with enough features but no match to the map after which a new submap is started, s. Range:
    /// 0.03 to 3600. Frames of a covered lens do not count, and each frame counts for at most 0.1 s.
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

/// Minimum number of features with depth to start a map: a hundred points suffice for the next frame, and a blank wall
/// with a poster does not start one. The code of ORB-SLAM2 (Mur-Artal, Tardos 2017) requires as many in monocular
/// initialisation.
pub(crate) const MIN_INITIAL_POINTS: usize = 100;

impl TrackingConfig {
    /// Minimum number of inliers to relocalise: two thirds more than for tracking, as there is no other evidence for
    /// the pose.
    pub(crate) fn min_relocalisation_inliers(&self) -> usize {
        self.min_inliers * 5 / 3
    }

    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("min_inliers", self.min_inliers as f64, 10.0, 1e3);
        c.range("new_submap_seconds", self.new_submap_seconds, 0.03, 3600.0);
    }
}
