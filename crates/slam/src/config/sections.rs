//! The settings of the feature extractor that users can change.

use serde::{Deserialize, Serialize};
use stillpoint_features::OrbConfig;

/// Feature extraction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FeaturesConfig {
    /// Keypoints per image. Range: 100 to 10000. 1000 is common in comparable systems at 640x480: fewer lose accuracy,
    /// more cost time in every later stage.
    pub features: usize,
    /// FAST threshold, grey levels: how much brighter or darker than the centre the arc must be. Range: 1 to 254. 20 is
    /// above sensor noise; where it finds nothing, a quarter of it still finds corners on plain walls.
    pub fast_threshold: u8,
}

impl Default for FeaturesConfig {
    fn default() -> Self {
        let orb = OrbConfig::default();
        Self {
            features: orb.features,
            fast_threshold: orb.fast_threshold,
        }
    }
}

impl FeaturesConfig {
    /// The full extractor configuration, with the fixed values added.
    #[must_use]
    pub fn orb(&self) -> OrbConfig {
        OrbConfig {
            features: self.features,
            fast_threshold: self.fast_threshold,
            // The ratio of the defaults.
            fast_threshold_low: self.fast_threshold.div_ceil(4),
            // All maps share one pyramid, so that any two of them can be joined.
            ..OrbConfig::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derived_orb_config_matches_defaults_and_is_valid() {
        assert_eq!(FeaturesConfig::default().orb(), OrbConfig::default());
        // The lower threshold must be valid for every upper one.
        for fast_threshold in 1..=254 {
            let config = FeaturesConfig {
                fast_threshold,
                ..FeaturesConfig::default()
            };
            assert!(config.orb().problems().is_empty(), "{fast_threshold}");
        }
    }
}
