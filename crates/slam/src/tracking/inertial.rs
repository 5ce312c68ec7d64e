//! What the gyroscope is used for: where the camera is expected, which motion cannot be its own, and how it turned while it saw too little.

use super::ego_motion::EgoMotion;
use super::outcome::Ending;
use super::statistics::Sightings;
use super::vote::Vote;
use super::{Fix, Notes, Solution, Tracker};
use crate::inertial::{Inertial, Turn};
use crate::report::LostReason;
use std::collections::VecDeque;
use stillpoint_estimation::KnownTurn;
use stillpoint_geometry::nalgebra::UnitQuaternion;
use stillpoint_geometry::{ImuModel, Mat6, Se3, Vec3, Vec6};
use stillpoint_imaging::{ImuSample, RgbdFrame};
use stillpoint_map::{KeyframeData, KeyframeId};

/// A motion that turns otherwise than the gyroscope by so many of its standard deviations is not the camera's ...
const GATE_SIGMAS: f64 = 4.0;
/// ... and what poses err by comes to it, rad: 0.3 degrees, of a blurred image with a rolling shutter ...
const GATE_POSE: f64 = 0.005;
/// ... with what stamps err by, s.
const GATE_TIME: f64 = 0.002;
/// Poses are compared with those of so long before, s: who rides on somebody who turns slowly is found out in time.
const COMPARED_S: [f64; 3] = [0.0, 0.2, 1.0];
/// Poses are remembered for so long, s.
const REMEMBERED_S: f64 = 1.2;
/// A map that was corrected by more since than this is another one for these comparisons, rad.
const SAME_WORLD: f64 = 0.003;
/// The direction is carried for so long at most, s: a bias that is known to 0.1 deg/s makes half a degree of it.
const CARRIED_S: f64 = 5.0;
/// While nothing tells how the camera moves, its velocity is expected to be halved in this time, s: nobody walks on blindly.
const HALVED_S: f64 = 0.15;
/// After the direction was carried, motions of most of the image are not taken for the camera's for so long, s.
const BLIND_S: f64 = 1.0;
/// Within a second without sight a camera is carried by so much that nobody measured, m: one standard deviation.
const BLIND_M_S: f64 = 0.3;

/// Directions of the camera that were taken, newest last: by the frames' clock, s.
#[derive(Default)]
pub(super) struct PastTurns(VecDeque<(f64, UnitQuaternion<f64>)>);

impl PastTurns {
    fn remember(&mut self, time: f64, world_from_camera: &Se3) {
        self.0.push_back((time, world_from_camera.rotation));
        while self.0.front().is_some_and(|p| time - p.0 > REMEMBERED_S) {
            self.0.pop_front();
        }
    }

    pub(super) fn forget(&mut self) {
        self.0.clear();
    }

    /// The newest one that is so old at `time`, s; the oldest where none is.
    fn before(&self, time: f64, age: f64) -> Option<(f64, UnitQuaternion<f64>)> {
        let old = self.0.iter().rev().find(|p| time - p.0 >= age);
        old.or(self.0.front()).copied()
    }
}

/// The frames since the last one in which a pose was measured.
#[derive(Clone, Copy, Debug)]
pub(super) struct Carried {
    pub(super) since: stillpoint_imaging::FrameId,
    /// By the frames' clock, s.
    began: f64,
}

impl Tracker {
    /// The tracker with an inertial sensor on the camera.
    #[must_use]
    pub fn with_imu(mut self, model: ImuModel) -> Self {
        self.inertial = Some(Inertial::new(model));
        self
    }

    /// Takes samples of the inertial sensor, in order of time. Without a sensor ([`Tracker::with_imu`]) they mean nothing.
    pub fn receive_inertial(&mut self, samples: &[ImuSample]) {
        if let Some(inertial) = &mut self.inertial {
            inertial.receive(samples);
        }
    }

