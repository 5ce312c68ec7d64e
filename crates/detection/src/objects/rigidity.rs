//! Decides over time, with hysteresis, whether an object is static.

use super::common::STEP;
use serde::{Deserialize, Serialize};

/// Motion state of an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Motion {
    /// Too few measurements.
    #[default]
    Unknown,
    /// It moves, or has been static for a short time only.
    Moving,
    /// It has been static for [`crate::ObjectsConfig::parked_seconds`].
    Parked,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Rigidity {
    motion: Motion,
    /// Smoothed share of agreeing features, with its stamp, s.
    share: Option<(f64, f64)>,
    /// Start of the present high share, s.
    still_since: Option<f64>,
}

/// Minimum number of tested features: the standard deviation of a share of five is 22 %.
const LEAST_TESTED: u32 = 5;
/// Smoothed share of static features below which an object moves (section 14 of docs/algorithm.md).
const MOVING: f64 = 0.6;

impl Rigidity {
    pub(super) fn motion(&self) -> Motion {
        self.motion
    }

    /// Adds the count of one frame. Ignores old stamps and too few features.
    pub(super) fn observe(
        &mut self,
        stamp: f64,
        [agreeing, tested]: [u32; 2],
        parked_share: f64,
        parked_seconds: f64,
    ) {
        if tested < LEAST_TESTED || !stamp.is_finite() {
            return;
        }
        let now = f64::from(agreeing.min(tested)) / f64::from(tested);
        let share = match self.share {
            Some((_, last)) if stamp <= last => return,
            Some((old, last)) => now + (old - now) * libm::exp((last - stamp) / STEP),
            None => now,
        };
        self.share = Some((share, stamp));
        if share < parked_share {
            self.still_since = None;
        } else if self.still_since.is_none() {
            self.still_since = Some(stamp);
        }
        // Swinging parts are averaged over a step, but a moving object must be detected quickly.
        let broken = now < MOVING / 2.0 && tested >= 2 * LEAST_TESTED;
        if share < MOVING || broken {
            self.motion = Motion::Moving;
            self.still_since = None;
        } else if self
            .still_since
            .is_some_and(|s| stamp - s >= parked_seconds)
        {
            self.motion = Motion::Parked;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(rigidity: &mut Rigidity, from: f64, frames: u32, count: [u32; 2]) -> Motion {
        for i in 0..frames {
            rigidity.observe(from + f64::from(i) / 30.0, count, 0.8, 2.0);
        }
        rigidity.motion()
    }

    #[test]
    fn object_parks_only_after_the_required_time() {
        let mut r = Rigidity::default();
        assert_eq!(run(&mut r, 0.0, 59, [19, 20]), Motion::Unknown);
        assert_eq!(run(&mut r, 2.0, 3, [19, 20]), Motion::Parked);
    }

    #[test]
    fn brief_partial_motion_keeps_parked_a_step_does_not() {
        let mut r = Rigidity::default();
        run(&mut r, 0.0, 90, [20, 20]);
        assert_eq!(run(&mut r, 3.1, 2, [12, 20]), Motion::Parked);
        assert_eq!(run(&mut r, 3.2, 20, [20, 20]), Motion::Parked);
        assert_eq!(run(&mut r, 4.0, 1, [2, 20]), Motion::Moving);
        assert_eq!(run(&mut r, 4.1, 45, [20, 20]), Motion::Moving);
        assert_eq!(run(&mut r, 5.7, 60, [20, 20]), Motion::Parked);
    }

    #[test]
    fn few_features_and_old_stamps_are_ignored() {
        let mut r = Rigidity::default();
        assert_eq!(run(&mut r, 0.0, 90, [4, 4]), Motion::Unknown);
        assert_eq!(run(&mut r, 5.0, 20, [0, 20]), Motion::Moving);
        let before = r.clone();
        run(&mut r, 0.0, 90, [20, 20]);
        assert_eq!(r, before);
    }

    #[test]
    fn share_within_the_hysteresis_changes_nothing() {
        for (count, first) in [([0, 20], Motion::Moving), ([20, 20], Motion::Parked)] {
            let mut r = Rigidity::default();
            assert_eq!(run(&mut r, 0.0, 90, count), first);
            assert_eq!(run(&mut r, 3.0, 1, [15, 20]), first);
            for _ in 0..3 {
                assert_eq!(run(&mut r, 3.1, 200, [15, 20]), first);
            }
        }
    }
}
