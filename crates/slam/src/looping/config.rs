//! How loops are closed.

use crate::validation::Checker;
use serde::{Deserialize, Serialize};

/// How loops are closed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LoopingConfig {
    /// Whether loops are closed at all.
    pub enabled: bool,
    /// Odds that close a loop: how much likelier it must be that two keyframes show one place than that two places look alike.
    /// Range: 1 to 1e9. From 1000 on no submaps are joined, since nothing there rules out an equal place.
    pub min_odds: f64,
}

impl Default for LoopingConfig {
    fn default() -> Self {
        // On simulated walks other places reach less than even odds, and true loops up to a million (decision 46).
        Self {
            enabled: true,
            min_odds: 20.0,
        }
    }
}

impl LoopingConfig {
    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("min_odds", self.min_odds, 1.0, 1e9);
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
