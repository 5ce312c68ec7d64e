//! Scores against a threshold. Nearly all values fail it, so logits are compared without computing the sigmoid.

#[derive(Clone, Copy, Debug)]
pub(super) struct Gate {
    threshold: f32,
    /// Minimum value of the network whose score may reach the threshold.
    least: f32,
    /// Whether values have been through the sigmoid.
    done: bool,
}

impl Gate {
    /// `done`: whether values have been through the sigmoid.
    pub(super) fn new(threshold: f32, done: bool) -> Self {
        let t = f64::from(threshold);
        // The margin exceeds the rounding of both sides; a sigmoid rounds to one from 17 on.
        let logit = (libm::log(t / (1.0 - t)) - 1e-3).min(16.0) as f32;
        Self {
            threshold,
            least: if done { threshold } else { logit },
            done,
        }
    }

    /// Whether a score with this factor may reach the threshold.
    #[inline]
    pub(super) fn may_pass(&self, value: f32) -> bool {
        value >= self.least
    }

    #[inline]
    pub(super) fn any(&self, values: &[f32]) -> bool {
        // Counting does not depend on order, so the loop vectorises.
        values
            .iter()
            .map(|&v| u32::from(v >= self.least))
            .sum::<u32>()
            > 0
    }

    pub(super) fn score(&self, value: f32) -> f32 {
        if self.done {
            value
        } else {
            sigmoid(value) as f32
        }
    }

    pub(super) fn passes(&self, score: f32) -> bool {
        score >= self.threshold
    }
}

pub(super) fn sigmoid(x: f32) -> f64 {
    1.0 / (1.0 + libm::exp(-f64::from(x)))
}

/// Index of the greatest value, the first of equal ones, and the value. NaN is skipped.
pub(super) fn best(values: impl Iterator<Item = f32>) -> Option<(usize, f32)> {
    let mut found: Option<(usize, f32)> = None;
    for (i, value) in values.enumerate() {
        if !value.is_nan() && found.is_none_or(|(_, best)| value > best) {
            found = Some((i, value));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The shortcut never rejects a passing score.
        #[test]
        fn threshold_shortcut_never_rejects_a_passing_score(value in -30_f32..30.0, threshold in 1e-3_f32..=1.0) {
            for done in [false, true] {
                let gate = Gate::new(threshold, done);
                prop_assert!(gate.may_pass(value) || !gate.passes(gate.score(value)));
                prop_assert_eq!(gate.any(&[-100.0, value]), gate.may_pass(value));
            }
        }
    }

    #[test]
    fn nan_never_passes_the_threshold() {
        let gate = Gate::new(0.25, false);
        assert!(!gate.may_pass(f32::NAN) && !gate.passes(f32::NAN));
        assert!((gate.score(0.0) - 0.5).abs() < 1e-9);
        assert_eq!(best([1.0, 3.0, 3.0, f32::NAN].into_iter()), Some((1, 3.0)));
        assert_eq!(best([f32::NAN, 1.0, 3.0].into_iter()), Some((2, 3.0)));
        assert_eq!(best(std::iter::empty()), None);
        assert_eq!(best(std::iter::once(f32::NAN)), None);
    }
}
