//! Association: which feature sees which landmark.
//!
//! Answers, for tracking, mapping and loop closing alike: where a landmark should appear and on which pyramid level, how alike two
//! descriptors must be, what a feature measured of its landmark, and which landmarks a set of keyframes sees. Holds no state and decides
//! nothing about poses or the map.

mod matching;
mod measure;
mod predict;

pub(crate) use matching::{
    Candidate, Expected, MatchMemory, Matches, STRICT_DISTANCE, Target, candidates_of, in_bounds,
    match_by_descriptor, match_by_projection, match_expected,
};
pub(crate) use measure::{measurement, measurement_in};
pub(crate) use predict::{is_in_range, level_at, window_of};

use stillpoint_map::{KeyframeId, LandmarkId, MapView};

/// The live landmarks that any of some keyframes sees, in the order of their ids.
pub(crate) fn landmarks_of(view: &MapView, keyframes: &[KeyframeId]) -> Vec<LandmarkId> {
    let mut ids: Vec<LandmarkId> = keyframes
        .iter()
        .filter_map(|k| view.keyframe(*k))
        .flat_map(|k| k.matches.iter().flatten().copied())
        .collect();
    ids.sort_unstable();
    ids.dedup();
    ids
}
