//! What sensors beside the camera know of its motion: where it is expected, and which motion cannot be its own.
//!
//! A gyroscope knows how it turned, odometry how it turned and moved; where there are both, the gyroscope says how it turned. Wheels slip: where many landmarks of
//! the map bear another motion out, that counts, and a large part of the image that moves counts less.

use super::ego_motion::EgoMotion;
use super::vote::{CROWD, Vote};
use super::{Fix, Notes, Tracker};
use crate::inertial::Turn;
use crate::odometry::Motion;
use crate::report::{HOLDING, LostReason};
use std::collections::VecDeque;
use stillpoint_estimation::{KnownShift, KnownTurn};
use stillpoint_geometry::{Se3, Vec3};

/// A motion cannot be the camera's if it differs from the sensor's by more than this many of the sensor's standard deviations: the root of the 99.9 %
/// quantile of chi-square with three degrees of freedom, 4.03, rounded.
const GATE_SIGMAS: f64 = 4.0;
/// Pose error that is allowed for when a motion is compared with a sensor, rad: 0.3 degrees, that of a blurred image with a rolling shutter. It is
/// twice `trust::POSES_SIGMA`, rounded.
pub(super) const GATE_POSE: f64 = 0.005;
/// Pose error that is allowed for when a motion is compared with a sensor, m: from one frame to the next poses jitter by 4 mm in the median (fr1_xyz,
/// decision 42).
const GATE_POSE_M: f64 = 0.005;
/// Stamp error that is allowed for when a motion is compared with a sensor, s: a clock that was estimated was late by 2.2 ms in `rpy_60` (measured,
/// docs/evidence/sensors.md).
const GATE_TIME: f64 = 0.002;
/// Poses are compared with those of so long before, s: who rides on somebody who turns slowly is found out in time. Chosen: over the longest, a turn
/// of 0.3 deg/s exceeds [`GATE_POSE`].
const COMPARED_S: [f64; 3] = [0.0, 0.2, 1.0];
/// Poses are remembered for so long, s: the sum of the longest of [`COMPARED_S`] and six frames of 30 Hz.
const REMEMBERED_S: f64 = 1.2;
/// A correction of the map that turns the last pose by more than this ends the comparison of earlier poses with sensors, rad: chosen, below
/// [`GATE_POSE`], so that a correction is not taken for a contradiction.
const SAME_WORLD: f64 = 0.003;
/// A correction of the map that moves the last pose by more than this ends the comparison of earlier poses with odometry, m: as much as
/// [`GATE_POSE_M`] allows a pose to err by; chosen.
const SAME_WORLD_M: f64 = 0.005;
/// Where fewer matches lead to a pose, sensors measure it as well, a number: decision 39 has the blocked turn with and without it.
pub(super) const FEW: usize = 80;

/// Poses of the camera that were taken, newest last: by the frames' clock, s.
#[derive(Default)]
pub(super) struct PastPoses(VecDeque<(f64, Se3)>);

impl PastPoses {
    fn remember(&mut self, time: f64, world_from_camera: &Se3) {
        self.0.push_back((time, *world_from_camera));
        while self.0.front().is_some_and(|p| time - p.0 > REMEMBERED_S) {
            self.0.pop_front();
        }
    }

    pub(super) fn forget(&mut self) {
        self.0.clear();
    }

    /// The newest one that is so old at `time`, s; the oldest where none is.
    fn before(&self, time: f64, age: f64) -> Option<(f64, Se3)> {
        let old = self.0.iter().rev().find(|p| time - p.0 >= age);
        old.or(self.0.front()).copied()
    }
}

/// A motion of the camera as sensors beside it know it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    pub(super) turn: Turn,
    /// What it moved by, as maps of coordinates have it: with the turn it maps those at the earlier moment to those at the later one.
    pub(super) shift: Option<Shift>,
    /// Whether what says so has moved as the camera did before.
    pub(super) confirmed: bool,
    /// Whether a gyroscope says how it turned, which does not slip.
    pub(super) by_gyro: bool,
}

/// The translation of a motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shift {
    later_from_earlier: Vec3,
    /// Standard deviation along each axis, m.
    pub(super) sigma: f64,
}

