//! Distributes the configuration to the stages.

use super::Config;
use crate::looping::LoopCloserSetup;
use crate::mapping::MapperSetup;
use crate::static_filter::FilterSetup;
use crate::tracking::TrackerSetup;
use stillpoint_detection::ObjectsConfig;
use stillpoint_features::OrbConfig;

impl From<&Config> for TrackerSetup {
    fn from(config: &Config) -> Self {
        Self {
            tracking: config.tracking.clone(),
            keyframes: config.keyframes.clone(),
            features: config.features.orb(),
            sensor: config.sensor.clone(),
            filter: FilterSetup::from(config),
            seed: config.seed,
        }
    }
}

impl From<Config> for TrackerSetup {
    fn from(config: Config) -> Self {
        Self::from(&config)
    }
}

impl From<&Config> for FilterSetup {
    fn from(config: &Config) -> Self {
        Self {
            filter: config.static_filter.clone(),
            weights: config.motion_weights.clone(),
            objects: ObjectsConfig::default(),
            noise: config.sensor.noise(),
            seed: config.seed,
        }
    }
}

impl From<&Config> for MapperSetup {
    fn from(config: &Config) -> Self {
        let OrbConfig {
            levels,
            scale_factor,
            ..
        } = config.features.orb();
        Self {
            mapping: config.mapping.clone(),
            min_held: config.tracking.min_inliers,
            close_depth: config.sensor.close_depth,
            levels,
            scale_factor,
        }
    }
}

impl From<&Config> for LoopCloserSetup {
    fn from(config: &Config) -> Self {
        Self {
            looping: config.looping.clone(),
            min_held: config.tracking.min_inliers,
            seed: config.seed,
            scale_factor: config.features.orb().scale_factor,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_stages_share_the_depth_noise_model() {
        let mut config = Config::default();
        config.sensor.noise_scale = 3.0;
        let setup = TrackerSetup::from(&config);
        assert_eq!(setup.filter.noise, setup.sensor.noise());
        assert_eq!(setup.filter.noise, config.sensor.noise());
    }
}
