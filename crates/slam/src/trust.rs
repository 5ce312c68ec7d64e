//! Trust in a motion sensor, from comparisons with the camera's motion while it is tracked well.

use stillpoint_geometry::Vec3;

/// Interval of compared motions, s: long enough that a bias exceeds pose errors, short enough that nothing else
/// changes. Chosen: the offset of a BMI055 (data sheet, 1 deg/s) makes 8.7 mrad, over three times [`POSES_SIGMA`].
const SPAN_S: f64 = 0.5;
/// Maximum interval between compared poses, s: an unknown bias accumulates. Chosen: that of a BMI055 (data sheet, 1
/// deg/s) makes 2 degrees, beyond [`SLACK`].
const LONGEST_S: f64 = 2.0;
/// Error of the rotation between two poses, one standard deviation about each axis, rad: 0.15 degrees with a rolling
/// shutter.
pub(crate) const POSES_SIGMA: f64 = 0.0026;
/// Minimum rotation or displacement of the camera to verify the axes of a sensor, rad and m: chosen, 3 degrees, nearly
/// twenty times [`POSES_SIGMA`], and ten times `known::GATE_POSE`.
const TELLING: f64 = 0.05;
/// Allowed difference between sensor and camera, as a share of the rotation, or of the displacement: scale, time and
/// mount err. Chosen: three times the slip of an indoor robot's turns (3 %).
const SHARE: f64 = 0.1;
/// Additional allowed angle or displacement, rad and m: a still unknown bias of 2 deg/s, twice the offset of a BMI055
/// (data sheet), causes as much within [`SPAN_S`]; two poses err, and the base rolls and springs.
const SLACK: f64 = 0.02;
/// Additional allowance in standard deviations of the sensor's unknown error, if that exceeds [`SLACK`]: 99.9 % of
/// three axes.
const UNKNOWN_SIGMAS: f64 = 4.03;
/// Displacement per rotation of a camera whose mount is off by some centimetres, m/rad: chosen, a lever of ten
/// centimetres.
const SWING: f64 = 0.1;
/// Consecutive failed comparisons after which a sensor counts as wrong: chosen, as single ones fail when the map is
/// corrected or the pose follows a moving object.
const FAILURES: u32 = 3;
/// Consecutive successful comparisons after which a wrong sensor counts as right again, and failures that refute one
/// that has never agreed even when the pose may follow a moving object: chosen, more than [`FAILURES`], so that it does
/// not change to and fro.
const SUCCESSES: u32 = 5;
/// Frames in which an unconfirmed sensor may contradict the majority of the image before it is distrusted: a right one
/// differed in 3 of 134 frames, a wrong one in 97 to 100 % (decision 39).
const AGAINST: u32 = 10;

/// Trust in a sensor, with the fault if it is ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorState<F> {
    /// In use, but the camera has not moved enough to verify it.
    Unconfirmed,
    /// In use, and verified against the camera's motion.
    Confirmed,
    /// Not used.
    Ignored(F),
}

impl<F: std::fmt::Display> std::fmt::Display for SensorState<F> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unconfirmed => f.write_str("not confirmed yet"),
            Self::Confirmed => f.write_str("confirmed"),
            Self::Ignored(fault) => write!(f, "ignored: {fault}"),
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Comparison {
    pub(crate) agrees: bool,
    /// They moved enough to be conclusive.
    tells: bool,
}

impl Comparison {
    /// Compares rotations: `turned` is the camera's angle, rad, `offset` the difference as rotation vector, `unknown`
    /// its standard deviation about an axis due to the sensor's unknown error.
    pub(crate) fn of_turn(turned: f64, offset: &Vec3, unknown: f64) -> Self {
        let slack = SLACK.max(UNKNOWN_SIGMAS * unknown);
        Self {
            agrees: offset.norm() <= slack + SHARE * turned,
            tells: turned >= TELLING,
        }
    }

    /// Compares motions: also the camera's displacement `moved` and the difference `shift`, m.
    pub(crate) fn of_motion(turned: f64, offset: &Vec3, moved: f64, shift: f64) -> Self {
        let turn = Self::of_turn(turned, offset, 0.0);
        Self {
            agrees: turn.agrees && shift <= SLACK + SHARE * moved + SWING * turned,
            tells: turn.tells || moved >= TELLING,
        }
    }
}

/// A reliable pose, or its rotation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen<P> {
    /// On the frames' clock, s.
    pub(crate) time: f64,
    pub(crate) world_from_camera: P,
}

#[derive(Clone, Debug)]
pub(crate) struct Trust<P> {
    /// Start of the current comparison.
    anchor: Option<Seen<P>>,
    confirmed: bool,
    contradicts: bool,
    failures: u32,
    /// Failures of a sensor that never agreed, while the pose may follow a moving object.
    doubts: u32,
    successes: u32,
    against: u32,
}

impl<P> Default for Trust<P> {
    fn default() -> Self {
        Self {
            anchor: None,
            confirmed: false,
            contradicts: false,
            failures: 0,
            doubts: 0,
            successes: 0,
            against: 0,
        }
    }
}

impl<P: Copy> Trust<P> {
    pub(crate) fn is_confirmed(&self) -> bool {
        self.confirmed && !self.contradicts
    }

    pub(crate) fn contradicts(&self) -> bool {
        self.contradicts
    }

    /// Called when tracking was unreliable: the next comparison starts anew.
    pub(crate) fn interrupt(&mut self) {
        self.anchor = None;
    }

