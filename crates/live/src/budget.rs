//! Keeps a time budget per frame by adapting the number of keypoints and the detector's share of the time.

use stillpoint_slam::MIN_FEATURES;

/// Number of frames between adaptations: half a second at 30 Hz.
const ROUND: usize = 15;
/// Share of the limit below which more work is allowed.
const ROOM: f64 = 0.8;
/// Minimum share of the time for the detector: one part in this many.
const MOST_RARELY: u64 = 8;

#[derive(Clone, Debug)]
pub(crate) struct Budget {
    limit: f64,
    most: u32,
    features: u32,
    /// Reciprocal of the detector's share of the time.
    rarer: u64,
    /// Frame times since the last adaptation, s.
    round: Vec<f64>,
}

impl Budget {
    /// A budget of `limit` s per frame, with at most, and initially, `most` keypoints.
    pub(crate) fn new(limit: f64, most: u32) -> Self {
        Self {
            limit,
            most,
            features: most,
            rarer: 1,
            round: Vec::with_capacity(ROUND),
        }
    }

    /// Reciprocal of the detector's share of the time.
    pub(crate) fn rarer(&self) -> u64 {
        self.rarer
    }

    /// Records a frame time, s. Returns the number of keypoints when it changes.
    pub(crate) fn observe(&mut self, took: f64) -> Option<u32> {
        self.round.push(took);
        if self.round.len() < ROUND {
            return None;
        }
        self.round.sort_unstable_by(f64::total_cmp);
        // The second longest, so that a single disturbed frame has no effect.
        let took = self.round[ROUND - 2];
        self.round.clear();
        let least = MIN_FEATURES.min(self.most);
        let ratio = self.limit / took.max(1e-6);
        let factor = if ratio < 1.0 {
            ratio.max(0.7)
        } else if ratio * ROOM > 1.0 {
            (ratio * ROOM).min(1.1)
        } else {
            1.0
        };
        let wanted = f64::from(self.features) * factor;
        let features = (wanted.round() as u32).clamp(least, self.most);
        if ratio < 1.0 && self.features == least {
            self.rarer = (2 * self.rarer).min(MOST_RARELY);
        } else if factor > 1.0 {
            self.rarer = (self.rarer / 2).max(1);
        }
        let changes = features != self.features;
        self.features = features;
        changes.then_some(features)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames on a machine that needs `fixed` s and `each` s per keypoint: the final number of keypoints, and the reciprocal detector
    /// share.
    fn settle(budget: &mut Budget, fixed: f64, each: f64) -> (u32, u64) {
        for _ in 0..50 * ROUND {
            budget.observe(fixed + each * f64::from(budget.features));
        }
        (budget.features, budget.rarer)
    }

    #[test]
    fn budget_keeps_full_effort_if_fast_and_reduces_if_slow() {
        let mut budget = Budget::new(0.010, 1000);
        assert_eq!(settle(&mut budget, 0.002, 1e-6), (1000, 1));
        let (features, rarer) = settle(&mut budget, 0.004, 12e-6);
        let took = 0.004 + 12e-6 * f64::from(features);
        assert!(took <= 0.010 && took > ROOM * 0.010 / 1.1, "{took} s");
        assert_eq!(rarer, 1);
        // Nothing fits: the minimum is used.
        let least = settle(&mut budget, 0.012, 12e-6);
        assert_eq!(least, (MIN_FEATURES, MOST_RARELY));
        // It recovers when there is time again.
        assert_eq!(settle(&mut budget, 0.002, 1e-6), (1000, 1));
    }

    #[test]
    fn single_slow_frame_does_not_change_the_budget() {
        let mut budget = Budget::new(0.010, 1000);
        for i in 0..10 * ROUND {
            let took = if i % ROUND == 3 { 1.0 } else { 0.009 };
            assert_eq!(budget.observe(took), None);
        }
    }

    #[test]
    fn keypoints_below_the_minimum_are_not_reduced() {
        let mut budget = Budget::new(0.001, 200);
        assert_eq!(settle(&mut budget, 0.004, 12e-6).0, 200);
    }
}
