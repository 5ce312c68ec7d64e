//! Revokes keyframes with wrong poses.

use crate::sparse::Sparse;
use crate::{Keyframe, KeyframeId, LandmarkId, Map, MapView};
use std::sync::Arc;

impl Map {
    /// An independent, mutable map that starts as a copy of a view.
    #[must_use]
    pub fn from_view(view: &MapView, levels: usize, scale_factor: f32) -> Self {
        let mut observations = Sparse::empty(view.landmark_bound());
        for (id, l) in view.landmarks() {
            observations.set(id.index(), Vec::with_capacity(l.observers as usize));
        }
        for k in view.keyframes() {
            for (feature, landmark) in k.matches.iter().enumerate() {
                if let Some(list) = landmark.and_then(|l| observations.get_mut(l.index())) {
                    list.push((k.id, feature as u32));
                }
            }
        }
        Self {
            view: view.clone(),
            observations,
            ..Self::new(levels, scale_factor)
        }
    }

    /// Revokes all live keyframes selected by `doomed`, whose poses are unreliable. Their observations are removed;
    /// landmarks also seen by others are repositioned from those. Tombstones and children are reattached to the
    /// keyframe `onto`, which stays. Returns the number of revoked keyframes.
    pub fn revoke(&mut self, doomed: impl Fn(&Keyframe) -> bool, onto: KeyframeId) -> u32 {
        let live = self.view.keyframes().filter(|k| k.id != onto && doomed(k));
        let doomed: Vec<KeyframeId> = live.map(|k| k.id).collect();
        if self.view.keyframe(onto).is_none() || doomed.is_empty() {
            return 0;
        }
        let mut orphans: Vec<LandmarkId> = Vec::new();
        for id in &doomed {
            if let Some(k) = self.keyframe_mut(*id) {
                k.parent = Some(onto);
                orphans.extend(k.matches.iter().flatten());
            }
        }
        let hang_on_doomed = |k: &&Arc<Keyframe>| {
            k.parent.is_some_and(|p| {
                let p = self.view.resolve_keyframe(p);
                p.is_none_or(|p| doomed.contains(&p))
            })
        };
        let children = self.view.keyframes().filter(hang_on_doomed).map(|k| k.id);
        let children: Vec<KeyframeId> = children.collect();
        for id in children {
            if let Some(k) = self.keyframe_mut(id) {
                k.parent = (id != onto).then_some(onto);
            }
        }
        let culled = doomed.iter().filter(|id| self.cull_keyframe(**id)).count();
        orphans.sort_unstable();
        orphans.dedup();
        for id in orphans {
            self.put_where_seen(id);
        }
        culled as u32
    }

