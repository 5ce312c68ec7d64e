//! The map and every way to change it.

use crate::{
    Keyframe, KeyframeData, KeyframeId, KeyframeSlot, Landmark, LandmarkId, LandmarkSlot, MapView,
    ScaleRange,
};
use std::sync::Arc;
use stillpoint_features::Descriptor;
use stillpoint_geometry::{Se3, Vec3};

/// A landmark to be made.
#[derive(Clone, Copy, Debug)]
pub struct NewLandmark {
    /// World position, m.
    pub position: Vec3,
    /// The first observation; it becomes the anchor.
    pub observation: (KeyframeId, u32),
}

/// All keyframes and landmarks. Owned by the mapper alone.
#[derive(Debug)]
pub struct Map {
    pub(crate) view: MapView,
    /// The inverse index: who observes each landmark, with which feature; by keyframe id.
    pub(crate) observations: Vec<Vec<(KeyframeId, u32)>>,
    /// Scale of each pyramid level, for the distances from which a landmark can be recognised.
    level_scales: Vec<f32>,
}

impl Map {
    /// An empty map for features from a pyramid of `levels` levels with factor `scale_factor`.
    #[must_use]
    pub fn new(levels: usize, scale_factor: f32) -> Self {
        Self {
            view: MapView::default(),
            observations: Vec::new(),
            level_scales: std::iter::successors(Some(1.0), |s| Some(s * scale_factor))
                .take(levels.max(1))
                .collect(),
        }
    }

    /// The present state, for reading.
    #[must_use]
    pub fn view(&self) -> &MapView {
        &self.view
    }

    /// Publishes the present state as a new version; later changes do not touch it.
    pub fn publish(&mut self) -> Arc<MapView> {
        self.view.version += 1;
        Arc::new(self.view.clone())
    }

    /// Who observes a landmark, with which feature, by keyframe id.
    #[must_use]
    pub fn observations(&self, id: LandmarkId) -> &[(KeyframeId, u32)] {
        self.observations.get(id.index()).map_or(&[], |v| v)
    }

    fn keyframe_mut(&mut self, id: KeyframeId) -> Option<&mut Keyframe> {
        match self.view.keyframes.get_mut(id.index())? {
            KeyframeSlot::Live(k) => Some(Arc::make_mut(k)),
            _ => None,
        }
    }

    /// A live landmark, to change its position or counters. Observations change only through the map's own methods.
    pub fn landmark_mut(&mut self, id: LandmarkId) -> Option<&mut Landmark> {
        match self.view.landmarks.get_mut(id.index())? {
            LandmarkSlot::Live(l) => Some(l),
            _ => None,
        }
    }

    /// Adds a keyframe without observations. Returns false when the id is taken.
    pub fn insert_keyframe(
        &mut self,
        id: KeyframeId,
        data: Arc<KeyframeData>,
        world_from_camera: Se3,
        parent: Option<KeyframeId>,
    ) -> bool {
        while self.view.keyframes.len() <= id.index() {
            self.view.keyframes.push(KeyframeSlot::Empty);
        }
        let matches = vec![None; data.len()];
        match self.view.keyframes.get_mut(id.index()) {
            Some(slot @ KeyframeSlot::Empty) => {
                *slot = KeyframeSlot::Live(Arc::new(Keyframe {
                    id,
                    data,
                    world_from_camera,
                    matches,
                    covisible: Vec::new(),
                    parent,
                }));
                self.view.live_keyframes += 1;
                true
            }
            _ => false,
        }
    }

    /// Sets a keyframe's pose; landmarks anchored in it move along.
    pub fn set_pose(&mut self, id: KeyframeId, world_from_camera: Se3) {
        if let Some(k) = self.keyframe_mut(id) {
            k.world_from_camera = world_from_camera;
        }
    }

    /// Sets a landmark's world position (m), relative to the present pose of its anchor.
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

