//! Loop candidates by position: places expected in view of which nothing is matched. After a fast turn a pose may be
//! off by some degrees; tracking then searches landmarks in the wrong place, and everything is mapped twice.
//!
//! Such places need no recognition by appearance: their landmarks are searched in wide windows around the expected
//! positions.

use super::LoopCloser;
use super::nodes::group_of;
use super::recognise::{By, CANDIDATES, Candidate, NEWEST};
use crate::association::{
    RATIO, STRICT_DISTANCE, landmarks_of, measurement, measurement_in, window_of,
};
use stillpoint_estimation::RigidPair;
use stillpoint_features::best_two;
use stillpoint_geometry::{Se3, Vec3};
use stillpoint_map::{Keyframe, KeyframeId, LandmarkId, MapView};

/// Minimum number of landmarks of an older keyframe expected in the image (decision 30).
const MIN_EXPECTED: usize = 40;
/// Maximum share of these that are already matched, a share (decision 30): a keyframe that shares more is where it
/// should be.
const MAX_SHARED: f64 = 0.2;
/// Search radius around a landmark's expected position, as an angle, rad: the error after some frames of a fast turn
/// with few features. Measured: 0.25 closes the loops of the same runs (decision 30).
pub(super) const REACH_RAD: f64 = 0.15;
/// Number of landmarks projected to decide whether to project all of a keyframe: where a quarter is in the image, one
/// of 16 is with a probability of 99 %.
const SAMPLE: usize = 16;

impl LoopCloser {
    /// Older keyframes of the same submap whose landmarks should be in view but are not matched; `known` candidates are
    /// excluded.
    pub(super) fn revisited(
        &self,
        view: &MapView,
        keyframe: &Keyframe,
        known: &[Candidate],
    ) -> Vec<Candidate> {
        let _span = tracing::info_span!("revisit").entered();
        if !self.config.enabled {
            return Vec::new();
        }
        let older: Vec<&Keyframe> = view
            .keyframes()
            .map(|k| &**k)
            .filter(|k| k.id < keyframe.id)
            .collect();
        let count = older.len().saturating_sub(NEWEST);
        let ahead = forward(&keyframe.world_from_camera);
        let mut found: Vec<(usize, KeyframeId)> = Vec::new();
        for old in &older[..count] {
            let aside = forward(&old.world_from_camera).dot(&ahead) < 0.5;
            let other = old.submap != keyframe.submap || known.iter().any(|c| c.with == old.id);
            if aside || other || !self.may_be_seen(view, keyframe, old) {
                continue;
            }
            let landmarks = old.matches.iter().flatten();
            let in_image = |l: &&LandmarkId| self.is_in_image(view, keyframe, **l);
            let expected = landmarks.filter(in_image).count();
            let shared = keyframe.covisible.iter().find(|c| c.0 == old.id);
            let shared = shared.map_or(0, |c| c.1);
            if expected >= MIN_EXPECTED && f64::from(shared) <= MAX_SHARED * expected as f64 {
                found.push((expected, old.id));
            }
        }
        found.sort_by_key(|(expected, id)| (std::cmp::Reverse(*expected), *id));
        found.truncate(CANDIDATES);
        let candidate = |(_, with)| Candidate {
            with,
            score: 0.0,
            rival: 0.0,
            by: By::Pose,
        };
        found.into_iter().map(candidate).collect()
    }

    /// Whether a sample of an older keyframe's landmarks has any in the image.
    fn may_be_seen(&self, view: &MapView, keyframe: &Keyframe, old: &Keyframe) -> bool {
        let step = (old.matches.len() / SAMPLE).max(1);
        let mut some = old.matches.iter().step_by(step).flatten();
        some.any(|l| self.is_in_image(view, keyframe, *l))
    }

    /// Whether a landmark should be in a keyframe's image, within its scale range.
    fn is_in_image(&self, view: &MapView, keyframe: &Keyframe, id: LandmarkId) -> bool {
        let landmark = view.landmark(id).zip(view.landmark_position(id));
        landmark.is_some_and(|(landmark, position)| {
            let p = keyframe.world_from_camera.inverse().transform(&position);
            window_of(&keyframe.data, landmark, &p, 1.0, self.scale_factor).is_some()
        })
    }

    /// Landmarks of the older keyframe paired with similar features near their expected positions.
    pub(super) fn pairs_by_pose(
        &self,
        view: &MapView,
        new: &Keyframe,
        old: &Keyframe,
    ) -> Vec<RigidPair> {
        let data = &new.data;
        let camera_from_world = new.world_from_camera.inverse();
        let old_from_world = old.world_from_camera.inverse();
        let reach = (REACH_RAD * data.camera.fx) as f32;
        let pair = |(feature, id): (usize, &Option<LandmarkId>)| {
            let landmark = view.landmark((*id)?)?;
            let position = view.landmark_position((*id)?)?;
            let p = camera_from_world.transform(&position);
            let mut window = window_of(data, landmark, &p, reach, self.scale_factor)?;
            // An error of the pose moves all levels alike.
            window.radius = reach;
            let best = best_two(&data.searched(), &window, &landmark.descriptor, |j| {
                data.mappable[j as usize]
            })?;
            let unique =
                f64::from(best.distance) < f64::from(RATIO) * f64::from(best.second_distance);
            if best.distance > STRICT_DISTANCE || !unique {
                return None;
            }
            let seen = best.index as usize;
            Some(RigidPair {
                point_a: old_from_world.transform(&position),
                point_b: data.point_in_camera(seen)?,
                measurement_a: measurement_in(&old.data, feature, &data.camera),
                measurement_b: measurement(data, seen),
            })
        };
        old.matches.iter().enumerate().filter_map(pair).collect()
    }
}

fn forward(world_from_camera: &Se3) -> Vec3 {
    world_from_camera.rotation * Vec3::z()
}

/// Landmarks around an older keyframe, from the older half of keyframes only: landmarks mapped twice would confirm the
/// current pose.
pub(super) fn landmarks_of_then(view: &MapView, old: &Keyframe, new: &Keyframe) -> Vec<LandmarkId> {
    let middle = old.id.0 + (new.id.0 - old.id.0) / 2;
    let mut group = group_of(old);
    group.retain(|id| id.0 <= middle);
    landmarks_of(view, &group)
}
