//! Appends another map as further submaps.

use crate::{KeyframeId, KeyframeSlot, Landmark, LandmarkId, LoopEdge, Map, SubmapId};
use std::sync::Arc;

/// Reason why a map cannot be appended to another.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum AppendError {
    /// The maps use different pyramids, so their descriptors are not comparable.
    Levels {
        /// Level scales of the map to be extended.
        expected: Vec<f32>,
        /// Level scales of the other map.
        found: Vec<f32>,
    },
    /// There are not enough ids for both maps.
    Full,
}

impl std::fmt::Display for AppendError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Levels { expected, found } => write!(
                f,
                "expected a map with features from levels of scale {expected:?}, found levels of scale {found:?}: make both maps with the same pyramid of features"
            ),
            Self::Full => write!(
                f,
                "expected two maps that have fewer than 2^32 keyframe and landmark ids together: make smaller maps"
            ),
        }
    }
}

impl std::error::Error for AppendError {}

impl Map {
    /// Appends another map: its submaps become further submaps of this one, under new ids. Returns the offset of its
    /// keyframe ids. The relative poses of the submaps stay unknown.
    ///
    /// # Errors
    /// [`AppendError`]; the map is unchanged then.
    pub fn append(&mut self, other: &Self) -> Result<u32, AppendError> {
        if self.level_scales != other.level_scales {
            return Err(AppendError::Levels {
                expected: self.level_scales.clone(),
                found: other.level_scales.clone(),
            });
        }
        let keyframes = first_free(self.view.keyframes.len(), other.view.keyframes.len())?;
        let landmarks = first_free(self.view.landmarks.len(), other.view.landmarks.len())?;
        let keyframe = |id: KeyframeId| KeyframeId(id.0 + keyframes);
        let landmark = |id: LandmarkId| LandmarkId::new(id.number() + landmarks);
        for (id, slot) in other.view.keyframes.iter() {
            let slot = match slot {
                KeyframeSlot::Empty => continue,
                KeyframeSlot::Live(k) => {
                    let mut k = (**k).clone();
                    k.id = keyframe(k.id);
                    k.parent = k.parent.map(keyframe);
                    k.submap = SubmapId(k.submap.0 + keyframes);
                    for (id, _) in &mut k.covisible {
                        *id = keyframe(*id);
                    }
                    for id in k.matches.iter_mut().flatten() {
                        *id = landmark(*id);
                    }
                    KeyframeSlot::Live(Arc::new(k))
                }
                KeyframeSlot::Culled {
                    parent,
                    parent_from_this,
                } => KeyframeSlot::Culled {
                    parent: keyframe(*parent),
                    parent_from_this: *parent_from_this,
                },
            };
            self.view.keyframes.set(id + keyframes as usize, slot);
        }
        let first = landmarks as usize;
        for (id, l) in other.view.landmarks.iter() {
            let mut l = Landmark::clone(l);
            l.anchor = keyframe(l.anchor);
            l.created_at = keyframe(l.created_at);
            self.view.landmarks.set(id + first, Arc::new(l));
        }
        for (id, into) in other.view.merged.iter() {
            self.view.merged.set(id + first, landmark(*into));
        }
        for (id, list) in other.observations.iter() {
            let moved = list.iter().map(|(k, feature)| (keyframe(*k), *feature));
            self.observations.set(id + first, moved.collect());
        }
        let [all_keyframes, all_landmarks] = [
            keyframes as usize + other.view.keyframes.len(),
            first + other.view.landmarks.len(),
        ];
        self.view.keyframes.grow(all_keyframes);
        self.view.landmarks.grow(all_landmarks);
        self.view.merged.grow(all_landmarks);
        self.observations.grow(all_landmarks);
        let edges = other.view.loops().map(|edge| LoopEdge {
            old: keyframe(edge.old),
            new: keyframe(edge.new),
            ..*edge
        });
        Arc::make_mut(&mut self.view.loops).extend(edges);
        self.view.live_keyframes += other.view.live_keyframes;
        self.view.live_landmarks += other.view.live_landmarks;
        Ok(keyframes)
    }
}

/// The first id after `own`, if `more` ids fit after it. Map files reserve the two largest numbers.
fn first_free(own: usize, more: usize) -> Result<u32, AppendError> {
    let fits = own.checked_add(more).filter(|n| *n < u32::MAX as usize - 1);
    fits.map(|_| own as u32).ok_or(AppendError::Full)
}