    /// Whether there is an inertial sensor.
    #[must_use]
    pub fn has_imu(&self) -> bool {
        self.inertial.is_some()
    }

    /// Whether there is a gyroscope that turned as the camera did: until then its bias is not known either.
    fn trusts_gyro(&self) -> bool {
        self.inertial.as_ref().is_some_and(Inertial::is_confirmed)
    }

    /// How the camera turned since the last frame with a pose.
    pub(super) fn turn_since_last(&self) -> Option<Turn> {
        let (inertial, last) = (self.inertial.as_ref()?, self.state.tracked()?);
        inertial.turn(last.time, self.front_end.clock.now())
    }

    /// A prediction `camera_from_world` that turns as the gyroscope says, about the same place.
    pub(super) fn turned(&self, predicted: Se3) -> Se3 {
        let turn = self.turn_since_last().filter(|_| self.trusts_gyro());
        let (Some(turn), Some(last)) = (turn, self.state.tracked()) else {
            return predicted;
        };
        let rotation = turn.later_from_earlier * last.world_from_camera.rotation.inverse();
        let place = predicted.inverse().translation;
        Se3::new(rotation, -(rotation * place))
    }

    /// The motion from this frame to the last one, as far as the gyroscope knows it: what the vote of the flow is about.
    pub(super) fn known_turn(&self) -> Option<KnownTurn> {
        let turn = self.turn_since_last()?;
        let last = self.state.tracked()?;
        let seconds = self.front_end.clock.now() - last.time;
        Some(KnownTurn {
            b_from_a: turn.later_from_earlier.inverse(),
            sigma: turn.sigma,
            gate: gate(&turn, seconds),
        })
    }

    /// The rotation of `camera_from_world`, as a gyroscope that is confirmed knows it by the last pose.
    pub(super) fn known_direction(&self) -> Option<KnownTurn> {
        let turn = self.turn_since_last().filter(|_| self.trusts_gyro())?;
        let last = self.state.tracked()?;
        Some(KnownTurn {
            b_from_a: turn.later_from_earlier * last.world_from_camera.rotation.inverse(),
            sigma: turn.sigma,
            gate: f64::INFINITY,
        })
    }

    /// Whether a pose may be that of the camera, as far as a gyroscope that is confirmed tells.
    pub(super) fn may_be(&self, camera_from_world: &Se3) -> bool {
        let known = self.known_turn().filter(|_| self.trusts_gyro());
        let (Some(turn), Some(last)) = (known, self.state.tracked()) else {
            return true;
        };
        turn.allows(&(last.world_from_camera.inverse() * camera_from_world.inverse()))
    }

    /// How fast the camera turned at the last pose and turns now, as the angular parts of twists of `camera_later_from_camera_earlier`, rad/s.
    pub(super) fn turning(&self) -> Option<[Vec3; 2]> {
        let inertial = self.inertial.as_ref().filter(|i| i.is_confirmed())?;
        let last = self.state.tracked()?;
        let before = inertial.rate(last.time)?;
        let now = inertial.rate(self.front_end.clock.now())?;
        // What the camera sees turns the other way.
        Some([-before, -now])
    }

    /// The velocity that is expected of this frame before its pose is known.
    pub(super) fn expected_velocity(&self) -> Option<Vec6> {
        let mut velocity = self.state.velocity()?;
        if let Some([_, now]) = self.turning() {
            velocity.fixed_rows_mut::<3>(3).copy_from(&now);
        }
        Some(velocity)
    }

    /// Whether a pose turns otherwise than the gyroscope since poses that were taken.
    fn contradicts_gyro(&self, camera_from_world: &Se3) -> bool {
        let Some(inertial) = self.inertial.as_ref().filter(|i| i.is_confirmed()) else {
            return false;
        };
        let now = self.front_end.clock.now();
        let differs = |age: f64| {
            let (time, world_from_camera) = self.past_turns.before(now, age)?;
            let turn = inertial.turn(time, now)?;
            let seen = camera_from_world.rotation * world_from_camera;
            let off = seen.angle_to(&turn.later_from_earlier);
            Some(off > gate(&turn, now - time))
        };
        COMPARED_S.into_iter().any(|age| differs(age) == Some(true))
    }

