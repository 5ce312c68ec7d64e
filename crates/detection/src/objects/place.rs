//! Reported position of an object: follows the filter's state with limited speed.

use super::lost::NEAR;
use super::spatial::FASTEST;
use stillpoint_geometry::Vec3;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Place {
    /// Position at the last update, m, and its stamp, s; `None` while it has no depth.
    last: Option<(Vec3, f64)>,
    /// Offset of the state's position from it, m.
    lag: Vec3,
    /// Whether the last update moved it by at most a step.
    steady: bool,
    /// Whether the next position is accepted at any distance.
    anew: bool,
}

impl Default for Place {
    fn default() -> Self {
        Self {
            last: None,
            lag: Vec3::zeros(),
            steady: true,
            anew: false,
        }
    }
}

impl Place {
    /// Follows the state's position `at` to the time `stamp`. A larger jump than a step indicates another surface or
    /// track: the object is unsteady in this update.
    pub(super) fn follow(&mut self, at: Option<Vec3>, stamp: f64) {
        let anew = std::mem::take(&mut self.anew);
        self.steady = !anew;
        self.lag = Vec3::zeros();
        let Some(at) = at else {
            self.last = None;
            return;
        };
        if let Some((was, when)) = self.last.filter(|_| !anew) {
            let (way, most) = (at - was, FASTEST * (stamp - when));
            let excess = way.norm() - most;
            if excess > NEAR {
                self.steady = false;
            } else if excess > 0.0 {
                self.lag = way * (excess / way.norm());
            }
        }
        self.last = Some((at - self.lag, stamp));
    }

    /// The object was re-identified, and its path to this position is unknown.
    pub(super) fn begin_anew(&mut self) {
        self.anew = true;
    }

    pub(super) fn is_steady(&self) -> bool {
        self.steady
    }

    pub(super) fn lag(&self) -> Vec3 {
        self.lag
    }

    /// Stamp of the last update with a position, s.
    pub(super) fn stamp(&self) -> Option<f64> {
        self.last.map(|(_, stamp)| stamp)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Time between frames at 30 Hz, s.
    const FRAME: f64 = 1.0 / 30.0;

    /// Reported positions and steadiness, frame by frame, for a sequence of state positions along x.
    fn reported(states: &[f64], place: &mut Place) -> Vec<(f64, bool)> {
        let follow = |(n, x): (usize, &f64)| {
            place.follow(Some(Vec3::new(*x, 0.0, 0.0)), n as f64 * FRAME);
            (x - place.lag().x, place.is_steady())
        };
        states.iter().enumerate().map(follow).collect()
    }

    #[test]
    fn walking_object_is_reported_at_its_state() {
        let states: Vec<f64> = (0..30).map(|n| 1.4 * f64::from(n) * FRAME).collect();
        let found = reported(&states, &mut Place::default());
        for (state, (x, steady)) in states.iter().zip(found) {
            assert!((x - state).abs() < 1e-12 && steady, "{state} {x}");
        }
    }

    #[test]
    fn small_jump_is_followed_at_limited_speed() {
        let states: Vec<f64> = (0..30).map(|n| if n < 5 { 0.0 } else { 0.6 }).collect();
        let found = reported(&states, &mut Place::default());
        for pair in found.windows(2) {
            assert!((pair[1].0 - pair[0].0).abs() <= FASTEST * FRAME + 1e-12);
            assert!(pair[1].1, "less than a step");
        }
        assert!((found[29].0 - 0.6).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn large_jump_is_unsteady_for_one_update() {
        let mut place = Place::default();
        let found = reported(&[0.0, 0.0, 2.0, 2.0], &mut place);
        let steady: Vec<bool> = found.iter().map(|(_, steady)| *steady).collect();
        assert_eq!(steady, [true, true, false, true]);
        // Control: re-identification is not motion.
        place.begin_anew();
        place.follow(Some(Vec3::new(9.0, 0.0, 0.0)), 1.0);
        assert!(!place.is_steady() && place.lag() == Vec3::zeros());
        place.follow(None, 1.1);
        assert_eq!(place.stamp(), None);
    }
}
