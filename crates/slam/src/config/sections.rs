//! Sections of the configuration that say of a crate below only what is worth setting; all else there is fixed, with its reason.

use serde::{Deserialize, Serialize};
use stillpoint_detection::ObjectsConfig;
use stillpoint_features::OrbConfig;

/// Feature extraction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FeaturesConfig {
    /// Keypoints wanted per image. Range: 100 to 10000. 1000 is what the peers use at 640x480: fewer lose accuracy, more cost time in
    /// every later stage.
    pub features: usize,
    /// Levels of the image pyramid. Range: 1 to 16. Eight levels of 1.2 cover a change of distance by 3.6.
    pub levels: usize,
    /// Ratio of the sizes of adjacent levels. Range: 1.05 to 2. With 1.2 a corner is found again at the next level, whatever its scale.
    pub scale_factor: f32,
    /// FAST threshold, grey levels: how much brighter or darker than the centre the arc must be. Range: 1 to 254. 20 keeps clear of
    /// sensor noise; where that finds nothing, about a third of it still finds corners on plain walls.
    pub fast_threshold: u8,
}

impl Default for FeaturesConfig {
    fn default() -> Self {
        let orb = OrbConfig::default();
        Self {
            features: orb.features,
            levels: orb.levels,
            scale_factor: orb.scale_factor,
            fast_threshold: orb.fast_threshold,
        }
    }
}

impl FeaturesConfig {
    /// The extractor's whole configuration: these fields, and what is fixed.
    #[must_use]
    pub fn orb(&self) -> OrbConfig {
        OrbConfig {
            features: self.features,
            levels: self.levels,
            scale_factor: self.scale_factor,
            fast_threshold: self.fast_threshold,
            // 7 of 20, as in ORB-SLAM2 (Mur-Artal, Tardos 2017).
            fast_threshold_low: (u16::from(self.fast_threshold) * 7).div_ceil(20) as u8,
            subpixel: true,
        }
    }
}

/// Objects that a detector sees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ObjectTrackingConfig {
    /// How long a confirmed object lives on without a detection, s. Range: 0.1 to 10. Small networks miss a walking person for up to 25
    /// frames of 30 per second; beyond 1.5 s the prediction says little.
    pub coast_seconds: f64,
    /// How long an object must stand still to be parked, s. Range: 0.1 to 60. A walker who turns round stands still for about a second.
    pub parked_seconds: f64,
}

impl Default for ObjectTrackingConfig {
    fn default() -> Self {
        let objects = ObjectsConfig::default();
        Self {
            coast_seconds: objects.coast_seconds,
            parked_seconds: objects.parked_seconds,
        }
    }
}

impl ObjectTrackingConfig {
    /// The object tracker's whole configuration: these fields, and what is fixed.
    #[must_use]
    pub fn objects(&self) -> ObjectsConfig {
        ObjectsConfig {
            coast_seconds: self.coast_seconds,
            parked_seconds: self.parked_seconds,
            ..ObjectsConfig::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_derived_is_what_the_crates_below_default_to() {
        assert_eq!(FeaturesConfig::default().orb(), OrbConfig::default());
        let objects = ObjectTrackingConfig::default().objects();
        assert_eq!(objects, ObjectsConfig::default());
        // The lower threshold is one, and below the upper.
        for fast_threshold in 1..=254 {
            let config = FeaturesConfig {
                fast_threshold,
                ..FeaturesConfig::default()
            };
            assert!(config.orb().problems().is_empty(), "{fast_threshold}");
        }
    }
}
