//! Which of two votes of the flow is the camera's, where a sensor beside it knows how it moved.

use super::vote::Vote;

/// Which of two votes is the camera's: that of any motion, and that of motions which a sensor allows.
pub(super) struct Choice {
    pub(super) vote: Option<Vote>,
    /// Whether what most of the image agrees on moves otherwise.
    pub(super) against: bool,
}

/// A vote of motions that a sensor allows counts where at least this share of the other one's weight agrees with it, while it is not for the sensor to say which motion is the camera's.
/// Somebody near moves, with a shift of his own, as nearly any turn says: what turns as a gyroscope does speaks little for it ...
const TURNING_SHARE: f64 = 0.9;
/// ... and what moves and turns as wheels do more.
const MOVING_SHARE: f64 = 0.5;

impl Choice {
    /// Takes the bound vote unless most of what is seen says otherwise and the sensor does not rule. `agrees`: whether the free one moves as the sensor
    /// says, which is a gyroscope or not.
    pub(super) fn between(
        free: Option<Vote>,
        bound: Option<Vote>,
        agrees: bool,
        rules: bool,
        by_gyro: bool,
    ) -> Self {
        if agrees {
            // Both are about the same motion, and the bound one is the more exact.
            return Self {
                vote: bound.or(free),
                against: false,
            };
        }
        let share = |vote: &Option<Vote>| vote.as_ref().map_or(0.0, |v| v.share);
        let least = if by_gyro { TURNING_SHARE } else { MOVING_SHARE };
        let weak = share(&bound) < least * share(&free);
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
