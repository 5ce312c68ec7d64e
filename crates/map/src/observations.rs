//! Changes of landmarks and their observations.

use crate::{KeyframeData, KeyframeId, Landmark, LandmarkId, Map, ScaleRange, SubmapId};
use std::sync::Arc;
use stillpoint_features::Descriptor;
use stillpoint_geometry::{Se3, Vec3};

/// A landmark to be created.
#[derive(Clone, Copy, Debug)]
pub struct NewLandmark {
    /// World position, m.
    pub position: Vec3,
    /// The first observation (keyframe, feature), which becomes the anchor.
    pub observation: (KeyframeId, u32),
}

impl Map {
    /// Observations of a landmark as (keyframe, feature), by keyframe id.
    #[must_use]
    pub fn observations(&self, id: LandmarkId) -> &[(KeyframeId, u32)] {
        self.observations.get(id.index()).map_or(&[], |v| v)
    }

    /// A live landmark, to change its position or counters. Change observations only through the map's methods.
    pub fn landmark_mut(&mut self, id: LandmarkId) -> Option<&mut Landmark> {
        self.view.landmarks.get_mut(id.index()).map(Arc::make_mut)
    }

    /// Sets a landmark's world position (m), given the present pose of its anchor.
    pub fn set_position(&mut self, id: LandmarkId, position: Vec3) {
        let Some(anchor) = self.view.landmark(id).map(|l| l.anchor) else {
            return;
        };
        let Some(pose) = self.view.keyframe(anchor).map(|k| k.world_from_camera) else {
            return;
        };
        if let Some(l) = self.landmark_mut(id) {
            l.position_in_anchor = pose.inverse().transform(&position);
        }
    }

    /// Creates a landmark with its first observation; `None` when the feature already observes one or is not mappable.
    pub fn insert_landmark(&mut self, new: &NewLandmark) -> Option<LandmarkId> {
        let (keyframe, feature) = new.observation;
        let k = self.view.keyframe(keyframe)?;
        if k.matches.get(feature as usize)?.is_some() || !k.data.mappable[feature as usize] {
            return None;
        }
        let id = LandmarkId::new(self.view.landmarks.len() as u32);
        let position_in_anchor = k.world_from_camera.inverse().transform(&new.position);
        let landmark = Landmark {
            anchor: keyframe,
            position_in_anchor,
            direction_in_anchor: position_in_anchor / position_in_anchor.norm().max(1e-12),
            scale_range: self.scale_range(&k.data, feature, position_in_anchor.norm()),
            descriptor: k.data.descriptors[feature as usize],
            observers: 0,
            depth_observers: 0,
            created_at: keyframe,
            static_odds: 0.0,
            visible: 1,
            found: 1,
        };
        self.view.landmarks.set(id.index(), Arc::new(landmark));
        self.observations.set(id.index(), Vec::new());
        self.view.merged.grow(self.view.landmarks.len());
        self.view.live_landmarks += 1;
        self.add_observation(id, keyframe, feature);
        Some(id)
    }

    fn scale_range(&self, data: &KeyframeData, feature: u32, distance: f64) -> ScaleRange {
        let level = usize::from(data.keypoints[feature as usize].level);
        let coarsest = self.level_scales.len() - 1;
        let max_distance = distance as f32 * self.level_scales[level.min(coarsest)];
        ScaleRange {
            min_distance: max_distance / self.level_scales[coarsest],
            max_distance,
        }
    }

