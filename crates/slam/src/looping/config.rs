//! How loops are closed.

use crate::validation::Checker;
use serde::{Deserialize, Serialize};

/// How loops are closed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LoopingConfig {
    /// Whether loops are closed at all.
    pub enabled: bool,
    /// Landmarks around the older keyframe that are seen where the motion between both keyframes puts them, at least. Range: 10 to 1000.
    pub min_inliers: usize,
}

impl Default for LoopingConfig {
    fn default() -> Self {
        // The inliers are those of ORB-SLAM2 (Mur-Artal, Tardos 2017).
        Self {
            enabled: true,
            min_inliers: 40,
        }
    }
}

impl LoopingConfig {
    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("min_inliers", self.min_inliers as f64, 10.0, 1e3);
    }
}

/// What of the configuration concerns the loop closer: made from a [`Config`](crate::Config).
#[derive(Clone, Debug, PartialEq)]
pub struct LoopCloserSetup {
    /// How loops are closed.
    pub looping: LoopingConfig,
    /// Landmarks that hold a keyframe in bundle adjustment, at least: fewer make no pose.
    pub min_held: usize,
    /// Seed of every random choice.
    pub seed: u64,
    /// Factor between two levels of the features' pyramid.
    pub scale_factor: f32,
}
