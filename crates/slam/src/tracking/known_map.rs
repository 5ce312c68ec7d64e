//! The tracker's view of the map, with caches and the place index.

use super::local_map::LocalMap;
use std::sync::Arc;
use stillpoint_imaging::FrameId;
use stillpoint_map::{KeyframeId, MapView};
use stillpoint_place::{PlaceIndex, Vocabulary};

/// A view of the map with derived data.
pub(super) struct KnownMap {
    pub(super) view: Arc<MapView>,
    /// Landmarks expected in the frame.
    pub(super) local: LocalMap,
    /// Landmarks around the pose, for recovering the local map.
    pub(super) surroundings: LocalMap,
    pub(super) places: RecognisablePlaces,
    /// Whether keyframes and submaps are created; otherwise the map is read-only.
    pub(super) grows: bool,
    /// Offset of keyframe ids; lower ones belong to a map that existed before.
    first_keyframe: u32,
}

pub(super) struct RecognisablePlaces {
    pub(super) vocabulary: Vocabulary,
    pub(super) index: PlaceIndex<KeyframeId>,
}

impl KnownMap {
    pub(super) fn new(view: Arc<MapView>, grows: bool) -> Self {
        Self {
            first_keyframe: view.keyframe_bound() as u32,
            view,
            local: LocalMap::default(),
            surroundings: LocalMap::default(),
            places: RecognisablePlaces {
                vocabulary: Vocabulary::embedded(),
                index: PlaceIndex::default(),
            },
            grows,
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.view.keyframe_count() == 0
    }

    /// Id of the keyframe that a frame of this run may become.
    pub(super) fn keyframe_id(&self, frame: FrameId) -> KeyframeId {
        KeyframeId(self.first_keyframe.saturating_add(frame.0))
    }
}
