//! Which older keyframes may show the same place: by what they look like, keyframe after keyframe.

use super::nodes::{group_of, surroundings};
use super::{LoopCloser, MIN_GAP};
use stillpoint_map::{Keyframe, KeyframeId, MapView};
use stillpoint_place::PlaceMatch;

/// Keyframes that look most alike and are looked into.
pub(super) const CANDIDATES: usize = 5;

/// A place must be recognised by so many keyframes in a row: one alone may be a coincidence.
const CONSISTENCY: u32 = 3;

/// A place that keyframe after keyframe looked like.
pub(super) struct Streak {
    /// The keyframes that show it, by id.
    group: Vec<KeyframeId>,
    /// Keyframes in a row.
    length: u32,
}

/// How a place was recognised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum By {
    /// By what it looks like.
    Words,
    /// By where the map says that it is.
    Pose,
}

/// An older keyframe that may show the same place.
pub(super) struct Candidate {
    pub(super) with: KeyframeId,
    /// Likeness; 0 where it was not asked for.
    pub(super) score: f64,
    pub(super) by: By,
}

impl LoopCloser {
    /// Adds the keyframe to the index; returns what looks like it and is of another submap, or, when loops are closed, is
    /// not seen together with it and not recent.
    pub(super) fn recognise(
        &mut self,
        view: &MapView,
        keyframe: &Keyframe,
    ) -> Vec<PlaceMatch<KeyframeId>> {
        let _span = tracing::info_span!("recognise").entered();
        // A culled keyframe cannot be verified, and would take the place of a candidate that can.
        let gone: Vec<KeyframeId> = self
            .index
            .keys()
            .filter(|k| view.keyframe(*k).is_none())
            .collect();
        for key in gone {
            self.index.remove(key);
        }
        // Also where nothing is asked now: later keyframes may come back to this place.
        let vector = self.learn(keyframe);
        let elsewhere = view.keyframes().any(|k| k.submap != keyframe.submap);
        if !elsewhere && !self.config.enabled {
            return Vec::new();
        }
        let recent = {
            let ids: Vec<KeyframeId> = view.keyframes().map(|k| k.id).collect();
            let back = ids.len().checked_sub(MIN_GAP);
            back.and_then(|i| ids.get(i).copied())
        };
        let near = surroundings(view, keyframe);
        let own_submap =
            |k: KeyframeId| view.keyframe(k).map(|k| k.submap) == Some(keyframe.submap);
        let closes = |k: KeyframeId| self.config.enabled && Some(k) < recent && !near.contains(&k);
        let admit = |k: KeyframeId| k != keyframe.id && (!own_submap(k) || closes(k));
        self.index.query(&vector, admit, CANDIDATES)
    }

    /// The candidates whose place the keyframes before looked like as well.
    pub(super) fn consistent(
        &mut self,
        view: &MapView,
        found: Vec<PlaceMatch<KeyframeId>>,
    ) -> Vec<PlaceMatch<KeyframeId>> {
        let mut streaks = Vec::new();
        let mut consistent = Vec::new();
        for candidate in found {
            let Some(k) = view.keyframe(candidate.key) else {
                continue;
            };
            let group = group_of(k);
            let meets = |s: &&Streak| s.group.iter().any(|k| group.binary_search(k).is_ok());
            let before = self.streaks.iter().filter(meets).map(|s| s.length).max();
            let length = before.unwrap_or(0) + 1;
            if length >= CONSISTENCY {
                consistent.push(candidate);
            }
            streaks.push(Streak { group, length });
        }
        self.streaks = streaks;
        consistent
    }
}
