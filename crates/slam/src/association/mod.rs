//! Data association between features and landmarks.
//!
//! Used by tracking, mapping and loop closing: predicts the position and pyramid level of landmarks, matches
//! descriptors, turns features into measurements and lists the landmarks of keyframes. Stateless.

mod matching;
mod measure;
mod predict;

pub(crate) use matching::{
    Candidate, Expected, MatchMemory, Matches, RATIO, STRICT_DISTANCE, Target, candidates_of,
    in_bounds, match_by_descriptor, match_by_projection, match_expected,
};
pub(crate) use measure::{measurement, measurement_in};
pub(crate) use predict::{is_in_range, level_at, window_of};

use stillpoint_map::{KeyframeId, LandmarkId, MapView};

/// The live landmarks observed by any of the keyframes, sorted by id.
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