    /// Replaces the measurements of a keyframe's features with other positions and depths. Landmarks anchored in it move
    /// along. Returns false, without changes, when the keyframe is not live or has another number of features.
    pub fn remeasure(&mut self, id: KeyframeId, data: KeyframeData) -> bool {
        let Some(k) = self.view.keyframe(id).cloned() else {
            return false;
        };
        if k.data.len() != data.len() {
            return false;
        }
        let (old, data) = (&k.data, Arc::new(data));
        if let Some(k) = self.keyframe_mut(id) {
            k.data = Arc::clone(&data);
        }
        for (i, landmark) in k.matches.iter().enumerate() {
            let Some(landmark) = *landmark else { continue };
            if let Some(l) = self.landmark_mut(landmark).filter(|l| l.anchor == id) {
                let z = l.position_in_anchor.z;
                let nearer = f64::from(old.depths[i] - data.depths[i]);
                let moved = data.camera.backproject(data.position(i), z - nearer)
                    - old.camera.backproject(old.position(i), z);
                l.position_in_anchor += moved;
            }
            self.refresh_landmark(landmark);
        }
        true
    }

    /// Adds an observation. Returns false, without changes, when the landmark or keyframe is not live, the feature
    /// already observes a landmark or is not mappable, the keyframe already observes the landmark, or they are in
    /// different submaps.
    pub fn add_observation(&mut self, id: LandmarkId, keyframe: KeyframeId, feature: u32) -> bool {
        let submap = self.submap_of_landmark(id);
        if submap.is_none() || self.view.keyframe(keyframe).map(|k| k.submap) != submap {
            return false;
        }
        let Err(at) = self
            .observations(id)
            .binary_search_by_key(&keyframe, |o| o.0)
        else {
            return false;
        };
        let Some(k) = self.keyframe_mut(keyframe) else {
            return false;
        };
        let Some(slot @ None) = k.matches.get_mut(feature as usize) else {
            return false;
        };
        if !k.data.mappable[feature as usize] {
            return false;
        }
        *slot = Some(id);
        let has_depth = k.data.depths[feature as usize] > 0.0;
        if let Some(list) = self.observations.get_mut(id.index()) {
            list.insert(at, (keyframe, feature));
        }
        if let Some(l) = self.landmark_mut(id) {
            l.observers += 1;
            l.depth_observers += u32::from(has_depth);
        }
        true
    }

    pub(crate) fn submap_of_landmark(&self, id: LandmarkId) -> Option<SubmapId> {
        let anchor = self.view.landmark(id)?.anchor;
        Some(self.view.keyframe(anchor)?.submap)
    }

    /// Permanently excludes features that turned out to move: landmarks created by them are culled, others lose the
    /// observation. Returns the number of culled landmarks.
    pub fn disown(&mut self, keyframe: KeyframeId, features: &[u32]) -> u32 {
        let Some(k) = self.keyframe_mut(keyframe) else {
            return 0;
        };
        // Published views keep their data.
        let mut data = KeyframeData::clone(&k.data);
        let mut seen = Vec::new();
        for feature in features {
            if let Some(may) = data.mappable.get_mut(*feature as usize) {
                *may = false;
                seen.extend(k.matches[*feature as usize]);
            }
        }
        k.data = Arc::new(data);
        let mut culled = 0;
        for landmark in seen {
            if self
                .view
                .landmark(landmark)
                .is_some_and(|l| l.created_at == keyframe)
            {
                self.cull_landmark(landmark);
                culled += 1;
            } else {
                self.remove_observation(landmark, keyframe);
            }
        }
        culled
    }

    /// Removes an observation. A landmark without observations is culled; one that loses its anchor gets another.
    pub fn remove_observation(&mut self, id: LandmarkId, keyframe: KeyframeId) {
        let Some(list) = self.observations.get_mut(id.index()) else {
            return;
        };
        let Ok(at) = list.binary_search_by_key(&keyframe, |o| o.0) else {
            return;
        };
        let (_, feature) = list.remove(at);
        let is_last = list.is_empty();
        let mut has_depth = false;
        if let Some(k) = self.keyframe_mut(keyframe) {
            k.matches[feature as usize] = None;
            has_depth = k.data.depths[feature as usize] > 0.0;
        }
        if let Some(l) = self.landmark_mut(id) {
            l.observers -= 1;
            l.depth_observers -= u32::from(has_depth);
        }
        if is_last {
            self.cull_landmark(id);
        } else if self.view.landmark(id).is_some_and(|l| l.anchor == keyframe) {
            self.reanchor(id, keyframe);
        }
    }

