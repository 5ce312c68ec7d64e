//! How loops are closed.

use crate::validation::Checker;
use serde::{Deserialize, Serialize};

/// How loops are closed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LoopingConfig {
    /// Whether loops are closed at all.
    pub enabled: bool,
    /// The newest keyframes, so many, are no candidates, and so many pass between two closed loops. Range: 1 to 1000. What
    /// was seen just now needs no loop.
    pub min_gap: usize,
    /// A place must be recognised by so many keyframes in a row. Range: 1 to 10. One alone may be a coincidence.
    pub consistency: u32,
    /// Points of both keyframes that agree on one rigid motion, at least. Range: 10 to 1000. Fewer agree by chance.
    pub min_rigid_inliers: usize,
    /// Landmarks around the older keyframe that are seen where that motion puts them, at least. Range: 10 to 1000.
    pub min_inliers: usize,
    /// What a loop may cost the pose graph: squared Mahalanobis distance to what the map can have drifted. Range: 6 to 10000.
    /// Beyond that the two places are equal, not the same.
    pub max_cost: f64,
}

impl Default for LoopingConfig {
    fn default() -> Self {
        // Those of ORB-SLAM2 (Mur-Artal, Tardos 2017), but for what a loop may cost, which it does not ask.
        Self {
            enabled: true,
            min_gap: 10,
            consistency: 3,
            min_rigid_inliers: 20,
            min_inliers: 40,
            max_cost: 50.0,
        }
    }
}

impl LoopingConfig {
    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("min_gap", self.min_gap as f64, 1.0, 1e3);
        c.range("consistency", f64::from(self.consistency), 1.0, 10.0);
        c.range(
            "min_rigid_inliers",
            self.min_rigid_inliers as f64,
            10.0,
            1e3,
        );
        c.range("min_inliers", self.min_inliers as f64, 10.0, 1e3);
        c.range("max_cost", self.max_cost, 6.0, 1e4);
    }
}

/// What of the configuration concerns the looper: made from a [`Config`](crate::Config).
#[derive(Clone, Debug, PartialEq)]
pub struct LooperSetup {
    /// How loops are closed.
    pub looping: LoopingConfig,
    /// Seed of every random choice.
    pub seed: u64,
    /// Factor between two levels of the features' pyramid.
    pub scale_factor: f32,
}
