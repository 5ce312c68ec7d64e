//! Work per frame and keyframe, and its cost.
//!
//! Chooses counts (keypoints, neighbours, keyframes in bundle adjustment) that fit a given time. The inline driver uses
//! a fixed cost table, so that runs are reproducible on any machine; the live driver measures and logs its decisions.

use crate::config::Config;
use crate::mapping::MappingEffort;

/// Minimum number of keypoints per image in a plan: with fewer, too few static ones remain when people enter the image,
/// before tracking can ask for more (docs/decisions/0017).
pub const MIN_FEATURES: u32 = 500;
/// Minimum number of neighbours of a keyframe in a plan: chosen, so that landmarks are still made and fused across more
/// than one pair of keyframes. Local bundle adjustment has at least these and the new one.
const MIN_NEIGHBOURS: u32 = 2;

impl MappingEffort {
    /// The configured effort.
    #[must_use]
    pub fn of(config: &Config) -> Self {
        config.mapping.effort()
    }

    /// The effort while `waiting` other keyframes are queued: an equal share, but at least the minimum that keeps the
    /// map connected.
    #[must_use]
    pub fn shared(self, waiting: usize) -> Self {
        let share = |all: u32, least: u32| {
            let parts = u32::try_from(waiting).unwrap_or(u32::MAX).saturating_add(1);
            all.div_ceil(parts).max(least.min(all))
        };
        Self {
            neighbours: share(self.neighbours, MIN_NEIGHBOURS),
            window: share(self.window, MIN_NEIGHBOURS + 1),
        }
    }
}

/// Cost of the work, ms of one thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostTable {
    /// Tracking a frame, independent of its number of keypoints: pyramid, corners, segments.
    pub frame: f64,
    /// Per keypoint: description, flow, filter, matching, pose.
    pub feature: f64,
    /// Mapping a keyframe, without neighbours and adjustment.
    pub keyframe: f64,
    /// Per neighbour of a keyframe.
    pub neighbour: f64,
    /// Local bundle adjustment, per free keyframe.
    pub window: f64,
    /// Keyframes per frame in scenes with people walking.
    pub keyframe_share: f64,
    /// Detection in one image.
    pub detection: f64,
}

impl CostTable {
    /// Time of OpenCV's ORB with 1000 features on the machine of [`Self::REFERENCE`], ms: measured with one thread on
    /// the two-core x86-64 server of that table.
    pub const REFERENCE_UNIT_MS: f64 = 8.0;

    /// Medians of `stillpoint run` with 500 and 1000 features, and with windows of 4 to 20 keyframes and 4 and 10
    /// neighbours, on a two-core x86-64 server on which OpenCV's ORB (1000 features, one thread) takes 8 ms.
    pub const REFERENCE: Self = Self {
        frame: 5.5,
        feature: 0.0055,
        keyframe: 2.0,
        neighbour: 0.3,
        window: 0.25,
        keyframe_share: 0.2,
        detection: 52.0,
    };

    /// Mean time per frame, ms: tracking plus the frame's share of mapping.
    #[must_use]
    pub fn per_frame(&self, features: u32, mapping: MappingEffort) -> f64 {
        let keyframe = self.keyframe
            + self.neighbour * f64::from(mapping.neighbours)
            + self.window * f64::from(mapping.window);
        self.frame + self.feature * f64::from(features) + self.keyframe_share * keyframe
    }
}

/// Counts that fit a time budget.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Keypoints per image; tracking asks for more when few are matched to the map.
    pub features: u32,
    /// Work per keyframe.
    pub mapping: MappingEffort,
    /// The detector processes every n-th frame.
    pub detector_stride: u32,
    /// Estimated cost per frame, ms, without detection, which runs in its own thread.
    pub per_frame_ms: f64,
    /// Whether the budget is met; false if even the minimum exceeds it.
    pub fits: bool,
}

impl Plan {
    /// The most work, up to the configured one, that fits into `budget_ms` per frame. Tracking and mapping are reduced
    /// by the same share; the detector stride keeps its mean cost within the budget.
    #[must_use]
    pub fn new(config: &Config, budget_ms: f64, costs: &CostTable) -> Self {
        let most = MappingEffort::of(config);
        let at = |percent: u32| {
            let between = |least: u32, most: u32| {
                let least = least.min(most);
                least + (most - least) * percent / 100
            };
            let features = between(MIN_FEATURES, config.features.features as u32);
            let mapping = MappingEffort {
                neighbours: between(MIN_NEIGHBOURS, most.neighbours),
                window: between(MIN_NEIGHBOURS + 1, most.window),
            };
            (features, mapping, costs.per_frame(features, mapping))
        };
        let percent = (0..=100).rev().find(|p| at(*p).2 <= budget_ms);
        let (features, mapping, per_frame_ms) = at(percent.unwrap_or(0));
        // The cast saturates for zero and negative budgets.
        let stride = libm::ceil(costs.detection / budget_ms.max(1e-3)) as u32;
        Self {
            features,
            mapping,
            detector_stride: stride.clamp(1, 100).max(config.detector.stride),
            per_frame_ms,
            fits: percent.is_some(),
        }
    }

    /// The configuration with the counts of this plan.
    #[must_use]
    pub fn apply(&self, config: &Config) -> Config {
        let mut config = config.clone();
        config.features.features = self.features as usize;
        config.mapping.neighbours = self.mapping.neighbours as usize;
        config.mapping.window = self.mapping.window as usize;
        config.detector.stride = self.detector_stride;
        config
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn ample_budget_keeps_the_full_configuration() {
        let config = Config::default();
        let plan = Plan::new(&config, 1e4, &CostTable::REFERENCE);
        assert!(plan.fits);
        assert_eq!(plan.apply(&config), config);
    }

    #[test]
    fn zero_budget_gives_minimum_effort_that_does_not_fit() {
        let config = Config::default();
        for budget in [0.0, -1.0, f64::NAN] {
            let plan = Plan::new(&config, budget, &CostTable::REFERENCE);
            assert!(!plan.fits, "{budget}");
            assert_eq!(plan.features, MIN_FEATURES);
            assert_eq!(plan.detector_stride, 100);
            let least = plan.apply(&config);
            assert!(least.validate().is_ok());
        }
    }

    proptest! {
        #[test]
        fn plan_fits_its_budget_and_effort_grows_with_it(budget in 1.0..60.0_f64, more in 0.0..30.0_f64) {
            let config = Config::default();
            let plan = |ms| Plan::new(&config, ms, &CostTable::REFERENCE);
            let (tight, wide) = (plan(budget), plan(budget + more));
            prop_assert!(!tight.fits || tight.per_frame_ms <= budget);
            prop_assert!(tight.features <= wide.features && wide.features <= 1000);
            prop_assert!(tight.mapping.neighbours <= wide.mapping.neighbours);
            prop_assert!(tight.mapping.window <= wide.mapping.window);
            prop_assert!(tight.detector_stride >= wide.detector_stride);
            prop_assert!(tight.apply(&config).validate().is_ok());
        }

        #[test]
        fn mapping_effort_falls_with_queue_length(waiting in 0..100_usize, neighbours in 0..100_u32, window in 1..100_u32) {
            let all = MappingEffort { neighbours, window };
            let (some, less) = (all.shared(waiting), all.shared(waiting + 1));
            prop_assert_eq!(all.shared(0), all);
            prop_assert!(less.neighbours <= some.neighbours && less.window <= some.window);
            prop_assert!(less.neighbours >= neighbours.min(MIN_NEIGHBOURS) && less.window >= window.min(MIN_NEIGHBOURS + 1));
        }
    }
}