impl Known {
    fn by_gyro(turn: Turn, confirmed: bool) -> Self {
        Self {
            turn,
            shift: None,
            confirmed,
            by_gyro: true,
        }
    }

    fn by_wheels(motion: &Motion, confirmed: bool) -> Self {
        Self {
            turn: Turn {
                later_from_earlier: motion.later_from_earlier.rotation,
                sigma: motion.sigma_rad,
            },
            shift: Some(Shift {
                later_from_earlier: motion.later_from_earlier.translation,
                sigma: motion.sigma_m,
            }),
            confirmed,
            by_gyro: false,
        }
    }

    /// The turn of the gyroscope with the way of the wheels, unless these turned otherwise: then they slipped.
    fn by_both(turn: Turn, motion: &Motion, confirmed: bool, seconds: f64) -> Self {
        let known = Self::by_gyro(turn, confirmed);
        let wheels = motion.later_from_earlier;
        let off = wheels.rotation.angle_to(&turn.later_from_earlier);
        if off > gate(&turn, seconds) + GATE_SIGMAS * motion.sigma_rad {
            return known;
        }
        let place = wheels.rotation.inverse() * wheels.translation;
        let shift = Shift {
            later_from_earlier: turn.later_from_earlier * place,
            sigma: motion.sigma_m,
        };
        Self {
            shift: Some(shift),
            ..known
        }
    }

    /// The pose `camera_from_world` after this motion, where all of it is known.
    pub(super) fn pose_after(&self, camera_from_world: &Se3) -> Option<Se3> {
        let shift = self.shift?.later_from_earlier;
        Some(Se3::new(self.turn.later_from_earlier, shift) * *camera_from_world)
    }

    /// By how much a pose may turn otherwise, rad, and be elsewhere, m, `seconds` later.
    fn gates(&self, seconds: f64) -> [f64; 2] {
        let place = self.shift.map_or(f64::INFINITY, |s| {
            let speed = s.later_from_earlier.norm() / seconds.max(1e-3);
            GATE_SIGMAS * s.sigma + GATE_POSE_M + GATE_TIME * speed
        });
        [gate(&self.turn, seconds), place]
    }
}

/// By how much a motion may turn otherwise than a sensor says, rad.
fn gate(turn: &Turn, seconds: f64) -> f64 {
    let speed = turn.later_from_earlier.angle() / seconds.max(1e-3);
    GATE_SIGMAS * turn.sigma + GATE_POSE + GATE_TIME * speed
}

impl Tracker {
    /// How the camera moved between two moments by the frames' clock, s. A sensor that has moved as the camera did is asked before one that has not yet.
    pub(super) fn known(&self, from: f64, to: f64) -> Option<Known> {
        let gyro = self.sensors.inertial.as_ref();
        let gyro = gyro.and_then(|i| Some((i.turn(from, to)?, i.is_confirmed())));
        let wheels = self.sensors.odometry.as_ref();
        let wheels = wheels.and_then(|o| Some((o.motion(from, to)?, o.is_confirmed())));
        Some(match (gyro, wheels) {
            (None, None) => return None,
            (Some((turn, confirmed)), None) => Known::by_gyro(turn, confirmed),
            (Some((turn, true)), Some((_, false))) => Known::by_gyro(turn, true),
            (None | Some((_, false)), Some((motion, true))) => Known::by_wheels(&motion, true),
            // Stuck wheels say so too, and a room that stands still needs no advocate.
            (None, Some((motion, false))) if motion.is_idle() => return None,
            (None, Some((motion, false))) => Known::by_wheels(&motion, false),
            (Some((turn, confirmed)), Some((motion, _))) => {
                Known::by_both(turn, &motion, confirmed, to - from)
            }
        })
    }

    /// The same since the last frame with a pose.
    pub(super) fn known_since_last(&self) -> Option<Known> {
        let last = self.state.tracked()?;
        self.known(last.time, self.front_end.clock.now())
    }

    /// The same of what has moved as the camera did.
    pub(super) fn trusted_since_last(&self) -> Option<Known> {
        self.known_since_last().filter(|k| k.confirmed)
    }

