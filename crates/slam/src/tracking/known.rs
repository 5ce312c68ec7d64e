//! Camera motion known from other sensors: predicts poses and rejects impossible motions.
//!
//! A gyroscope gives rotation, odometry rotation and translation; with both, rotation comes from the gyroscope. Wheels
//! slip: many landmarks that contradict odometry overrule it, a large moving part of the image does not.

use super::crowd::CROWD;
use super::{Notes, Tracker};
use crate::inertial::Turn;
use crate::odometry::Motion;
use crate::report::{HOLDING, LostReason};
use std::collections::VecDeque;
use stillpoint_estimation::{KnownShift, KnownTurn};
use stillpoint_geometry::{Se3, Vec3};

/// Maximum deviation of a motion from the sensor's, in the sensor's standard deviations: the root of the 99.9 %
/// quantile of chi-square with three degrees of freedom, 4.03, rounded.
const GATE_SIGMAS: f64 = 4.0;
/// Pose error that is allowed for when a motion is compared with a sensor, rad and m: 0.3 degrees, that of a blurred
/// image with a rolling shutter (twice `trust::POSES_SIGMA`, rounded); from one frame to the next poses jitter by 4 mm
/// in the median (fr1_xyz, decision 42). After a larger shift by a map correction earlier poses are not compared.
pub(super) const GATE_POSE: f64 = 0.005;
/// Stamp error that is allowed for when a motion is compared with a sensor, s: a clock that was estimated was late by
/// 2.2 ms in `rpy_60` (measured, docs/evidence/sensors.md).
const GATE_TIME: f64 = 0.002;
/// Ages of earlier poses with which a pose is compared, s, so that a pose that follows a slowly turning person is
/// detected in time. Chosen: over the longest, a turn of 0.3 deg/s exceeds [`GATE_POSE`].
const COMPARED_S: [f64; 3] = [0.0, 0.2, 1.0];
/// Duration of kept poses, s: the sum of the longest of [`COMPARED_S`] and six frames of 30 Hz.
const REMEMBERED_S: f64 = 1.2;
/// Rotation of the last pose by a map correction above which earlier poses are no longer compared with sensors, rad:
/// chosen, below [`GATE_POSE`], so that a correction is not taken for a contradiction.
const SAME_WORLD: f64 = 0.003;
/// Number of matches below which sensors contribute to the pose: decision 39 has the turn with blocked view with and
/// without it.
pub(super) const FEW: usize = 80;

/// Recent accepted poses, newest last, with times on the frames' clock, s.
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

    /// The newest pose of at least this age at `time`, s; else the oldest.
    fn before(&self, time: f64, age: f64) -> Option<(f64, Se3)> {
        let old = self.0.iter().rev().find(|p| time - p.0 >= age);
        old.or(self.0.front()).copied()
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    pub(super) turn: Turn,
    /// Translation, for the same mapping as the rotation: from coordinates at the earlier time to those at the later
    /// one.
    pub(super) shift: Option<Shift>,
    /// Whether the sensor has agreed with the camera before.
    pub(super) confirmed: bool,
    /// Whether the rotation comes from a gyroscope, which does not slip.
    pub(super) by_gyro: bool,
}

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

    /// The gyroscope's rotation and the wheels' translation; without the latter if their rotations disagree, since then
    /// the wheels slipped.
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

    /// The pose `camera_from_world` after this motion, if its translation is known.
    pub(super) fn pose_after(&self, camera_from_world: &Se3) -> Option<Se3> {
        let shift = self.shift?.later_from_earlier;
        Some(Se3::new(self.turn.later_from_earlier, shift) * *camera_from_world)
    }

    /// Gates on the deviation in rotation, rad, and translation, m, after `seconds`.
    fn gates(&self, seconds: f64) -> [f64; 2] {
        let place = self.shift.map_or(f64::INFINITY, |s| {
            let speed = s.later_from_earlier.norm() / seconds.max(1e-3);
            GATE_SIGMAS * s.sigma + GATE_POSE + GATE_TIME * speed
        });
        [gate(&self.turn, seconds), place]
    }
}

/// Gate on the deviation of a rotation from the sensor's, rad.
fn gate(turn: &Turn, seconds: f64) -> f64 {
    let speed = turn.later_from_earlier.angle() / seconds.max(1e-3);
    GATE_SIGMAS * turn.sigma + GATE_POSE + GATE_TIME * speed
}

