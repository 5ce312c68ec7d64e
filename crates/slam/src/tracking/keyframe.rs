//! When a frame becomes a keyframe: when it sees what the map does not hold, or holds it from elsewhere.
//!
//! Both are measured against keyframes, not against landmarks that several keyframes confirmed: such a count never falls where
//! keyframes are rare.

use crate::anchored_pose::AnchoredPose;
use crate::validation::Checker;
use crate::view_angle::view_angle;
use serde::{Deserialize, Serialize};
use stillpoint_geometry::Se3;
use stillpoint_map::{Keyframe, MapView};

/// When a frame becomes a keyframe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct KeyframeConfig {
    /// A keyframe is due when fewer landmarks are tracked than this share of the most that were tracked since the last keyframe.
    /// Range: 0.1 to 1. At 0.75, as in ORB-SLAM2, three quarters of what holds the camera are still seen by the next keyframe.
    pub min_tracked_share: f64,
    /// A keyframe is due when no keyframe around has seen the scene from within this angle, rad: the turn between both, and the distance over
    /// the median depth. Range: 0 to 3. From 0.1 rad on two pixels tell a depth to 2 %, as well as the sensor does.
    pub max_view_angle: f64,
    /// Time between two keyframes, at least, s. Range: 0 to 100. Nearer ones share all they see; this is three frames of 30 Hz, with their jitter.
    pub min_seconds: f64,
}

impl Default for KeyframeConfig {
    fn default() -> Self {
        Self {
            min_tracked_share: 0.75,
            max_view_angle: 0.1,
            min_seconds: 0.09,
        }
    }
}

impl KeyframeConfig {
    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("min_tracked_share", self.min_tracked_share, 0.1, 1.0);
        c.range("max_view_angle", self.max_view_angle, 0.0, 3.0);
        c.range("min_seconds", self.min_seconds, 0.0, 100.0);
    }
}

/// The last keyframe, and what was tracked since.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Coverage {
    /// Where it was taken from. It may not be in the tracker's view yet, and it may be culled.
    last: AnchoredPose,
    /// Landmarks that a frame tracked since, at most.
    most_tracked: usize,
}

impl Coverage {
    /// That of a new keyframe, which `tracked` landmarks hold.
    pub(super) fn of(keyframe: AnchoredPose, tracked: usize) -> Self {
        Self {
            last: keyframe,
            most_tracked: tracked,
        }
    }

    /// Takes note of how many landmarks a frame tracks.
    pub(super) fn note(&mut self, tracked: usize) {
        self.most_tracked = self.most_tracked.max(tracked);
    }

    /// Whether a keyframe is due where the camera tracks so many landmarks.
    pub(super) fn lacks_landmarks(&self, config: &KeyframeConfig, tracked: usize) -> bool {
        (tracked as f64) < config.min_tracked_share * self.most_tracked as f64
    }

    /// Whether a keyframe is due for the view from `world_from_camera` of a scene at a median `depth`, m: neither the last keyframe nor the
    /// reference or one that shares landmarks with it has seen it from there.
    pub(super) fn lacks_view(
        &self,
        config: &KeyframeConfig,
        (view, reference): (&MapView, &Keyframe),
        world_from_camera: &Se3,
        depth: Option<f64>,
    ) -> bool {
        // Where nothing has a depth, a shift shows nothing new.
        let depth = depth.unwrap_or(f64::INFINITY);
        let is_new = |from: &Se3| {
            view_angle(&(from.inverse() * *world_from_camera), depth) >= config.max_view_angle
        };
        let covisible = reference.covisible.iter();
        let others = covisible.filter_map(|(id, _)| view.keyframe(*id));
        is_new(&self.last.best_world_from_camera(view))
            && is_new(&reference.world_from_camera)
            && others.map(|k| &k.world_from_camera).all(is_new)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A failed helper is a failed test.
    use super::*;
    use std::sync::Arc;
    use stillpoint_geometry::{Vec3, so3};
    use stillpoint_map::{KeyframeData, KeyframeId, Map};

    fn at(x: f64, turn: f64) -> Se3 {
        let rotation = so3::exp(&Vec3::new(0.0, turn, 0.0));
        Se3::new(rotation, Vec3::new(x, 0.0, 0.0))
    }

    /// What a camera sees of a wall, m.
    fn wall(depth: f32) -> KeyframeData {
        KeyframeData {
            depths: vec![0.0, depth, depth, depth],
            ..crate::synthetic::blank_keyframe(0.0)
        }
    }

    /// Whether the view from `pose` on a wall is new, where the first of the keyframes is the reference and the last one was made last.
    fn is_new(keyframes: &[Se3], pose: &Se3, depth: f32) -> bool {
        let mut map = Map::new(8, 1.2);
        for (id, pose) in (0..).zip(keyframes) {
            map.insert_keyframe(KeyframeId(id), Arc::new(wall(depth)), *pose, None);
        }
        let view = map.publish();
        let reference = view.keyframe(KeyframeId(0)).unwrap();
        let last = AnchoredPose {
            online_world_from_camera: *keyframes.last().unwrap(),
            reference: KeyframeId(99),
            ..AnchoredPose::default()
        };
        let config = KeyframeConfig::default();
        let median = wall(depth).median_depth(&mut Vec::new());
        Coverage::of(last, 500).lacks_view(&config, (&view, reference), pose, median)
    }

    #[test]
    fn a_view_is_new_by_what_it_shows() {
        let here = [at(0.0, 0.0)];
        // A shift counts by the angle under which it appears, a turn by itself, and both add up.
        assert!(!is_new(&here, &at(0.19, 0.0), 2.0));
        assert!(is_new(&here, &at(0.21, 0.0), 2.0));
        assert!(!is_new(&here, &at(0.21, 0.0), 4.0));
        assert!(!is_new(&here, &at(0.0, 0.09), 4.0));
        assert!(is_new(&here, &at(0.0, 0.11), 4.0));
        assert!(is_new(&here, &at(0.2, 0.06), 4.0));
        // Where nothing is known of depths only a turn shows something new.
        assert!(!is_new(&here, &at(100.0, 0.09), 0.0));
        assert!(is_new(&here, &at(0.0, 0.11), 0.0));
    }

    #[test]
    fn a_view_that_a_keyframe_has_is_not_new() {
        // The last keyframe covers it though the map does not hold it yet, and so does the reference after a way there and back.
        assert!(!is_new(&[at(0.0, 0.0), at(0.5, 0.0)], &at(0.45, 0.0), 2.0));
        assert!(!is_new(&[at(0.0, 0.0), at(0.5, 0.0)], &at(0.05, 0.0), 2.0));
        assert!(is_new(&[at(0.0, 0.0), at(0.5, 0.0)], &at(0.25, 0.0), 2.0));
    }

    #[test]
    fn landmarks_that_fade_away_make_a_keyframe_due() {
        let config = KeyframeConfig::default();
        let mut coverage = Coverage::of(AnchoredPose::default(), 300);
        // What a keyframe adds to the map is tracked after it: the measure is the most since then.
        for (tracked, due) in [(400, false), (500, false), (376, false), (374, true)] {
            coverage.note(tracked);
            assert_eq!(
                coverage.lacks_landmarks(&config, tracked),
                due,
                "{tracked} are tracked"
            );
        }
        // Where the camera stands still, as many are tracked for ever.
        let mut still = Coverage::of(AnchoredPose::default(), 450);
        for frame in 0..1000 {
            let tracked = 450 + 40 * (frame % 3);
            still.note(tracked);
            assert!(!still.lacks_landmarks(&config, tracked));
        }
    }
}
