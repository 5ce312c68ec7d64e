//! The map as the tracker knows it: a view, what of it is near, and the places that can be recognised in it.

use super::local_map::LocalMap;
use std::sync::Arc;
use stillpoint_imaging::FrameId;
use stillpoint_map::{KeyframeId, MapView};
use stillpoint_place::{PlaceIndex, Vocabulary};

/// A view of the map with what is kept beside it.
pub(super) struct KnownMap {
    pub(super) view: Arc<MapView>,
    /// What the frame is expected to see.
    pub(super) local: LocalMap,
    /// What is around, where the local map is looked for again.
    pub(super) surroundings: LocalMap,
    pub(super) places: RecognisablePlaces,
    /// Whether frames become keyframes and new submaps are begun; else the map is only read.
    pub(super) grows: bool,
    /// Keyframe ids count on from here: below are those of a map that was there before.
    first_keyframe: u32,
}

/// The places that can be recognised.
pub(super) struct RecognisablePlaces {
    pub(super) vocabulary: Vocabulary,
    pub(super) index: PlaceIndex<KeyframeId>,
}

impl KnownMap {
    /// A map that is there already, or an empty one.
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

    /// Whether there is nothing to be tracked in.
    pub(super) fn is_empty(&self) -> bool {
        self.view.keyframe_count() == 0
    }

    /// The id of the keyframe that a frame of this run may become.
    pub(super) fn keyframe_id(&self, frame: FrameId) -> KeyframeId {
        KeyframeId(self.first_keyframe.saturating_add(frame.0))
    }
}