    /// A pose that turns as the gyroscope says, or the vote's that does: most of what is seen may be somebody who walks along.
    pub(super) fn refuse_riding(
        &self,
        motion: &EgoMotion,
        fix: Fix,
        features: usize,
    ) -> Result<Fix, LostReason> {
        if !motion.follows || !self.contradicts_gyro(&fix.camera_from_world) {
            return Ok(fix);
        }
        let enough = self.setup.tracking.min_inliers;
        let bound = motion.by_flow.as_ref();
        let bound = bound.filter(|v| v.is_bound && v.agreed >= enough);
        let vote = bound.ok_or(LostReason::AgainstGyro)?;
        Ok(Self::follow_vote(vote, features))
    }

    /// Carries the camera's direction over a frame that gives no pose, as the gyroscope says, and its place as far as the few points tell that
    /// stand still, else by what is left of its velocity. None where the gyroscope is not confirmed, or it has been too long.
    pub(super) fn carry(
        &mut self,
        frame: &RgbdFrame,
        data: &std::sync::Arc<KeyframeData>,
        notes: &mut Notes,
    ) -> Option<Ending> {
        let last = self.state.tracked().filter(|_| self.trusts_gyro())?;
        let turn = self.turn_since_last()?;
        let now = self.front_end.clock.now();
        let carried = self.carried.unwrap_or(Carried {
            since: frame.id,
            began: last.time,
        });
        let blind = now - carried.began;
        if blind > CARRIED_S {
            return None;
        }
        let reference = self.reference_of(last.pose.reference);
        let camera_from_world = match notes.bound.take() {
            Some(vote) => vote.camera_from_world,
            None => self.slowed(&turn, now - last.time)?,
        };
        notes.evidence.information = Some(blind_information(&turn, blind));
        let solution = Solution {
            data: std::sync::Arc::clone(data),
            camera_from_world,
            reference,
            matches: vec![None; data.len()],
            sightings: Sightings::default(),
            followed: Vec::new(),
            recognised: None,
        };
        notes.counts.inliers = 0;
        self.carried = Some(carried);
        self.blind_at = Some(now);
        let world_from_camera = camera_from_world.inverse();
        self.learn_turn(notes, &world_from_camera, false);
        Some(self.accept_carried(frame, &solution, carried.since))
    }

    /// Whether so much of the view was blocked a moment ago that the direction had to be carried: what agrees then is somebody, as likely as not.
    pub(super) fn was_blind(&self) -> bool {
        let now = self.front_end.clock.now();
        self.blind_at.is_some_and(|at| now - at < BLIND_S)
    }

    /// The reference keyframe, as the newest view of the map has it.
    fn reference_of(&self, id: KeyframeId) -> KeyframeId {
        self.map.view.resolve_keyframe(id).unwrap_or(id)
    }

    /// Where the camera is `dt` seconds after the last pose if it turned so and slowed down.
    fn slowed(&self, turn: &Turn, dt: f64) -> Option<Se3> {
        let last = self.state.tracked()?;
        let rotation = turn.later_from_earlier * last.world_from_camera.rotation.inverse();
        let from = last.world_from_camera.translation;
        let straight = self.state.continued(dt)?.inverse().translation - from;
        let place = from + straight * libm::exp2(-dt / HALVED_S);
        Some(Se3::new(rotation, -(rotation * place)))
    }

