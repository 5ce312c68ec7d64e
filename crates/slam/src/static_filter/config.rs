//! What the static filter can be told.

use crate::sensor::DepthNoise;
use crate::validation::Checker;
use serde::{Deserialize, Serialize};
use stillpoint_detection::{MotionWeights, ObjectsConfig};

/// Which strategy rejects features.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// Every feature counts as static.
    Off,
    /// Objects, epipolar constraint and depth, fused as published.
    Paper,
    /// Log odds per depth-connected region from objects, free space, flow and the past.
    #[default]
    Default,
}

/// Rejection of what moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StaticFilterConfig {
    /// Strategy: "off", "paper" (objects, epipolar constraint and depth as published) or "default".
    pub preset: Preset,
    /// Uses objects (O). Range: true or false.
    pub objects: bool,
    /// Uses flow between frames (G): the epipolar constraint, and in preset "default" the rigid test. Range: true or false.
    pub geometry: bool,
    /// Uses depth within boxes (D): in preset "paper" splits a box into object and background, in preset "default" gives an
    /// object a range of depth, without which all that is in its box is the object. Range: true or false.
    pub depth: bool,
    /// Fewer static features than this starve tracking: the least risky dynamic ones are released. Range: 0 to 1000.
    pub min_features: usize,
}

impl Default for StaticFilterConfig {
    fn default() -> Self {
        Self {
            preset: Preset::Default,
            objects: true,
            geometry: true,
            depth: true,
            min_features: 80,
        }
    }
}

impl StaticFilterConfig {
    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("min_features", self.min_features as f64, 0.0, 1000.0);
    }
}

/// What of the configuration concerns the static filter: made from a [`Config`](crate::Config).
#[derive(Clone, Debug, PartialEq)]
pub struct FilterSetup {
    /// Which strategy rejects features.
    pub filter: StaticFilterConfig,
    /// How likely each class is to move.
    pub weights: MotionWeights,
    /// How objects are tracked.
    pub objects: ObjectsConfig,
    /// The depth sensor's noise.
    pub noise: DepthNoise,
    /// Seed of every random choice.
    pub seed: u64,
}