    /// A prediction `camera_from_world` as sensors have it: all of it, or turned about the same place.
    pub(super) fn moved(&self, predicted: Se3) -> Se3 {
        let (Some(known), Some(last)) = (self.trusted_since_last(), self.state.tracked()) else {
            return predicted;
        };
        if let Some(pose) = known.pose_after(&last.world_from_camera.inverse()) {
            return pose;
        }
        let turn = known.turn.later_from_earlier;
        let rotation = turn * last.world_from_camera.rotation.inverse();
        let place = predicted.inverse().translation;
        Se3::new(rotation, -(rotation * place))
    }

    /// The motion from this frame to the last one, as far as sensors know it: what the vote of the flow is about.
    pub(super) fn known_motion(&self, known: &Known) -> Option<KnownTurn> {
        let last = self.state.tracked()?;
        let [turn, place] = known.gates(self.front_end.clock.now() - last.time);
        let b_from_a = known.turn.later_from_earlier.inverse();
        Some(KnownTurn {
            b_from_a,
            sigma: known.turn.sigma,
            gate: turn,
            shift: known.shift.map(|s| KnownShift {
                b_from_a: -(b_from_a * s.later_from_earlier),
                sigma: s.sigma,
                gate: place,
            }),
        })
    }

    /// The pose `camera_from_world`, as sensors that are confirmed know it by the last one.
    pub(super) fn known_pose(&self) -> Option<KnownTurn> {
        let known = self.trusted_since_last()?;
        let last_from_world = self.state.tracked()?.world_from_camera.inverse();
        let moved = known.pose_after(&last_from_world);
        Some(KnownTurn {
            b_from_a: known.turn.later_from_earlier * last_from_world.rotation,
            sigma: known.turn.sigma,
            gate: f64::INFINITY,
            shift: known.shift.zip(moved).map(|(s, pose)| KnownShift {
                b_from_a: pose.translation,
                sigma: s.sigma,
                gate: f64::INFINITY,
            }),
        })
    }

    /// The same while somebody may fill the view and a gyroscope, which does not slip, says how the camera turned: landmarks that he wears hold a pose no better.
    pub(super) fn known_pose_in_crowd(&self) -> Option<KnownTurn> {
        let known = self.trusted_since_last().filter(|k| k.by_gyro)?;
        self.known_pose().filter(|_| self.may_ride(&known))
    }

    /// Whether it is for a sensor to say which motion is the camera's: a gyroscope that is confirmed, or wheels where much of what is seen moves.
    pub(super) fn rules(&self, known: &Known) -> bool {
        known.confirmed && (known.by_gyro || self.was_blind() || self.moving_share > CROWD)
    }

    /// Whether a pose may be that of the camera, as far as a sensor tells that has a say in it.
    pub(super) fn may_be(&self, camera_from_world: &Se3) -> bool {
        let known = self.known_since_last().filter(|k| self.rules(k));
        let motion = known.and_then(|k| self.known_motion(&k));
        let (Some(motion), Some(last)) = (motion, self.state.tracked()) else {
            return true;
        };
        motion.allows(&(last.world_from_camera.inverse() * camera_from_world.inverse()))
    }

    /// What a pose contradicts since poses that were taken, if anything: the gyroscope before the wheels.
    fn contradicts(&self, camera_from_world: &Se3) -> Option<LostReason> {
        let now = self.front_end.clock.now();
        let differs = |age: f64| {
            let (time, world_from_camera) = self.sensors.past_poses.before(now, age)?;
            let known = self.known(time, now).filter(|k| k.confirmed)?;
            let seen = *camera_from_world * world_from_camera;
            let [turn, place] = known.gates(now - time);
            let turns = seen.rotation.angle_to(&known.turn.later_from_earlier) > turn;
            if turns && known.by_gyro {
                return Some(LostReason::AgainstGyro);
            }
            let moved = known.pose_after(&world_from_camera.inverse());
            let off = moved.map(|m| (m * camera_from_world.inverse()).translation.norm());
            let moves = turns || off.is_some_and(|m| m > place);
            moves.then_some(LostReason::AgainstOdometry)
        };
        let found = COMPARED_S.map(differs);
        let gyro = found.iter().find(|f| **f == Some(LostReason::AgainstGyro));
        gyro.copied()
            .flatten()
            .or(found.into_iter().flatten().next())
    }

