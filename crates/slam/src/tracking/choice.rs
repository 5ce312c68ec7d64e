//! Chooses between two motion hypotheses from flow when a sensor constrains the motion.

use stillpoint_geometry::{Mat6, Se3};

/// Share of the weight, of the pairs, or of the free vote's weight that counts as nearly all. Chosen: people filled
/// nine tenths of the view in the scenes of decision 39. A motion on which nearly all agree is accepted unless a gyroscope
/// contradicts it or a person may fill the view. While a sensor may not decide, the vote bound to it needs nearly the
/// weight of the free one: any rotation fits the flow of a near person with a suitable translation. With half of the
/// weight badly mounted wheels cost 56 and 177 mm at worst (decision 41), and such a gyroscope 70 and 111 mm.
pub(super) const PLAIN_SHARE: f64 = 0.9;

/// A camera motion from a flow vote.
#[derive(Clone, Debug)]
pub(super) struct Vote {
    pub(super) camera_from_world: Se3,
    /// Whether it was judged sharply: then it takes precedence over matches by descriptor.
    pub(super) exact: bool,
    pub(super) agreed: usize,
    pub(super) voted: usize,
    /// Inverse covariance of the motion, as that of the pose.
    pub(super) information: Mat6,
    /// Agreeing share of the weight.
    pub(super) share: f64,
    /// Whether the motion is bound to the sensors.
    pub(super) is_bound: bool,
}

impl Vote {
    /// Whether nearly all pairs agree, by weight and by number, including those on surfaces that moved before.
    pub(super) fn is_of_nearly_all(&self) -> bool {
        self.share >= PLAIN_SHARE && self.agreed as f64 >= PLAIN_SHARE * self.voted as f64
    }
}

/// The choice between the unconstrained vote and the vote bound to the sensor's motion.
pub(super) struct Choice {
    pub(super) vote: Option<Vote>,
    /// Whether the majority of the image contradicts the sensor.
    pub(super) against: bool,
}

impl Choice {
    /// Takes the bound vote, unless most of the image contradicts it and the sensor does not decide (`rules`).
    /// `agrees`: whether the free vote moves as the sensor does.
    pub(super) fn between(
        free: Option<Vote>,
        bound: Option<Vote>,
        agrees: bool,
        rules: bool,
    ) -> Self {
        if agrees {
            // Both describe the same motion; the bound one is more accurate.
            return Self {
                vote: bound.or(free),
                against: false,
            };
        }
        let share = |vote: &Option<Vote>| vote.as_ref().map_or(0.0, |v| v.share);
        let weak = share(&bound) < PLAIN_SHARE * share(&free);
        // If nearly all features agree on the free motion, not just those with weight, there is no static background
        // beside a crowd for an unproven sensor to reveal.
        let is_alone = free.as_ref().is_some_and(Vote::is_of_nearly_all);
        let vote = match rules || !(weak || is_alone) {
            // Matches by descriptor must not overrule the choice.
            true => bound.map(|v| Vote { exact: true, ..v }),
            false => free,
        };
        Self {
            vote,
            against: true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vote(share: f64, is_bound: bool) -> Option<Vote> {
        Some(Vote {
            camera_from_world: Se3::identity(),
            exact: false,
            agreed: (200.0 * share) as usize,
            voted: 200,
            information: Mat6::identity(),
            share,
            is_bound,
        })
    }

    #[test]
    fn unconfirmed_sensor_needs_nearly_equal_support() {
        let takes_bound = |share: f64, rules: bool| {
            let choice = Choice::between(vote(0.8, false), vote(share, true), false, rules);
            assert!(choice.against);
            choice.vote.unwrap().is_bound
        };
        // A person in a crowd moves as a badly mounted sensor predicts.
        assert!(!takes_bound(0.5, false) && !takes_bound(0.7, false));
        assert!(takes_bound(0.75, false));
        // A proven sensor decides regardless of the weights.
        assert!(takes_bound(0.2, true));
        // Nearly all features agree, so the bound vote is not taken.
        let alone = Choice::between(vote(0.95, false), vote(0.9, true), false, false);
        assert!(!alone.vote.unwrap().is_bound);
    }

    #[test]
    fn agreeing_motions_choose_the_bound_vote() {
        let both = Choice::between(vote(0.8, false), vote(0.6, true), true, false);
        assert!(both.vote.unwrap().is_bound && !both.against);
        let free = Choice::between(vote(0.8, false), None, true, true);
        assert!(!free.vote.unwrap().is_bound);
    }
}
