//! Loop candidates by appearance.

use super::LoopCloser;
use super::nodes::surroundings;
use stillpoint_map::{Keyframe, KeyframeId, MapView};
use stillpoint_place::PlaceMatch;

/// Number of keyframes to verify, of those most similar and of those expected in view: of ten at most (decision 46).
pub(super) const CANDIDATES: usize = 5;
/// Number of newest keyframes excluded as candidates: recently seen places are matched by tracking, or occluded.
/// Chosen: ten are a second of a fast turn, and then the wanted place is among them (decision 30).
pub(super) const NEWEST: usize = 3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum By {
    /// By appearance.
    Words,
    /// By its position in the map.
    Pose,
}

/// An older keyframe that may show the same place.
pub(super) struct Candidate {
    pub(super) with: KeyframeId,
    /// Similarity; 0 if not computed.
    pub(super) score: f64,
    /// Similarity of the most similar place elsewhere in the map.
    pub(super) rival: f64,
    pub(super) by: By,
}

impl LoopCloser {
    /// Adds the keyframe to the index. Returns similar keyframes of other submaps and, if loops are closed, of the same
    /// submap that are neither covisible nor recent.
    pub(super) fn recognise(&mut self, view: &MapView, keyframe: &Keyframe) -> Vec<Candidate> {
        let _span = tracing::info_span!("recognise").entered();
        // A culled keyframe cannot be verified, and would displace a candidate that can.
        let gone: Vec<KeyframeId> = self
            .index
            .keys()
            .filter(|k| view.keyframe(*k).is_none())
            .collect();
        for key in gone {
            self.index.remove(key);
        }
        // Added even if no query follows: later keyframes may return to this place.
        let vector = self.learn(keyframe);
        let elsewhere = view.keyframes().any(|k| k.submap != keyframe.submap);
        if !elsewhere && !self.config.enabled {
            return Vec::new();
        }
        let recent = {
            let ids: Vec<KeyframeId> = view.keyframes().map(|k| k.id).collect();
            let back = ids.len().checked_sub(NEWEST);
            back.and_then(|i| ids.get(i).copied())
        };
        let near = surroundings(view, keyframe);
        let own_submap =
            |k: KeyframeId| view.keyframe(k).map(|k| k.submap) == Some(keyframe.submap);
        let closes = |k: KeyframeId| self.config.enabled && Some(k) < recent && !near.contains(&k);
        let admit = |k: KeyframeId| k != keyframe.id && (!own_submap(k) || closes(k));
        let found = self.index.query(&vector, admit, 3 * CANDIDATES);
        let most = found.iter().take(CANDIDATES);
        most.map(|m| compared(view, m, &found)).collect()
    }
}

/// A candidate with its rival, the best match not covisible with it.
fn compared(
    view: &MapView,
    candidate: &PlaceMatch<KeyframeId>,
    found: &[PlaceMatch<KeyframeId>],
) -> Candidate {
    let near = view
        .keyframe(candidate.key)
        .map(|k| surroundings(view, k))
        .unwrap_or_default();
    let elsewhere = found.iter().filter(|m| !near.contains(&m.key));
    Candidate {
        with: candidate.key,
        score: candidate.score,
        rival: elsewhere.map(|m| m.score).fold(0.0, f64::max),
        by: By::Words,
    }
}
