//! Keyframe selection: a frame becomes a keyframe if it sees unmapped parts of the scene, or the same parts from a new
//! viewpoint.
//!
//! Both criteria compare with keyframes, not with landmarks confirmed by several keyframes: such a count never falls
//! where keyframes are rare.

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
    /// A keyframe is due if fewer landmarks are tracked than this share of the maximum since the last keyframe. Range:
    /// 0.1 to 1. At 0.75, as in ORB-SLAM2, the next keyframe still sees three quarters of the landmarks.
    pub min_tracked_share: f64,
    /// A keyframe is due if no nearby keyframe has seen the scene from within this angle, rad: rotation plus distance
    /// over median depth. Range: 0 to 3. From 0.1 rad on two pixels determine depth to 2 %, as well as the sensor does.
    pub max_view_angle: f64,
    /// Minimum time between two keyframes, s. Range: 0 to 100. Nearer ones are redundant; the default is three frames
    /// of 30 Hz, with their jitter.
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

/// The last keyframe, and tracking since.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Coverage {
    /// Its pose. The keyframe may not be in the tracker's view yet, or may be culled.
    last: AnchoredPose,
    /// Maximum number of landmarks tracked in a frame since.
    most_tracked: usize,
}

impl Coverage {
    pub(super) fn of(keyframe: AnchoredPose, tracked: usize) -> Self {
        Self {
            last: keyframe,
            most_tracked: tracked,
        }
    }

    pub(super) fn note(&mut self, tracked: usize) {
        self.most_tracked = self.most_tracked.max(tracked);
    }

    /// Whether a keyframe is due with this number of tracked landmarks.
    pub(super) fn lacks_landmarks(&self, config: &KeyframeConfig, tracked: usize) -> bool {
        (tracked as f64) < config.min_tracked_share * self.most_tracked as f64
    }

    /// Whether a keyframe is due for the view from `world_from_camera` of a scene at a median `depth`, m: whether
    /// neither the last keyframe, nor the reference, nor one covisible with it has a similar view.
    pub(super) fn lacks_view(
        &self,
        config: &KeyframeConfig,
        (view, reference): (&MapView, &Keyframe),
        world_from_camera: &Se3,
        depth: Option<f64>,
    ) -> bool {
        // Without depth, translation shows nothing new.
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

    /// Keyframe data with a wall at this depth, m.
    fn wall(depth: f32) -> KeyframeData {
        KeyframeData {
            depths: vec![0.0, depth, depth, depth],
            ..crate::synthetic::blank_keyframe(0.0)
        }
    }

    /// Whether the view from `pose` on a wall is new, with the first keyframe as reference and the last one as the
    /// newest.
    fn is_new(keyframes: &[Se3], pose: &Se3, depth: f32) -> bool {
        let mut map = Map::new(5, 1.45);
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
    fn view_is_new_by_its_viewing_angle() {
        let here = [at(0.0, 0.0)];
        // Translation counts by its viewing angle, rotation directly, and both add up.
        assert!(!is_new(&here, &at(0.19, 0.0), 2.0));
        assert!(is_new(&here, &at(0.21, 0.0), 2.0));
        assert!(!is_new(&here, &at(0.21, 0.0), 4.0));
        assert!(!is_new(&here, &at(0.0, 0.09), 4.0));
        assert!(is_new(&here, &at(0.0, 0.11), 4.0));
        assert!(is_new(&here, &at(0.2, 0.06), 4.0));
        // Without depth only rotation counts.
        assert!(!is_new(&here, &at(100.0, 0.09), 0.0));
        assert!(is_new(&here, &at(0.0, 0.11), 0.0));
    }

    #[test]
    fn view_near_any_keyframe_is_not_new() {
        // The last keyframe counts before the map contains it, and so does the reference after a return.
        assert!(!is_new(&[at(0.0, 0.0), at(0.5, 0.0)], &at(0.45, 0.0), 2.0));
        assert!(!is_new(&[at(0.0, 0.0), at(0.5, 0.0)], &at(0.05, 0.0), 2.0));
        assert!(is_new(&[at(0.0, 0.0), at(0.5, 0.0)], &at(0.25, 0.0), 2.0));
    }

    #[test]
    fn loss_of_landmarks_makes_a_keyframe_due() {
        let config = KeyframeConfig::default();
        let mut coverage = Coverage::of(AnchoredPose::default(), 300);
        // A keyframe adds landmarks, so the maximum is counted from then on.
        for (tracked, due) in [(400, false), (500, false), (376, false), (374, true)] {
            coverage.note(tracked);
            assert_eq!(
                coverage.lacks_landmarks(&config, tracked),
                due,
                "{tracked} are tracked"
            );
        }
        let mut still = Coverage::of(AnchoredPose::default(), 450);
        for frame in 0..1000 {
            let tracked = 450 + 40 * (frame % 3);
            still.note(tracked);
            assert!(!still.lacks_landmarks(&config, tracked));
        }
    }
}