    /// Moves a landmark's anchor from `old` to the first remaining observer.
    fn reanchor(&mut self, id: LandmarkId, old: KeyframeId) {
        let Some(&(anchor, _)) = self.observations(id).first() else {
            return;
        };
        let (Some(from), Some(to)) = (
            self.view.world_from_keyframe(old),
            self.view.world_from_keyframe(anchor),
        ) else {
            return;
        };
        let new_from_old = to.inverse() * from;
        if let Some(l) = self.landmark_mut(id) {
            l.anchor = anchor;
            l.position_in_anchor = new_from_old.transform(&l.position_in_anchor);
            l.direction_in_anchor = new_from_old.rotation * l.direction_in_anchor;
        }
    }

    /// Removes a landmark with its observations.
    pub fn cull_landmark(&mut self, id: LandmarkId) {
        if self.view.landmark(id).is_some() {
            self.retire_landmark(id);
        }
    }

    /// Removes a landmark and its observations, which are returned.
    fn retire_landmark(&mut self, id: LandmarkId) -> Vec<(KeyframeId, u32)> {
        let observations = self.observations.take(id.index());
        for (keyframe, feature) in observations.iter().flatten().copied() {
            if let Some(k) = self.keyframe_mut(keyframe) {
                k.matches[feature as usize] = None;
            }
        }
        if self.view.landmarks.take(id.index()).is_some() {
            self.view.live_landmarks -= 1;
        }
        observations.unwrap_or_default()
    }

    /// Merges `from` into `into`: observations move over unless they conflict, and its id resolves to `into`. Returns
    /// false when either is not live, both are equal, or they are in different submaps.
    pub fn merge_landmarks(&mut self, from: LandmarkId, into: LandmarkId) -> bool {
        let (Some(old), Some(_)) = (self.view.landmark(from), self.view.landmark(into)) else {
            return false;
        };
        if from == into || self.submap_of_landmark(from) != self.submap_of_landmark(into) {
            return false;
        }
        let (visible, found) = (old.visible, old.found);
        let observations = self.retire_landmark(from);
        self.view.merged.set(from.index(), into);
        for (keyframe, feature) in observations {
            self.add_observation(into, keyframe, feature);
        }
        if let Some(l) = self.landmark_mut(into) {
            l.visible += visible;
            l.found += found;
        }
        self.refresh_landmark(into);
        true
    }

    /// Recomputes a landmark's descriptor, viewing direction and scale range from its observations.
    pub fn refresh_landmark(&mut self, id: LandmarkId) {
        let (Some(l), Some(position)) = (self.view.landmark(id), self.view.landmark_position(id))
        else {
            return;
        };
        let anchor = l.anchor;
        let mut descriptors: Vec<Descriptor> = Vec::with_capacity(l.observers as usize);
        let mut direction = Vec3::zeros();
        let mut scale_range = l.scale_range;
        let mut anchor_from_world = Se3::identity();
        for &(keyframe, feature) in self.observations(id) {
            let Some(k) = self.view.keyframe(keyframe) else {
                continue;
            };
            descriptors.push(k.data.descriptors[feature as usize]);
            let ray = position - k.centre();
            direction += ray / ray.norm().max(1e-12);
            if keyframe == anchor {
                scale_range = self.scale_range(&k.data, feature, ray.norm());
                anchor_from_world = k.world_from_camera.inverse();
            }
        }
        let Some(descriptor) = Descriptor::medoid(&descriptors) else {
            return;
        };
        let direction = anchor_from_world.rotation * direction;
        if let Some(l) = self.landmark_mut(id) {
            l.descriptor = descriptor;
            l.scale_range = scale_range;
            l.direction_in_anchor = direction / direction.norm().max(1e-12);
        }
    }
}
