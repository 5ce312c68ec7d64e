//! Settings of loop closing.

use crate::validation::Checker;
use serde::{Deserialize, Serialize};

/// Settings of loop closing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LoopingConfig {
    /// Whether loops are closed.
    pub enabled: bool,
    /// Minimum odds to close a loop: same place against similar places. Range: 1 to 1e9. From 1000 on no submaps are
    /// joined, since nothing there rules out an equal place.
    pub min_odds: f64,
}

impl Default for LoopingConfig {
    fn default() -> Self {
        // On simulated walks false loops stay below even odds, and true loops reach up to a million (decision 46).
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

/// Settings of the loop closer, made from a [`Config`](crate::Config).
#[derive(Clone, Debug, PartialEq)]
pub struct LoopCloserSetup {
    /// Settings of loop closing.
    pub looping: LoopingConfig,
    /// Minimum number of landmarks to adjust a keyframe's pose in bundle adjustment.
    pub min_held: usize,
    /// Seed of all random choices.
    pub seed: u64,
    /// Scale factor between pyramid levels.
    pub scale_factor: f32,
}
