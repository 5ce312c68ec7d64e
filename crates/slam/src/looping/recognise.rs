//! Which older keyframes may show the same place: by what they look like.

use super::LoopCloser;
use super::nodes::surroundings;
use stillpoint_map::{Keyframe, KeyframeId, MapView};
use stillpoint_place::PlaceMatch;

/// Keyframes that look most alike and are looked into, a number: half of the ten that are verified at most (decision 46).
pub(super) const CANDIDATES: usize = 5;
/// Keyframes that look alike and are compared with the candidates, a number: the neighbours of a candidate come first, and what looks like it
/// elsewhere after them. Chosen: two such neighbours for each candidate.
const COMPARED: usize = 3 * CANDIDATES;
/// The newest keyframes are no candidates: what was seen just now is matched by tracking, or it is hidden. Chosen: ten are a second of a fast turn,
/// and then the place that is wanted is among them (decision 30).
pub(super) const NEWEST: usize = 3;

/// How a candidate was found.
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
    /// Likeness of what looks most like it elsewhere on the map.
    pub(super) rival: f64,
    pub(super) by: By,
}

impl LoopCloser {
    /// Adds the keyframe to the index; returns what looks like it and is of another submap, or, when loops are closed, is
    /// not seen together with it and not recent.
    pub(super) fn recognise(&mut self, view: &MapView, keyframe: &Keyframe) -> Vec<Candidate> {
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
            let back = ids.len().checked_sub(NEWEST);
            back.and_then(|i| ids.get(i).copied())
        };
        let near = surroundings(view, keyframe);
        let own_submap =
            |k: KeyframeId| view.keyframe(k).map(|k| k.submap) == Some(keyframe.submap);
        let closes = |k: KeyframeId| self.config.enabled && Some(k) < recent && !near.contains(&k);
        let admit = |k: KeyframeId| k != keyframe.id && (!own_submap(k) || closes(k));
        let found = self.index.query(&vector, admit, COMPARED);
        let most = found.iter().take(CANDIDATES);
        most.map(|m| compared(view, m, &found)).collect()
    }
}

/// A candidate and its rival, which is not seen together with it.
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
