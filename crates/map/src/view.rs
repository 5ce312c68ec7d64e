//! Immutable versions of the map.

use crate::landmark::LandmarkSlot;
use crate::sparse::Sparse;
use crate::{Keyframe, KeyframeId, KeyframeSlot, Landmark, LandmarkId, LoopEdge, SubmapId};
use std::collections::BTreeMap;
use std::sync::Arc;
use stillpoint_geometry::{Se3, Vec3};

/// An immutable version of the map. Cloning costs four reference counts.
#[derive(Clone, Debug, Default)]
pub struct MapView {
    pub(crate) version: u64,
    /// By keyframe id.
    pub(crate) keyframes: Sparse<KeyframeSlot>,
    /// Live landmarks by id, with a slot for every id given out.
    pub(crate) landmarks: Sparse<Arc<Landmark>>,
    /// By landmark id: the target of each merge.
    pub(crate) merged: Sparse<LandmarkId>,
    pub(crate) loops: Arc<Vec<LoopEdge>>,
    pub(crate) live_keyframes: usize,
    pub(crate) live_landmarks: usize,
}

impl MapView {
    /// Incremented by every published change.
    #[must_use]
    pub fn version(&self) -> u64 {
        self.version
    }

    /// Number of live keyframes.
    #[must_use]
    pub fn keyframe_count(&self) -> usize {
        self.live_keyframes
    }

    /// Number of live landmarks.
    #[must_use]
    pub fn landmark_count(&self) -> usize {
        self.live_landmarks
    }

    /// One more than the largest keyframe id ever given.
    #[must_use]
    pub fn keyframe_bound(&self) -> usize {
        self.keyframes.len()
    }

    /// One more than the largest landmark id ever given.
    #[must_use]
    pub fn landmark_bound(&self) -> usize {
        self.landmarks.len()
    }

    /// A live keyframe.
    #[must_use]
    pub fn keyframe(&self, id: KeyframeId) -> Option<&Arc<Keyframe>> {
        match self.keyframes.get(id.index())? {
            KeyframeSlot::Live(k) => Some(k),
            _ => None,
        }
    }

    /// State of a keyframe id.
    #[must_use]
    pub fn keyframe_slot(&self, id: KeyframeId) -> &KeyframeSlot {
        self.keyframes
            .get(id.index())
            .unwrap_or(&KeyframeSlot::Empty)
    }

    /// All live keyframes, by id.
    pub fn keyframes(&self) -> impl Iterator<Item = &Arc<Keyframe>> {
        self.keyframes.iter().filter_map(|(_, s)| match s {
            KeyframeSlot::Live(k) => Some(k),
            _ => None,
        })
    }

    /// Pose of a keyframe, also of a culled one (through its tombstone).
    #[must_use]
    pub fn world_from_keyframe(&self, id: KeyframeId) -> Option<Se3> {
        let mut tail = Se3::identity();
        let mut at = id;
        // A tombstone's parent was live when it was made, so chains are shorter than the number of slots.
        for _ in 0..=self.keyframes.len() {
            match self.keyframes.get(at.index())? {
                KeyframeSlot::Live(k) => return Some(k.world_from_camera * tail),
                KeyframeSlot::Culled {
                    parent,
                    parent_from_this,
                } => {
                    tail = *parent_from_this * tail;
                    at = *parent;
                }
                KeyframeSlot::Empty => return None,
            }
        }
        None
    }

    /// The live keyframe that an id resolves to: itself, or the one that carries its tombstone.
    #[must_use]
    pub fn resolve_keyframe(&self, id: KeyframeId) -> Option<KeyframeId> {
        let mut at = id;
        for _ in 0..=self.keyframes.len() {
            match self.keyframes.get(at.index())? {
                KeyframeSlot::Live(_) => return Some(at),
                KeyframeSlot::Culled { parent, .. } => at = *parent,
                KeyframeSlot::Empty => return None,
            }
        }
        None
    }

    /// The submap that a keyframe belongs to, also a culled one (through its tombstone).
    #[must_use]
    pub fn submap_of(&self, id: KeyframeId) -> Option<SubmapId> {
        Some(self.keyframe(self.resolve_keyframe(id)?)?.submap)
    }

    /// The submaps with their numbers of live keyframes, by id.
    #[must_use]
    pub fn submaps(&self) -> Vec<(SubmapId, usize)> {
        let mut submaps = BTreeMap::new();
        for k in self.keyframes() {
            *submaps.entry(k.submap).or_insert(0) += 1;
        }
        submaps.into_iter().collect()
    }

    /// The live landmark that an id resolves to, through merges.
    #[must_use]
    pub fn resolve_landmark(&self, id: LandmarkId) -> Option<LandmarkId> {
        let mut at = id;
        // A merge points to a landmark live at that time, so chains end.
        for _ in 0..=self.landmarks.len() {
            match self.landmark_slot(at) {
                LandmarkSlot::Live(_) => return Some(at),
                LandmarkSlot::Merged(into) => at = into,
                LandmarkSlot::Culled => return None,
            }
        }
        None
    }

    /// A live landmark, by its own id (merges are not followed).
    #[must_use]
    pub fn landmark(&self, id: LandmarkId) -> Option<&Landmark> {
        self.landmarks.get(id.index()).map(|l| &**l)
    }

    /// World position of a live landmark, m.
    #[must_use]
    pub fn landmark_position(&self, id: LandmarkId) -> Option<Vec3> {
        let l = self.landmark(id)?;
        let anchor = self.keyframe(l.anchor)?;
        Some(anchor.world_from_camera.transform(&l.position_in_anchor))
    }

    /// Loop measurements in the order of detection: closed loops and joined submaps. Their keyframes may have been
    /// culled since.
    pub fn loops(&self) -> impl Iterator<Item = &LoopEdge> {
        self.loops.iter()
    }

    /// All live landmarks, by id.
    pub fn landmarks(&self) -> impl Iterator<Item = (LandmarkId, &Landmark)> {
        let landmarks = self.landmarks.iter();
        landmarks.map(|(i, l)| (LandmarkId::new(i as u32), &**l))
    }

    pub(crate) fn landmark_slot(&self, id: LandmarkId) -> LandmarkSlot<'_> {
        let merged = || self.merged.get(id.index()).copied();
        match self.landmark(id) {
            Some(l) => LandmarkSlot::Live(l),
            None => merged().map_or(LandmarkSlot::Culled, LandmarkSlot::Merged),
        }
    }

    /// Bytes of the id tables, without keyframes and landmarks.
    #[must_use]
    pub fn table_bytes(&self) -> usize {
        self.keyframes.bytes() + self.landmarks.bytes() + self.merged.bytes()
    }
}
