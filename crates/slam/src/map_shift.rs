//! Differences between two versions of the map.

use stillpoint_map::MapView;

/// Difference between two versions of the map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MapShift {
    /// Keyframes in both with changed poses.
    pub keyframes: u32,
    /// Landmarks in both with changed positions.
    pub landmarks: u32,
    /// Largest displacement of a keyframe that stayed in its submap, m; others changed their reference frame.
    pub farthest_m: f64,
    /// Largest rotation of such a keyframe, rad.
    pub largest_turn_rad: f64,
}

impl MapShift {
    /// Compares two versions.
    #[must_use]
    pub fn between(before: &MapView, after: &MapView) -> Self {
        let mut shift = Self::default();
        for now in after.keyframes() {
            let Some(was) = before.keyframe(now.id) else {
                continue;
            };
            let (from, to) = (&was.world_from_camera, &now.world_from_camera);
            if from == to {
                continue;
            }
            shift.keyframes += 1;
            if was.submap == now.submap {
                let distance = (to.translation - from.translation).norm();
                let turn = (from.inverse() * *to).log().fixed_rows::<3>(3).norm();
                shift.farthest_m = shift.farthest_m.max(distance);
                shift.largest_turn_rad = shift.largest_turn_rad.max(turn);
            }
        }
        for (id, _) in after.landmarks() {
            let was = before.landmark_position(id);
            let moved = was.is_some() && was != after.landmark_position(id);
            shift.landmarks += u32::from(moved);
        }
        shift
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use stillpoint_geometry::{Se3, Vec3, Vec6};
    use stillpoint_map::{KeyframeId, Map};

    #[test]
    fn moved_keyframes_are_counted_with_the_maximum_shift() {
        let data = Arc::new(crate::synthetic::blank_keyframe(0.0));
        let mut map = Map::new(5, 1.45);
        for k in 0..4 {
            let parent = (k > 0).then_some(KeyframeId(0));
            map.insert_keyframe(KeyframeId(k), Arc::clone(&data), Se3::identity(), parent);
        }
        let before = map.publish();
        assert_eq!(
            MapShift::between(&before, &map.publish()),
            MapShift::default()
        );
        let at = |x: f64, turn: f64| {
            let mut pose = Se3::exp(&Vec6::new(0.0, 0.0, 0.0, 0.0, turn, 0.0));
            pose.translation = Vec3::new(x, 0.0, 0.0);
            pose
        };
        map.set_pose(KeyframeId(1), at(0.1, 0.3));
        map.set_pose(KeyframeId(2), at(0.2, 0.0));
        map.insert_keyframe(KeyframeId(4), data, at(9.0, 0.0), Some(KeyframeId(0)));
        let shift = MapShift::between(&before, &map.publish());
        assert_eq!((shift.keyframes, shift.landmarks), (2, 0));
        assert!((shift.farthest_m - 0.2).abs() < 1e-12, "{shift:?}");
        assert!((shift.largest_turn_rad - 0.3).abs() < 1e-12, "{shift:?}");
    }
}