    /// Learns from a pose that was taken: the gyroscope's bias, and whether both agree. Poses that hang on few landmarks do not tell.
    pub(super) fn learn_turn(&mut self, notes: &Notes, world_from_camera: &Se3, measured: bool) {
        let now = self.front_end.clock.now();
        let blind = self.was_blind();
        let Some(inertial) = &mut self.inertial else {
            return;
        };
        self.past_turns.remember(now, world_from_camera);
        let counts = &notes.counts;
        let can_refute = counts.moving_share() < TELLING_SHARE && !blind;
        if measured && counts.inliers >= TELLING_INLIERS {
            inertial.learn(now, &world_from_camera.rotation, can_refute);
        }
    }

    /// Nothing that was seen before can be compared with what comes.
    pub(super) fn forget_turns(&mut self) {
        self.past_turns.forget();
        self.carried = None;
        self.blind_at = None;
        if let Some(inertial) = &mut self.inertial {
            inertial.interrupt();
        }
    }

    /// The world of the map is another one from now on.
    pub(super) fn forget_world(&mut self) {
        self.forget_turns();
        if let Some(inertial) = &mut self.inertial {
            inertial.forget_world();
        }
    }

    /// The map was corrected: the last pose was moved from `before` to where it is now.
    pub(super) fn note_correction(&mut self, before: Option<UnitQuaternion<f64>>) {
        let now = self.state.last().map(|l| l.world_from_camera.rotation);
        let moved = before.zip(now).map(|(a, b)| a.angle_to(&b));
        if moved.is_some_and(|angle| angle > SAME_WORLD) {
            self.past_turns.forget();
            if let Some(inertial) = &mut self.inertial {
                inertial.interrupt();
            }
        }
    }
}

/// Where fewer matches lead to a pose, its direction is measured by the gyroscope as well.
pub(super) const FEW: usize = 80;
/// Landmarks that bear a pose out well enough to judge a gyroscope by it ...
const TELLING_INLIERS: u32 = 60;
/// ... and to refute it, where no more than this share of the keypoints moves.
const TELLING_SHARE: f64 = 0.35;

/// By how much a motion may turn otherwise than the gyroscope, rad.
fn gate(turn: &Turn, seconds: f64) -> f64 {
    let speed = turn.later_from_earlier.angle() / seconds.max(1e-3);
    GATE_SIGMAS * turn.sigma + GATE_POSE + GATE_TIME * speed
}

/// What is known of a pose whose direction was carried for so long, s.
fn blind_information(turn: &Turn, blind: f64) -> Mat6 {
    let place = 0.02 + BLIND_M_S * blind;
    let direction = GATE_POSE + turn.sigma;
    let of = |i: usize| if i < 3 { place } else { direction };
    Mat6::from_fn(|r, c| if r == c { 1.0 / (of(r) * of(r)) } else { 0.0 })
}

/// Which of two votes is the camera's: that of any motion, and that of motions which turn as the gyroscope says.
pub(super) struct Choice {
    pub(super) vote: Option<Vote>,
    /// Whether what most of the image agrees on turns otherwise.
    pub(super) against: bool,
}

/// A vote of motions that turn as the gyroscope says counts where at least this share of the other one's weight agrees with it, while the gyroscope is not confirmed.
const UNCONFIRMED_SHARE: f64 = 0.5;

impl Choice {
    /// Takes the bound vote unless most of what is seen says otherwise of a sensor that nothing has confirmed yet. `agrees`: whether the free one turns as the
    /// gyroscope says.
    pub(super) fn between(
        free: Option<Vote>,
        bound: Option<Vote>,
        agrees: bool,
        confirmed: bool,
    ) -> Self {
        if agrees {
            // Both are about the same motion, and the bound one is the more exact.
            return Self {
                vote: bound.or(free),
                against: false,
            };
        }
        let share = |vote: &Option<Vote>| vote.as_ref().map_or(0.0, |v| v.share);
        let weak = share(&bound) < UNCONFIRMED_SHARE * share(&free);
        let vote = match confirmed || !weak {
            // Which of the two it is, is not for matches by descriptor to say.
            true => bound.map(|v| Vote { exact: true, ..v }),
            false => free,
        };
        Self {
            vote,
            against: weak,
        }
    }
}
