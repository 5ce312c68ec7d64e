//! Which of two votes of the flow is the camera's, where a sensor beside it knows how it moved.

use super::vote::Vote;

/// Which of two votes is the camera's: that of any motion, and that of motions which a sensor allows.
pub(super) struct Choice {
    pub(super) vote: Option<Vote>,
    /// Whether what most of the image agrees on moves otherwise.
    pub(super) against: bool,
}

/// A vote of motions that a sensor allows counts where at least this share of the other one's weight agrees with it, while it is not for the sensor
/// to say which motion is the camera's. Somebody near moves, with a shift of his own, as nearly any turn says, and in a crowd somebody moves as
/// wrongly mounted wheels say: with half of the weight these cost 56 and 177 mm at worst (decision 41), and scenes with such a gyroscope had 70 and
/// 111 mm (decision 39).
const SENSOR_SHARE: f64 = 0.9;

impl Choice {
    /// Takes the bound vote unless most of what is seen says otherwise and the sensor does not rule. `agrees`: whether the free one moves as the sensor
    /// says.
    pub(super) fn between(
        free: Option<Vote>,
        bound: Option<Vote>,
        agrees: bool,
        rules: bool,
    ) -> Self {
        if agrees {
            // Both are about the same motion, and the bound one is the more exact.
            return Self {
                vote: bound.or(free),
                against: false,
            };
        }
        let share = |vote: &Option<Vote>| vote.as_ref().map_or(0.0, |v| v.share);
        let weak = share(&bound) < SENSOR_SHARE * share(&free);
        // Where nobody moves otherwise, and not only because those who do have no say any more, there is no room beside a crowd that a sensor
        // could speak for before it has ever proved right.
        let is_alone = free.as_ref().is_some_and(Vote::is_of_nearly_all);
        let vote = match rules || !(weak || is_alone) {
            // Which of the two it is, is not for matches by descriptor to say.
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
    use stillpoint_geometry::{Mat6, Se3};

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
    fn a_sensor_that_nothing_has_confirmed_needs_nearly_as_much_for_it_as_the_other_motion_has() {
        let takes_bound = |share: f64, rules: bool| {
            let choice = Choice::between(vote(0.8, false), vote(share, true), false, rules);
            assert!(choice.against);
            choice.vote.unwrap().is_bound
        };
        // Somebody in a crowd moves as a wrongly mounted sensor says.
        assert!(!takes_bound(0.5, false) && !takes_bound(0.7, false));
        assert!(takes_bound(0.75, false));
        // One that has proved right says which motion is the camera's, whatever speaks for the other.
        assert!(takes_bound(0.2, true));
        // Where nobody moves otherwise there is no room beside a crowd that it could speak for.
        let alone = Choice::between(vote(0.95, false), vote(0.9, true), false, false);
        assert!(!alone.vote.unwrap().is_bound);
    }

    #[test]
    fn of_one_motion_the_bound_vote_is_the_more_exact() {
        let both = Choice::between(vote(0.8, false), vote(0.6, true), true, false);
        assert!(both.vote.unwrap().is_bound && !both.against);
        let free = Choice::between(vote(0.8, false), None, true, true);
        assert!(!free.vote.unwrap().is_bound);
    }
}