    /// A pose that moves as sensors say, or the vote's that does: most of what is seen may be somebody who walks along. Many landmarks overrule wheels.
    pub(super) fn refuse_riding(
        &self,
        motion: &EgoMotion,
        fix: Fix,
        features: usize,
    ) -> Result<Fix, LostReason> {
        let reason = self.contradicts(&fix.camera_from_world);
        let Some(reason) = reason.filter(|_| motion.follows) else {
            return Ok(fix);
        };
        let wheels = reason == LostReason::AgainstOdometry;
        // At the beginning of a map, people are what most landmarks are of: there is a way back only where it is not known who moves.
        let may_ride = self.goes_back && self.moving_share > CROWD;
        let many = fix.matches.landmarks() >= HOLDING as usize;
        let borne_out = many && !may_ride && !self.was_blind();
        if wheels && borne_out {
            return Ok(fix);
        }
        let enough = self.setup.tracking.min_inliers;
        let bound = motion.by_flow.as_ref();
        let bound = bound.filter(|v| v.is_bound && v.agreed >= enough);
        // Step by step a vote may drift with somebody that a second tells apart.
        let bound = bound.filter(|v| !wheels || self.contradicts(&v.camera_from_world).is_none());
        let vote: &Vote = bound.ok_or(reason)?;
        Ok(Self::follow_vote(vote, features))
    }

    /// Learns from a pose that was taken what sensors err by, and whether they agree. Poses that hang on few landmarks do not tell.
    pub(super) fn learn_motion(&mut self, notes: &Notes, world_from_camera: &Se3, measured: bool) {
        if self.sensors.inertial.is_none() && self.sensors.odometry.is_none() {
            return;
        }
        let (now, blind) = (self.front_end.clock.now(), self.was_blind());
        let counts = &notes.counts;
        let can_refute = counts.moving_share() < CROWD && !blind;
        let tells = measured && counts.inliers >= HOLDING;
        let against = self.contradicts(&world_from_camera.inverse());
        let slips = tells && can_refute && against == Some(LostReason::AgainstOdometry);
        self.sensors.past_poses.remember(now, world_from_camera);
        if let Some(inertial) = self.sensors.inertial.as_mut().filter(|_| tells) {
            inertial.learn(now, &world_from_camera.rotation, can_refute);
        }
        if let Some(odometry) = self.sensors.odometry.as_mut().filter(|_| tells) {
            odometry.learn(now, world_from_camera, can_refute);
            if slips {
                odometry.note_slip(now);
            }
        }
    }

    /// Nothing that was seen before can be compared with what comes.
    pub(super) fn forget_motions(&mut self) {
        self.sensors.carried = None;
        self.sensors.blind_at = None;
        self.interrupt_comparisons();
    }

    /// Poses from before are those of another map.
    fn interrupt_comparisons(&mut self) {
        self.sensors.past_poses.forget();
        if let Some(inertial) = &mut self.sensors.inertial {
            inertial.interrupt();
        }
        if let Some(odometry) = &mut self.sensors.odometry {
            odometry.interrupt();
        }
    }

    /// The world of the map is another one from now on.
    pub(super) fn forget_world(&mut self) {
        self.forget_motions();
        if let Some(inertial) = &mut self.sensors.inertial {
            inertial.forget_world();
        }
    }

    /// The map was corrected: the last pose was moved from `before` to where it is now.
    pub(super) fn note_correction(&mut self, before: Option<Se3>) {
        let now = self.state.last().map(|l| l.world_from_camera);
        let Some((before, now)) = before.zip(now) else {
            return;
        };
        let turned = before.rotation.angle_to(&now.rotation) > SAME_WORLD;
        let moved = (before.translation - now.translation).norm() > SAME_WORLD_M;
        if turned || (moved && self.sensors.odometry.is_some()) {
            self.interrupt_comparisons();
        }
    }

    /// Hardly anything of what is seen moves as a sensor says that nothing has confirmed yet. Wheels are judged by the map alone: one group more that walks against them says little.
    pub(super) fn stand_against(&mut self, known: &Known) {
        if let Some(inertial) = self.sensors.inertial.as_mut().filter(|_| known.by_gyro) {
            inertial.stand_against();
        }
    }
}
