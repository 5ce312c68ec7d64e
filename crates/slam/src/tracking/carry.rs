//! Propagates the pose over frames without visual pose, by odometry or gyroscope.

use super::known::{GATE_POSE, Known};
use super::outcome::Ending;
use super::statistics::Sightings;
use super::{Notes, Solution, Tracker};
use crate::messages::Exposure;
use stillpoint_geometry::{Mat6, Se3};
use stillpoint_imaging::{FrameId, RgbdFrame};
use stillpoint_map::{KeyframeData, KeyframeId};

/// Maximum duration of propagation by gyroscope, s: a bias that is known to 0.1 deg/s makes half a degree of it, as
/// much as a configured mount is off by (decision 39).
const CARRIED_S: f64 = 5.0;
/// Maximum duration of propagation by wheel odometry, s: some metres, that are known to a few per cent. Chosen: at 0.5
/// m/s a path of 15 m, of which an indoor robot's wheels make 0.3 m by their usual slip.
const WHEELED_S: f64 = 30.0;
/// Half-life of the camera's velocity without measurements, s: people do not walk on without seeing. Chosen: after half
/// a second, about a step, a tenth of it is left.
const HALVED_S: f64 = 0.15;
/// Duration after propagation during which the motion of most of the image is not taken for the camera's, s: with it,
/// the rotation after a turn with blocked view is off by 0.43 degrees instead of 1.57 (decision 39).
const BLIND_S: f64 = 1.0;
/// Uncertainty of the position after a second without measurements, m: one standard deviation. Chosen: a quarter of the
/// 1.3 m/s that people walk at (Bohannon, Age and Ageing 1997).
const BLIND_M_S: f64 = 0.3;
/// Uncertainty of the position from which odometry propagates, m: chosen, the tolerance between two poses elsewhere
/// (`trust::SLACK`).
const PLACE_M: f64 = 0.02;

#[derive(Clone, Copy, Debug)]
pub(super) struct Carried {
    pub(super) since: FrameId,
    /// On the frames' clock, s.
    began: f64,
}

impl Tracker {
    /// Propagates the pose over a frame without visual pose: by odometry; else the rotation by gyroscope, and the
    /// position from the few static points or by decaying velocity. `None` without a confirmed sensor, or after too
    /// long.
    pub(super) fn carry(
        &mut self,
        frame: &RgbdFrame,
        data: &std::sync::Arc<KeyframeData>,
        notes: &mut Notes,
    ) -> Option<Ending> {
        let last = self.state.tracked()?;
        let known = self.trusted_since_last()?;
        let now = self.front_end.clock.now();
        let carried = self.sensors.carried.unwrap_or(Carried {
            since: frame.id,
            began: last.time,
        });
        let blind = now - carried.began;
        let by_wheels = known.pose_after(&last.world_from_camera.inverse());
        if blind > by_wheels.map_or(CARRIED_S, |_| WHEELED_S) {
            return None;
        }
        let reference = self.reference_of(last.pose.reference);
        // Few points may lie on a moving object; wheel odometry is safe from that.
        let camera_from_world = match (by_wheels, notes.bound.take()) {
            (Some(pose), _) => pose,
            (None, Some(vote)) => vote.camera_from_world,
            (None, None) => self.slowed(&known, now - last.time)?,
        };
        let all = self.known(carried.began, now);
        notes.evidence.information = Some(blind_information(&known, all.as_ref(), blind));
        (notes.evidence.scatter, notes.evidence.reference) = (None, Some(reference));
        let solution = Solution {
            data: std::sync::Arc::clone(data),
            camera_from_world,
            reference,
            matches: vec![None; data.len()],
            sightings: Sightings::default(),
            exposure: Exposure::default(),
            followed: Vec::new(),
            recognised: None,
        };
        notes.counts.inliers = 0;
        self.sensors.carried = Some(carried);
        self.sensors.blind_at = Some(now);
        let world_from_camera = camera_from_world.inverse();
        self.learn_motion(notes, &world_from_camera, false);
        Some(self.accept_carried(frame, solution, carried.since))
    }

    /// Whether the view was blocked recently, so that the pose had to be propagated. Matches that agree then may well
    /// lie on a moving person.
    pub(super) fn was_blind(&self) -> bool {
        let now = self.front_end.clock.now();
        self.sensors.blind_at.is_some_and(|at| now - at < BLIND_S)
    }

    /// The reference keyframe in the newest view of the map.
    fn reference_of(&self, id: KeyframeId) -> KeyframeId {
        self.map.view.resolve_keyframe(id).unwrap_or(id)
    }

    /// The pose `dt` seconds after the last one, with the sensor's rotation and a decaying velocity.
    fn slowed(&self, known: &Known, dt: f64) -> Option<Se3> {
        let last = self.state.tracked()?;
        let turn = known.turn.later_from_earlier;
        let rotation = turn * last.world_from_camera.rotation.inverse();
        let from = last.world_from_camera.translation;
        let straight = self.state.continued(dt)?.inverse().translation - from;
        let place = from + straight * libm::exp2(-dt / HALVED_S);
        Some(Se3::new(rotation, -(rotation * place)))
    }
}

/// Information of a pose propagated for `blind` seconds, from the sensors since the last frame (`known`) and since the
/// beginning (`all`).
fn blind_information(known: &Known, all: Option<&Known>, blind: f64) -> Mat6 {
    let wheels = all.and_then(|k| k.shift.map(|s| (s.sigma, k.turn.sigma)));
    let (place, direction) = match wheels {
        Some((place, direction)) => (PLACE_M + place, GATE_POSE + direction),
        None => (PLACE_M + BLIND_M_S * blind, GATE_POSE + known.turn.sigma),
    };
    let of = |i: usize| if i < 3 { place } else { direction };
    Mat6::from_fn(|r, c| if r == c { 1.0 / (of(r) * of(r)) } else { 0.0 })
}