    /// Takes a pose. Returns the pose to compare it with, once that is old enough, and restarts from this one.
    pub(crate) fn follow(&mut self, seen: Seen<P>) -> Option<Seen<P>> {
        let anchor = *self.anchor.get_or_insert(seen);
        let age = seen.time - anchor.time;
        if !(0.0..SPAN_S).contains(&age) {
            self.anchor = Some(seen);
        }
        (SPAN_S..=LONGEST_S).contains(&age).then_some(anchor)
    }

    /// Records a comparison; `can_refute` is false while the pose may follow a moving object. Returns whether both
    /// agree.
    pub(crate) fn compare(&mut self, seen: Comparison, can_refute: bool) -> bool {
        let agrees = seen.agrees;
        if !agrees && !can_refute {
            self.doubts += u32::from(!self.confirmed);
        } else if !agrees {
            (self.failures, self.successes) = (self.failures + 1, 0);
        } else if seen.tells {
            (self.failures, self.doubts) = (0, 0);
            self.successes += 1;
            self.confirmed |= !self.contradicts;
            self.against = 0;
        }
        if self.failures >= FAILURES || self.failures + self.doubts >= SUCCESSES {
            (self.contradicts, self.confirmed) = (true, false);
        } else if self.contradicts && self.successes >= SUCCESSES {
            (self.contradicts, self.confirmed) = (false, true);
        }
        agrees
    }

    /// Records that most of the image contradicts the sensor: a large moving group, unless the sensor is still
    /// unconfirmed.
    pub(crate) fn stand_against(&mut self) {
        self.against += 1;
        if !self.confirmed && self.against >= AGAINST {
            self.contradicts = true;
            self.successes = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(time: f64) -> Seen<()> {
        Seen {
            time,
            world_from_camera: (),
        }
    }

    fn turn(turned: f64, off: f64) -> Comparison {
        Comparison::of_turn(turned, &Vec3::new(off, 0.0, 0.0), 0.0)
    }

    #[test]
    fn poses_are_compared_over_uninterrupted_half_seconds() {
        let mut trust = Trust::<()>::default();
        let mut compared = Vec::new();
        for k in 0..60 {
            let time = f64::from(k) / 30.0;
            if k == 20 {
                trust.interrupt();
            }
            if let Some(from) = trust.follow(seen(time)) {
                compared.push((k, (from.time * 30.0).round() as i32));
            }
        }
        assert_eq!(compared, [(15, 0), (35, 20), (50, 35)]);
        // Too far apart.
        assert!(trust.follow(seen(9.0)).is_none() && trust.follow(seen(9.6)).is_some());
    }

    #[test]
    fn rotation_confirms_and_three_failures_refute() {
        let mut trust = Trust::<()>::default();
        assert!(trust.compare(turn(0.0, 0.001), true) && !trust.is_confirmed());
        assert!(trust.compare(turn(0.3, 0.03), true) && trust.is_confirmed());
        // Where much moves, failures do not count against a sensor that agreed before, and little against one that
        // never did.
        (0..9).for_each(|_| assert!(!trust.compare(turn(0.3, 0.4), false)));
        for _ in 0..2 {
            assert!(!trust.compare(turn(0.3, 0.4), true));
        }
        assert!(trust.is_confirmed());
        trust.compare(turn(0.3, 0.4), true);
        assert!(!trust.is_confirmed() && trust.contradicts());
        // The sensor was corrected.
        for _ in 0..5 {
            assert!(trust.contradicts());
            trust.compare(turn(0.3, 0.01), true);
        }
        assert!(trust.is_confirmed());
    }

    #[test]
    fn unknown_bias_is_tolerated_in_comparisons() {
        let still = |off, unknown| Comparison::of_turn(0.0, &Vec3::new(off, 0.0, 0.0), unknown);
        // Half a second of a bias of 3 deg/s, before and after it was measured.
        assert!(still(0.026, 0.0085).agrees && !still(0.026, 0.001).agrees);
        assert!(!still(0.2, 0.0085).agrees);
    }

    #[test]
    fn never_agreeing_sensor_is_refuted_in_dynamic_scenes() {
        let mut trust = Trust::<()>::default();
        for k in 0..5 {
            assert!(!trust.contradicts(), "{k}");
            trust.compare(turn(0.3, 0.4), false);
        }
        assert!(trust.contradicts());
    }

    #[test]
    fn confirmed_sensor_may_contradict_the_view() {
        let mut trust = Trust::<()>::default();
        trust.compare(turn(0.3, 0.0), true);
        (0..100).for_each(|_| trust.stand_against());
        assert!(trust.is_confirmed());
        let mut unknown = Trust::<()>::default();
        (0..9).for_each(|_| unknown.stand_against());
        assert!(!unknown.contradicts());
        unknown.stand_against();
        assert!(unknown.contradicts());
    }

    #[test]
    fn translations_confirm_or_refute_like_rotations() {
        let motion = |moved, shift| Comparison::of_motion(0.0, &Vec3::zeros(), moved, shift);
        assert!(motion(0.3, 0.04).agrees && motion(0.3, 0.04).tells);
        assert!(!motion(0.3, 0.06).agrees && !motion(0.03, 0.01).tells);
        // The mount of a camera that turns on the spot may be off by some centimetres.
        assert!(Comparison::of_motion(0.5, &Vec3::zeros(), 0.0, 0.06).agrees);
        assert!(!Comparison::of_motion(0.5, &Vec3::new(0.0, 0.1, 0.0), 0.0, 0.0).agrees);
    }
}
