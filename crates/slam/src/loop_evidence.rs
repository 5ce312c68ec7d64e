//! Evidence for a loop: the terms of its log odds.

use libm::{exp, log};

/// Prior odds that a candidate is the same place and not an identical-looking one. Assumed, not measured: one place in
/// a thousand has an equal. Matters only if the map has no expectation of where the place is.
const PRIOR_EQUAL: f64 = 1000.0;

/// Evidence that a keyframe shows the place of an older one: natural logarithms of likelihood ratios, positive if in
/// favour.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoopEvidence {
    /// Prior of this kind of candidate.
    pub prior: f64,
    /// How distinctive the place looks compared with the rest of the map.
    pub looks: f64,
    /// Share of expected landmarks that are found.
    pub landmarks: f64,
    /// Other keyframes that agree.
    pub witnesses: f64,
    /// How near the place lies to where the map expects it, compared with anywhere in the map.
    pub place: f64,
}

impl LoopEvidence {
    /// Natural logarithm of the odds that it is the same place, neither similar by chance nor an equal place elsewhere.
    #[must_use]
    pub fn log_odds(&self) -> f64 {
        let all = self.prior + self.looks + self.landmarks + self.witnesses + self.place;
        -log_sum([-all, -self.against_equal()])
    }

    /// Whether the place is too far from its expected position for any other evidence to reach these odds.
    pub(crate) fn is_elsewhere(&self, least_log_odds: f64) -> bool {
        self.place < 0.0 && self.against_equal() < least_log_odds
    }

    /// Log odds against an equal place, which differs only in position.
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