    /// Sets a landmark's position from its anchor's observation, if that has depth.
    fn put_where_seen(&mut self, id: LandmarkId) {
        let Some(anchor) = self.view.landmark(id).map(|l| l.anchor) else {
            return;
        };
        let observed = self.observations(id).iter().find(|o| o.0 == anchor);
        let seen = observed.and_then(|(k, feature)| {
            let k = self.view.keyframe(*k)?;
            let point = k.data.point_in_camera(*feature as usize)?;
            Some(k.world_from_camera.transform(&point))
        });
        if let Some(position) = seen {
            self.set_position(id, position);
        }
        self.refresh_landmark(id);
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::{KeyframeData, NewLandmark};
    use stillpoint_features::{Descriptor, Edge, FeatureGrid, Keypoint};
    use stillpoint_geometry::{Camera, Se3, Vec3};

    const FEATURES: usize = 6;

    /// Keyframes in a row, a decimetre apart, each a child of the previous one. All observe the same points at a depth
    /// of 2 m; each point was created by the first, at a wrong position.
    fn map(keyframes: u32) -> (Map, Vec<LandmarkId>) {
        let camera = Camera::pinhole(640, 480, [500.0, 500.0, 320.0, 240.0]);
        let positions: Vec<[f32; 2]> = (0..FEATURES).map(|i| [90.0 * i as f32, 50.0]).collect();
        let keypoint = |p: &[f32; 2]| Keypoint {
            x: p[0],
            y: p[1],
            level: 0,
            angle: 0.0,
            response: 1.0,
            edge: Edge::default(),
        };
        let grid = FeatureGrid::build(
            &positions,
            &[0; FEATURES],
            KeyframeData::grid_bounds(&camera),
        );
        let data = Arc::new(KeyframeData {
            stamp: 0.0,
            camera,
            keypoints: positions.iter().map(keypoint).collect(),
            sigma_px: vec![1.0; FEATURES],
            depths: vec![2.0; FEATURES],
            depth_sigmas: vec![0.01; FEATURES],
            descriptors: Arc::new(vec![Descriptor([7; 4]); FEATURES]),
            mappable: vec![true; FEATURES],
            positions,
            grid,
        });
        let mut map = Map::new(8, 1.2);
        for k in 0..keyframes {
            let pose = Se3 {
                translation: Vec3::new(0.1 * f64::from(k), 0.0, 0.0),
                ..Se3::identity()
            };
            let parent = k.checked_sub(1).map(KeyframeId);
            map.insert_keyframe(KeyframeId(k), Arc::clone(&data), pose, parent);
        }
        let made = (0..FEATURES).map(|i| {
            let observation = (KeyframeId(0), i as u32);
            let position = Vec3::new(9.0, 9.0, 9.0);
            let new = NewLandmark {
                position,
                observation,
            };
            let landmark = map.insert_landmark(&new).unwrap();
            // Only the first two keyframes observe the last feature.
            let last = if i + 1 == FEATURES { 2 } else { keyframes };
            for k in 1..last {
                map.add_observation(landmark, KeyframeId(k), i as u32);
            }
            landmark
        });
        let made: Vec<LandmarkId> = made.collect();
        for k in 0..keyframes {
            map.refresh_covisibility(KeyframeId(k), 1);
        }
        (map, made)
    }

    #[test]
    fn revoking_moves_landmarks_to_remaining_observers() {
        let (mut map, landmarks) = map(5);
        assert_eq!(map.revoke(|k| k.id.0 < 3, KeyframeId(3)), 3);
        assert_eq!(map.check(), Ok(()));
        let view = map.view();
        let left: Vec<u32> = view.keyframes().map(|k| k.id.0).collect();
        assert_eq!(left, [3, 4]);
        // Their poses are relative to the one that stays.
        for k in 0..3 {
            assert_eq!(view.resolve_keyframe(KeyframeId(k)), Some(KeyframeId(3)));
            let pose = view.world_from_keyframe(KeyframeId(k)).unwrap();
            assert!((pose.translation.x - 0.1 * f64::from(k)).abs() < 1e-9);
        }
        assert_eq!(view.keyframe(KeyframeId(3)).unwrap().parent, None);
        let (gone, stay) = landmarks.split_last().unwrap();
        assert!(view.landmark(*gone).is_none());
        let k = view.keyframe(KeyframeId(3)).unwrap();
        for (feature, id) in stay.iter().enumerate() {
            let seen = k.data.point_in_camera(feature).unwrap();
            let expected = k.world_from_camera.transform(&seen);
            let position = view.landmark_position(*id).unwrap();
            assert!((position - expected).norm() < 1e-9, "{position}");
            assert_eq!(view.landmark(*id).unwrap().observers, 2);
        }
    }

    #[test]
    fn revoking_needs_a_keyframe_that_stays() {
        let (mut map, _) = map(3);
        let before = map.view().keyframe_count();
        assert_eq!(map.revoke(|_| true, KeyframeId(9)), 0);
        assert_eq!(map.revoke(|_| false, KeyframeId(1)), 0);
        assert_eq!((map.view().keyframe_count(), map.check()), (before, Ok(())));
        // The keyframe that stays is kept even if the predicate selects it for removal.
        assert_eq!(map.revoke(|_| true, KeyframeId(1)), 2);
        assert_eq!((map.view().keyframe_count(), map.check()), (1, Ok(())));
    }

    #[test]
    fn map_copied_from_a_view_is_independent() {
        let (mut original, landmarks) = map(4);
        let view = original.publish();
        let mut copy = Map::from_view(&view, 8, 1.2);
        assert_eq!(copy.check(), Ok(()));
        for id in &landmarks {
            assert_eq!(copy.observations(*id), original.observations(*id));
        }
        copy.revoke(|k| k.id.0 < 2, KeyframeId(2));
        assert_eq!((copy.check(), original.check()), (Ok(()), Ok(())));
        assert_eq!(view.keyframe_count(), 4);
    }
}
