//! Whether the sensor turns as the camera does: rotations of both are compared while the camera is tracked well.

use stillpoint_geometry::Vec3;
use stillpoint_geometry::nalgebra::UnitQuaternion;

/// Rotations are compared over so long, s: what poses err by is small beside what a bias makes of it, and nothing else changed meanwhile.
const SPAN_S: f64 = 0.5;
/// Poses that are farther apart are not compared, s: a bias that is not known makes too much of it.
const LONGEST_S: f64 = 2.0;
/// What two poses err by, one standard deviation about each axis, rad: 0.15 degrees with a rolling shutter.
const POSES_SIGMA: f64 = 0.0026;
/// A turn by so much tells whether the axes are right, rad.
const TELLING: f64 = 0.05;
/// Both may differ by this share of the turn: of scale, time and mount.
const SHARE: f64 = 0.1;
/// ... and by this, rad: a bias of 2 deg/s that is not known yet.
const SLACK: f64 = 0.02;
/// So many comparisons in a row that fail say that the sensor is wrong ...
const FAILURES: u32 = 3;
/// ... and so many that succeed that it is right after all.
const SUCCESSES: u32 = 5;
/// Where the camera may have ridden on somebody, so many failures in a row refute a sensor that has never agreed.
const DOUBTS: u32 = 5;
/// Frames in which a sensor that is not confirmed stands against all that is seen, until it is not believed.
const AGAINST: u32 = 10;

/// A pose that was tracked well.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// By the frames' clock, s.
    pub(super) time: f64,
    pub(super) world_from_camera: UnitQuaternion<f64>,
}

/// How often both agreed.
#[derive(Clone, Debug, Default)]
pub(super) struct Trust {
    /// From where the present comparison began.
    anchor: Option<Seen>,
    confirmed: bool,
    contradicts: bool,
    failures: u32,
    /// Failures of a sensor that never agreed, where the camera may have ridden on somebody.
    doubts: u32,
    successes: u32,
    against: u32,
}

impl Trust {
    pub(super) fn is_confirmed(&self) -> bool {
        self.confirmed && !self.contradicts
    }

    pub(super) fn contradicts(&self) -> bool {
        self.contradicts
    }

    /// The camera was not tracked well: what comes next is compared from anew.
    pub(super) fn interrupt(&mut self) {
        self.anchor = None;
    }

    /// Takes a pose. Returns the one to compare it with, once it is old enough, and begins anew with this one.
    pub(super) fn follow(&mut self, seen: Seen) -> Option<Seen> {
        let anchor = *self.anchor.get_or_insert(seen);
        let age = seen.time - anchor.time;
        if !(0.0..SPAN_S).contains(&age) {
            self.anchor = Some(seen);
        }
        (SPAN_S..=LONGEST_S).contains(&age).then_some(anchor)
    }

    /// Takes a comparison: by how much the camera turned, rad, and by which rotation vector the sensor differs. Where the camera may have ridden on somebody, that
    /// `can_refute` nothing. True when both agree.
    pub(super) fn compare(&mut self, turned: f64, offset: &Vec3, can_refute: bool) -> bool {
        let agrees = offset.norm() <= SLACK + SHARE * turned;
        if !agrees && !can_refute {
            self.doubts += u32::from(!self.confirmed);
        } else if !agrees {
            (self.failures, self.successes) = (self.failures + 1, 0);
        } else if turned >= TELLING {
            (self.failures, self.doubts) = (0, 0);
            self.successes += 1;
            self.confirmed |= !self.contradicts;
            self.against = 0;
        }
        if self.failures >= FAILURES || self.failures + self.doubts >= DOUBTS {
            (self.contradicts, self.confirmed) = (true, false);
        } else if self.contradicts && self.successes >= SUCCESSES {
            (self.contradicts, self.confirmed) = (false, true);
        }
        agrees
    }

    /// Hardly anything in the image turns as the sensor does, and most of it agrees on another turn: a large group that moves, unless nothing
    /// has confirmed the sensor yet.
    pub(super) fn stand_against(&mut self) {
        self.against += 1;
        if !self.confirmed && self.against >= AGAINST {
            self.contradicts = true;
            self.successes = 0;
        }
    }

    /// What two poses that are compared err by, one standard deviation about each axis, rad.
    pub(super) fn sigma() -> f64 {
        POSES_SIGMA
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::so3;

    fn seen(time: f64) -> Seen {
        Seen {
            time,
            world_from_camera: so3::exp(&Vec3::zeros()),
        }
    }

    #[test]
    fn poses_are_compared_over_half_a_second_without_a_break() {
        let mut trust = Trust::default();
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
    fn a_turn_confirms_rest_does_not_and_three_failures_refute() {
        let mut trust = Trust::default();
        let off = |x: f64| Vec3::new(x, 0.0, 0.0);
        assert!(trust.compare(0.0, &off(0.001), true) && !trust.is_confirmed());
        assert!(trust.compare(0.3, &off(0.03), true) && trust.is_confirmed());
        // Where much moves, that says nothing against a sensor that agreed before, and little against one that never did.
        (0..9).for_each(|_| assert!(!trust.compare(0.3, &off(0.4), false)));
        for _ in 0..2 {
            assert!(!trust.compare(0.3, &off(0.4), true));
        }
        assert!(trust.is_confirmed());
        trust.compare(0.3, &off(0.4), true);
        assert!(!trust.is_confirmed() && trust.contradicts());
        // It was turned back.
        for _ in 0..5 {
            assert!(trust.contradicts());
            trust.compare(0.3, &off(0.01), true);
        }
        assert!(trust.is_confirmed());
    }

    #[test]
    fn a_sensor_that_never_agrees_is_refuted_also_where_much_moves() {
        let mut trust = Trust::default();
        for k in 0..5 {
            assert!(!trust.contradicts(), "{k}");
            trust.compare(0.3, &Vec3::new(0.4, 0.0, 0.0), false);
        }
        assert!(trust.contradicts());
    }

    #[test]
    fn who_was_confirmed_may_stand_against_all_that_is_seen() {
        let mut trust = Trust::default();
        trust.compare(0.3, &Vec3::zeros(), true);
        (0..100).for_each(|_| trust.stand_against());
        assert!(trust.is_confirmed());
        let mut unknown = Trust::default();
        (0..9).for_each(|_| unknown.stand_against());
        assert!(!unknown.contradicts());
        unknown.stand_against();
        assert!(unknown.contradicts());
    }
}
