//! The evidence for a loop: the parts of its odds, as the loop closer finds them and as reports carry them.

use libm::{exp, log};

/// Prior odds that a candidate is the same place and not an equal one. Assumed, not measured: one place in a thousand has an equal. It only matters where
/// the map does not know where to expect the place.
const PRIOR_EQUAL: f64 = 1000.0;

/// What speaks for it that a keyframe shows the place of an older one: natural logarithms of likelihood ratios, positive ones for it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoopEvidence {
    /// How often a candidate of its kind is the same place.
    pub prior: f64,
    /// How unlike the rest of the map the place looks.
    pub looks: f64,
    /// Share of landmarks that are found where they should be.
    pub landmarks: f64,
    /// Other keyframes that tell the same.
    pub witnesses: f64,
    /// How near the place lies to where the map expects it, compared with anywhere on the map.
    pub place: f64,
}

impl LoopEvidence {
    /// Natural logarithm of the odds that it is the same place, neither alike by chance nor equal to it.
    #[must_use]
    pub fn log_odds(&self) -> f64 {
        let all = self.prior + self.looks + self.landmarks + self.witnesses + self.place;
        -log_sum([-all, -self.against_equal()])
    }

    /// Whether the place lies so far from where the map expects it that no other evidence could reach these odds.
    pub(crate) fn is_elsewhere(&self, least_log_odds: f64) -> bool {
        self.place < 0.0 && self.against_equal() < least_log_odds
    }

    /// Log odds against an equal place: it differs only in where it lies.
    fn against_equal(&self) -> f64 {
        log(PRIOR_EQUAL) + self.place
    }
}

/// Logarithm of a sum, from the logarithms of its terms.
pub(crate) fn log_sum<const N: usize>(logs: [f64; N]) -> f64 {
    let most = logs.into_iter().fold(f64::NEG_INFINITY, f64::max);
    if !most.is_finite() {
        return most;
    }
    most + log(logs.into_iter().map(|l| exp(l - most)).sum::<f64>())
}
