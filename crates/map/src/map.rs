//! The map, its keyframes and their covisibility. Changes of landmarks are in `observations.rs`.

use crate::sparse::Sparse;
use crate::{Keyframe, KeyframeData, KeyframeId, KeyframeSlot, MapView, SubmapId};
use std::sync::Arc;
use stillpoint_geometry::Se3;

/// All keyframes and landmarks. Owned by the mapper alone.
#[derive(Clone, Debug)]
pub struct Map {
    pub(crate) view: MapView,
    /// The inverse index: observers of each landmark, with feature indices; by keyframe id.
    pub(crate) observations: Sparse<Vec<(KeyframeId, u32)>>,
    /// Scale of each pyramid level, to compute the scale ranges of landmarks.
    pub(crate) level_scales: Vec<f32>,
}

impl Map {
    /// An empty map for features from a pyramid of `levels` levels with factor `scale_factor`.
    #[must_use]
    pub fn new(levels: usize, scale_factor: f32) -> Self {
        Self {
            view: MapView::default(),
            observations: Sparse::default(),
            level_scales: std::iter::successors(Some(1.0), |s| Some(s * scale_factor))
                .take(levels.max(1))
                .collect(),
        }
    }

    /// Whether its features come from such a pyramid; otherwise descriptors are not comparable.
    #[must_use]
    pub fn fits(&self, levels: usize, scale_factor: f32) -> bool {
        self.level_scales == Self::new(levels, scale_factor).level_scales
    }

    /// Scale of each pyramid level relative to the finest.
    #[must_use]
    pub fn level_scales(&self) -> &[f32] {
        &self.level_scales
    }

    /// The present state, for reading.
    #[must_use]
    pub fn view(&self) -> &MapView {
        &self.view
    }

    /// Publishes the present state as a new version, unaffected by later changes.
    pub fn publish(&mut self) -> Arc<MapView> {
        self.view.version += 1;
        Arc::new(self.view.clone())
    }

    pub(crate) fn keyframe_mut(&mut self, id: KeyframeId) -> Option<&mut Keyframe> {
        match self.view.keyframes.get_mut(id.index())? {
            KeyframeSlot::Live(k) => Some(Arc::make_mut(k)),
            _ => None,
        }
    }

    /// Adds a keyframe without observations to the submap of its parent, or to a new submap without one. Returns false
    /// when the id is taken.
    pub fn insert_keyframe(
        &mut self,
        id: KeyframeId,
        data: Arc<KeyframeData>,
        world_from_camera: Se3,
        parent: Option<KeyframeId>,
    ) -> bool {
        if self.view.keyframes.get(id.index()).is_some() {
            return false;
        }
        let matches = vec![None; data.len()];
        let submap = parent.and_then(|p| self.view.submap_of(p));
        let keyframe = Keyframe {
            id,
            data,
            world_from_camera,
            matches,
            covisible: Vec::new(),
            parent,
            submap: submap.unwrap_or(SubmapId(id.0)),
        };
        let slot = KeyframeSlot::Live(Arc::new(keyframe));
        self.view.keyframes.set(id.index(), slot);
        self.view.live_keyframes += 1;
        true
    }

    /// Sets a keyframe's pose; landmarks anchored in it move along.
    pub fn set_pose(&mut self, id: KeyframeId, world_from_camera: Se3) {
        if let Some(k) = self.keyframe_mut(id) {
            k.world_from_camera = world_from_camera;
        }
    }

    /// Recomputes the covisibility of `id`, on both sides. Pairs that share fewer than `min_shared` landmarks are
    /// dropped, except the best one.
    pub fn refresh_covisibility(&mut self, id: KeyframeId, min_shared: u32) {
        let Some(k) = self.view.keyframe(id) else {
            return;
        };
        let mut shared: Vec<KeyframeId> = Vec::new();
        for landmark in k.matches.iter().flatten() {
            let observers = self.observations(*landmark);
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
        // Most pairs are unchanged; checking first avoids copying a keyframe shared with a view.
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

    /// Removes a keyframe. Its pose remains as a tombstone relative to its parent (or its most covisible keyframe),
    /// landmarks anchored in it get another anchor, its children get its parent. Returns false, without changes, when
    /// it is not live or no reference keyframe remains.
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
        let slot = KeyframeSlot::Culled {
            parent,
            parent_from_this: world_from_parent.inverse() * k.world_from_camera,
        };
        self.view.keyframes.set(id.index(), slot);
        self.view.live_keyframes -= 1;
        true
    }
}

/// Descending by shared landmarks; ties by id.
pub(crate) fn sort_by_weight(list: &mut [(KeyframeId, u32)]) {
    list.sort_unstable_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
}