    /// Makes a landmark with its first observation; none when that feature observes one already or may not.
    pub fn insert_landmark(&mut self, new: &NewLandmark) -> Option<LandmarkId> {
        let (keyframe, feature) = new.observation;
        let k = self.view.keyframe(keyframe)?;
        if k.matches.get(feature as usize)?.is_some() || !k.data.mappable[feature as usize] {
            return None;
        }
        let id = LandmarkId(self.view.landmarks.len() as u32);
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
        self.view.landmarks.push(LandmarkSlot::Live(landmark));
        self.observations.push(Vec::new());
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

    /// Adds an observation. Returns false, and changes nothing, when the landmark or keyframe is not live, the feature
    /// observes another landmark or may observe none, or the keyframe observes this one already.
    pub fn add_observation(&mut self, id: LandmarkId, keyframe: KeyframeId, feature: u32) -> bool {
        if self.view.landmark(id).is_none() {
            return false;
        }
        let Err(at) = self.observations[id.index()].binary_search_by_key(&keyframe, |o| o.0) else {
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
        self.observations[id.index()].insert(at, (keyframe, feature));
        if let Some(l) = self.landmark_mut(id) {
            l.observers += 1;
            l.depth_observers += u32::from(has_depth);
        }
        true
    }

    /// Takes features out of mapping for good, as they turned out to lie on something that moves: landmarks that they made
    /// are culled, other landmarks lose the observation. Returns how many landmarks were culled.
    pub fn disown(&mut self, keyframe: KeyframeId, features: &[u32]) -> u32 {
        let Some(k) = self.keyframe_mut(keyframe) else {
            return 0;
        };
        // The data is shared with views that are out already: they keep theirs.
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
        let mut has_depth = false;
        if let Some(k) = self.keyframe_mut(keyframe) {
            k.matches[feature as usize] = None;
            has_depth = k.data.depths[feature as usize] > 0.0;
        }
        if let Some(l) = self.landmark_mut(id) {
            l.observers -= 1;
            l.depth_observers -= u32::from(has_depth);
        }
        if self.observations[id.index()].is_empty() {
            self.cull_landmark(id);
        } else if self.view.landmark(id).is_some_and(|l| l.anchor == keyframe) {
            self.reanchor(id, keyframe);
        }
    }

    /// Moves a landmark's anchor from `old` to the first keyframe that still observes it.
    fn reanchor(&mut self, id: LandmarkId, old: KeyframeId) {
        let Some(&(anchor, _)) = self.observations[id.index()].first() else {
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

    /// Removes a landmark and all its observations.
    pub fn cull_landmark(&mut self, id: LandmarkId) {
        if self.view.landmark(id).is_some() {
            self.retire_landmark(id, LandmarkSlot::Culled);
        }
    }

    fn retire_landmark(&mut self, id: LandmarkId, tombstone: LandmarkSlot) {
        for (keyframe, feature) in std::mem::take(&mut self.observations[id.index()]) {
            if let Some(k) = self.keyframe_mut(keyframe) {
                k.matches[feature as usize] = None;
            }
        }
        if let Some(slot) = self.view.landmarks.get_mut(id.index()) {
            *slot = tombstone;
            self.view.live_landmarks -= 1;
        }
    }

    /// Declares `from` to be the same as `into`: its observations move over where they do not clash, and its id follows
    /// `into` from now on. Returns false when either is not live or both are the same.
    pub fn merge_landmarks(&mut self, from: LandmarkId, into: LandmarkId) -> bool {
        let (Some(old), Some(_)) = (self.view.landmark(from), self.view.landmark(into)) else {
            return false;
        };
        if from == into {
            return false;
        }
        let (visible, found) = (old.visible, old.found);
        let observations = self.observations[from.index()].clone();
        self.retire_landmark(from, LandmarkSlot::Merged(into));
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

    /// Computes a landmark's descriptor, viewing direction and scale range anew from its observations.
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
        for &(keyframe, feature) in &self.observations[id.index()] {
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

    /// Counts anew with which keyframes `id` shares landmarks, and updates both sides. Pairs that share fewer than
    /// `min_shared` landmarks do not count, except the best one.
    pub fn refresh_covisibility(&mut self, id: KeyframeId, min_shared: u32) {
        let Some(k) = self.view.keyframe(id) else {
            return;
        };
        let mut shared: Vec<KeyframeId> = Vec::new();
        for landmark in k.matches.iter().flatten() {
            let observers = &self.observations[landmark.index()];
            shared.extend(observers.iter().map(|o| o.0).filter(|&o| o != id));
        }
        shared.sort_unstable();
        let mut counts: Vec<(KeyframeId, u32)> = Vec::new();
        for other in shared {
            match counts.last_mut() {
                Some((last, n)) if *last == other => *n += 1,
                _ => counts.push((other, 1)),
            }
        }
        sort_by_weight(&mut counts);
        let best = counts.first().copied();
        counts.retain(|c| c.1 >= min_shared || Some(*c) == best);
        let before = std::mem::take(&mut self.keyframe_mut(id).expect("live").covisible);
        for (other, _) in before.iter().filter(|b| !counts.iter().any(|c| c.0 == b.0)) {
            self.set_covisible(*other, id, 0);
        }
        for &(other, n) in &counts {
            self.set_covisible(other, id, n);
        }
        self.keyframe_mut(id).expect("live").covisible = counts;
    }

    fn set_covisible(&mut self, id: KeyframeId, other: KeyframeId, shared: u32) {
        // Most pairs do not change; looking first spares the copy of a keyframe that a view still shares.
        let Some(k) = self.view.keyframe(id) else {
            return;
        };
        let known = k.covisible.iter().find(|c| c.0 == other).map_or(0, |c| c.1);
        if known == shared {
            return;
        }
        if let Some(k) = self.keyframe_mut(id) {
            k.covisible.retain(|c| c.0 != other);
            if shared > 0 {
                k.covisible.push((other, shared));
                sort_by_weight(&mut k.covisible);
            }
        }
    }

    /// Removes a keyframe. Its pose lives on as a tombstone relative to its parent (or its most covisible keyframe),
    /// landmarks anchored in it get another anchor, its children get its parent. Returns false, and changes nothing,
    /// when it is not live or nothing is left to hang its pose on.
    pub fn cull_keyframe(&mut self, id: KeyframeId) -> bool {
        let Some(k) = self.view.keyframe(id).cloned() else {
            return false;
        };
        let parent = k
            .parent
            .and_then(|p| self.view.resolve_keyframe(p))
            .or_else(|| k.covisible.first().map(|c| c.0));
        let Some(parent) = parent.filter(|p| *p != id) else {
            return false;
        };
        let Some(world_from_parent) = self.view.world_from_keyframe(parent) else {
            return false;
        };
        for landmark in k.matches.iter().flatten() {
            self.remove_observation(*landmark, id);
        }
        for (other, _) in &k.covisible {
            self.set_covisible(*other, id, 0);
        }
        let children: Vec<KeyframeId> = self
            .view
            .keyframes()
            .filter(|c| c.parent == Some(id))
            .map(|c| c.id)
            .collect();
        for child in children {
            if let Some(c) = self.keyframe_mut(child) {
                c.parent = (child != parent).then_some(parent);
            }
        }
        if let Some(slot) = self.view.keyframes.get_mut(id.index()) {
            *slot = KeyframeSlot::Culled {
                parent,
                parent_from_this: world_from_parent.inverse() * k.world_from_camera,
            };
            self.view.live_keyframes -= 1;
        }
        true
    }
}

/// Most shared landmarks first; ties by id.
fn sort_by_weight(list: &mut [(KeyframeId, u32)]) {
    list.sort_unstable_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
}