impl Tracker {
    /// Camera motion between two times on the frames' clock, s. Confirmed sensors take precedence over unconfirmed
    /// ones.
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
            // Stuck wheels look the same, and a static scene needs no sensor.
            (None, Some((motion, false))) if motion.is_idle() => return None,
            (None, Some((motion, false))) => Known::by_wheels(&motion, false),
            (Some((turn, confirmed)), Some((motion, _))) => {
                Known::by_both(turn, &motion, confirmed, to - from)
            }
        })
    }

    pub(super) fn known_since_last(&self) -> Option<Known> {
        let last = self.state.tracked()?;
        self.known(last.time, self.front_end.clock.now())
    }

    /// Likewise from confirmed sensors only.
    pub(super) fn trusted_since_last(&self) -> Option<Known> {
        self.known_since_last().filter(|k| k.confirmed)
    }

    /// A prediction `camera_from_world` corrected by sensors: entirely, or in rotation about the predicted position.
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

    /// Sensor motion from this frame to the last, as a constraint for the flow vote.
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

    /// The pose `camera_from_world` predicted by confirmed sensors from the last one.
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

    /// Likewise while a person may fill the view and a gyroscope gives the rotation: then landmarks on the person must
    /// not determine it.
    pub(super) fn known_pose_in_crowd(&self) -> Option<KnownTurn> {
        let known = self.trusted_since_last().filter(|k| k.by_gyro)?;
        self.known_pose().filter(|_| self.may_ride(&known))
    }

    /// Whether the gyroscope or wheel odometry decides between competing motion hypotheses: a confirmed gyroscope
    /// always, confirmed wheels if much of the image moves.
    pub(super) fn rules(&self, known: &Known) -> bool {
        known.confirmed && (known.by_gyro || self.was_blind() || self.moving_share > CROWD)
    }

    /// Whether a pose is compatible with the sensors, if they decide.
    pub(super) fn may_be(&self, camera_from_world: &Se3) -> bool {
        let known = self.known_since_last().filter(|k| self.rules(k));
        let motion = known.and_then(|k| self.known_motion(&k));
        let (Some(motion), Some(last)) = (motion, self.state.tracked()) else {
            return true;
        };
        motion.allows(&(last.world_from_camera.inverse() * camera_from_world.inverse()))
    }

    /// Which sensor a pose contradicts relative to earlier poses, if any; the gyroscope takes precedence.
    pub(super) fn contradicts(&self, camera_from_world: &Se3) -> Option<LostReason> {
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

    /// Updates the sensors' calibration and trust with an accepted pose, if enough landmarks support it.
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

    /// Resets all comparisons with earlier poses.
    pub(super) fn forget_motions(&mut self) {
        self.sensors.carried = None;
        self.sensors.blind_at = None;
        self.interrupt_comparisons();
    }

    fn interrupt_comparisons(&mut self) {
        self.sensors.past_poses.forget();
        if let Some(inertial) = &mut self.sensors.inertial {
            inertial.interrupt();
        }
        if let Some(odometry) = &mut self.sensors.odometry {
            odometry.interrupt();
        }
    }

    /// Resets after a change of the map's world frame.
    pub(super) fn forget_world(&mut self) {
        self.forget_motions();
        if let Some(inertial) = &mut self.sensors.inertial {
            inertial.forget_world();
        }
    }

    /// Handles a map correction that moved the last pose from `before` to its current value.
    pub(super) fn note_correction(&mut self, before: Option<Se3>) {
        let now = self.state.last().map(|l| l.world_from_camera);
        let Some((before, now)) = before.zip(now) else {
            return;
        };
        let turned = before.rotation.angle_to(&now.rotation) > SAME_WORLD;
        let moved = (before.translation - now.translation).norm() > GATE_POSE;
        if turned || (moved && self.sensors.odometry.is_some()) {
            self.interrupt_comparisons();
        }
    }

    /// Records that most of the image contradicts an unconfirmed gyroscope. Wheels are judged by the map alone: another
    /// moving group is weak evidence.
    pub(super) fn stand_against(&mut self, known: &Known) {
        if let Some(inertial) = self.sensors.inertial.as_mut().filter(|_| known.by_gyro) {
            inertial.stand_against();
        }
    }
}
