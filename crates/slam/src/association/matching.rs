//! Matching of frame features to landmarks. Searches, descriptor thresholds and the rotation check follow ORB-SLAM2
//! (Mur-Artal, Tardos 2017).

use crate::recycle::Lists;
use stillpoint_features::{Descriptor, RotationHistogram, Window, best_two};
use stillpoint_geometry::{Mat3, Se3, Vec3};
use stillpoint_imaging::workers;
use stillpoint_map::{Keyframe, KeyframeData, LandmarkId, MapView};

/// Maximum Hamming distance of a match, bits of 256 (random descriptors differ by 128 +- 8), as in ORB-SLAM2
/// (Mur-Artal, Tardos 2017).
const MAX_DISTANCE: u32 = 100;
/// Maximum distance for matches on the descriptor alone, without a predicted position: half of `MAX_DISTANCE`, as in
/// ORB-SLAM2.
pub(crate) const STRICT_DISTANCE: u32 = 50;
/// Maximum ratio of the best to the second-best distance between frames, and of loops, as in ORB-SLAM2 (Mur-Artal,
/// Tardos 2017).
pub(crate) const RATIO: f32 = 0.9;
/// Maximum distance ratio of a landmark match in a search window, applied only between candidates of one level. As in
/// ORB-SLAM2 (Mur-Artal, Tardos 2017).
const WINDOW_RATIO: f32 = 0.8;

/// A point matched to a feature: a landmark, or a temporary point from the last frame's depth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Target {
    /// `None` for a temporary point.
    pub(crate) landmark: Option<LandmarkId>,
    /// World position, m.
    pub(crate) position: Vec3,
    distance: u32,
}

/// The matched point of each feature of the current frame.
#[derive(Debug, Default)]
pub(crate) struct Matches {
    pub(crate) targets: Vec<Option<Target>>,
    pub(crate) count: usize,
}

impl Matches {
    pub(crate) fn new(features: usize) -> Self {
        Self {
            targets: vec![None; features],
            count: 0,
        }
    }

    /// Assigns `target` to a feature unless it already has a match at the same or a smaller distance.
    fn assign(&mut self, feature: u32, target: Target) {
        match &mut self.targets[feature as usize] {
            Some(old) if old.distance <= target.distance => {}
            slot => {
                self.count += usize::from(slot.is_none());
                *slot = Some(target);
            }
        }
    }

    /// Number of features matched to a landmark.
    pub(crate) fn landmarks(&self) -> usize {
        let sees = |t: &&Target| t.landmark.is_some();
        self.targets.iter().flatten().filter(sees).count()
    }

    /// Assigns a temporary point to a feature that has no match.
    pub(crate) fn assign_point(&mut self, feature: u32, position: Vec3) {
        let target = Target {
            landmark: None,
            position,
            distance: u32::MAX,
        };
        self.assign(feature, target);
    }

    /// Matches of the features marked `kept`, renumbered from 0; reuses the empty list `targets`.
    pub(crate) fn select(
        &self,
        kept: impl Iterator<Item = bool>,
        mut targets: Vec<Option<Target>>,
    ) -> Self {
        let chosen = self.targets.iter().zip(kept).filter(|(_, k)| *k);
        targets.reserve(self.targets.len());
        targets.extend(chosen.map(|(t, _)| *t));
        Self {
            count: targets.iter().flatten().count(),
            targets,
        }
    }

    pub(crate) fn clear(&mut self, feature: usize) {
        if self.targets[feature].take().is_some() {
            self.count -= 1;
        }
    }
}

/// A feature of an earlier frame and the point matched to it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate {
    /// `None` for a temporary point.
    pub(crate) landmark: Option<LandmarkId>,
    /// World position, m.
    pub(crate) position: Vec3,
    pub(crate) feature: u32,
}

/// The keyframe's matched landmarks that still exist in the map view.
pub(crate) fn candidates_of(view: &MapView, keyframe: &Keyframe) -> Vec<Candidate> {
    let candidate = |(i, id): (usize, &Option<LandmarkId>)| {
        let landmark = (*id)?;
        Some(Candidate {
            landmark: Some(landmark),
            position: view.landmark_position(landmark)?,
            feature: i as u32,
        })
    };
    let matches = keyframe.matches.iter().enumerate();
    matches.filter_map(candidate).collect()
}

#[derive(Default)]
pub(crate) struct MatchMemory {
    /// Per candidate: feature and distance.
    found: Vec<Option<(u32, u32)>>,
    histogram: RotationHistogram<Found>,
    /// Buffers for [`Matches`].
    pub(crate) targets: Lists<Option<Target>>,
}

type Found = (u32, u32, u32);

/// Searches for each candidate around its projection with the predicted pose, within `radius_px` (scaled by level) and
/// within the bounds of undistorted pixels.
pub(crate) fn match_by_projection(
    data: &KeyframeData,
    predicted: &Se3,
    (earlier, candidates): (&KeyframeData, &[Candidate]),
    (bounds, level_scales, radius_px): ([f32; 4], &[f32], f32),
    memory: &mut MatchMemory,
) -> Matches {
    let (r, t): (Mat3, Vec3) = (predicted.rotation_matrix(), predicted.translation);
    let search = |c: &Candidate| {
        let p = r * c.position + t;
        if p.z <= 0.0 {
            return None;
        }
        let px = data.camera.project(&p);
        let (x, y) = (px.x as f32, px.y as f32);
        if !inside(x, y, bounds) {
            return None;
        }
        let feature = c.feature as usize;
        let level = earlier.keypoints[feature].level;
        let window = Window {
            x,
            y,
            radius: radius_px * level_scales[usize::from(level)],
            min_level: level.saturating_sub(1),
            max_level: level + 1,
        };
        let descriptor = &earlier.descriptors[feature];
        let best = best_two(&data.searched(), &window, descriptor, |_| true)?;
        let holds = best.distance <= MAX_DISTANCE
            && is_distinct(best.distance, best.second_distance, RATIO);
        holds.then_some((best.index, best.distance))
    };
    memory.found.clear();
    memory.found.resize(candidates.len(), None);
    workers::fill(&mut memory.found, |i| search(&candidates[i]));
    let found = (0..).zip(&memory.found);
    let found = found.filter_map(|(i, f)| f.map(|(feature, distance)| (i, feature, distance)));
    let targets = memory.targets.take();
    keep_consistent_rotations(
        (data, targets),
        (earlier, candidates),
        found,
        &mut memory.histogram,
    )
}

/// Matches candidates to all features by descriptor alone.
pub(crate) fn match_by_descriptor(
    data: &KeyframeData,
    earlier: &KeyframeData,
    candidates: &[Candidate],
) -> Matches {
    let query: Vec<Descriptor> = candidates
        .iter()
        .map(|c| earlier.descriptors[c.feature as usize])
        .collect();
    let matches =
        stillpoint_features::match_brute_force(&query, &data.descriptors, STRICT_DISTANCE, 0.8);
    let found = (0..).zip(query.iter().zip(&matches));
    let found = found
        .filter_map(|(i, (q, m))| m.map(|m| (i, m, q.distance(&data.descriptors[m as usize]))));
    keep_consistent_rotations(
        (data, Vec::new()),
        (earlier, candidates),
        found,
        &mut RotationHistogram::new(),
    )
}

/// Drops matches whose keypoint rotation disagrees with the dominant rotation between the frames. Fills the empty list
/// `targets` with the rest.
fn keep_consistent_rotations(
    (data, mut targets): (&KeyframeData, Vec<Option<Target>>),
    (earlier, candidates): (&KeyframeData, &[Candidate]),
    found: impl Iterator<Item = Found>,
    histogram: &mut RotationHistogram<Found>,
) -> Matches {
    histogram.clear();
    for (i, feature, distance) in found {
        let before = earlier.keypoints[candidates[i as usize].feature as usize].angle;
        let now = data.keypoints[feature as usize].angle;
        histogram.push(now - before, (i, feature, distance));
    }
    targets.resize(data.len(), None);
    let mut matches = Matches { targets, count: 0 };
    for (i, feature, distance) in histogram.kept() {
        let c = &candidates[i as usize];
        matches.assign(
            feature,
            Target {
                landmark: c.landmark,
                position: c.position,
                distance,
            },
        );
    }
    matches
}

/// A landmark predicted to be visible in the frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Expected<'a> {
    pub(crate) landmark: LandmarkId,
    pub(crate) position: Vec3,
    pub(crate) descriptor: &'a Descriptor,
    /// Predicted position, undistorted px.
    pub(crate) pixel: [f32; 2],
    pub(crate) level: u8,
    /// Search radius on level 0, px.
    pub(crate) radius_px: f32,
}

/// Matches a predicted landmark to a feature that has no landmark yet.
pub(crate) fn match_expected(
    data: &KeyframeData,
    expected: &Expected<'_>,
    level_scales: &[f32],
    matches: &mut Matches,
) -> bool {
    let window = Window {
        x: expected.pixel[0],
        y: expected.pixel[1],
        radius: expected.radius_px * level_scales[usize::from(expected.level)],
        min_level: expected.level.saturating_sub(1),
        max_level: expected.level,
    };
    let free = |i: u32| matches.targets[i as usize].is_none_or(|t| t.landmark.is_none());
    let best = best_two(&data.searched(), &window, expected.descriptor, free);
    let Some(best) = best.filter(|b| b.distance <= MAX_DISTANCE) else {
        return false;
    };
    let same_level = data.keypoints[best.index as usize].level == best.second_level;
    if same_level && !is_distinct(best.distance, best.second_distance, WINDOW_RATIO) {
        return false;
    }
    matches.clear(best.index as usize);
    matches.assign(
        best.index,
        Target {
            landmark: Some(expected.landmark),
            position: expected.position,
            distance: best.distance,
        },
    );
    true
}

fn is_distinct(best: u32, second: u32, ratio: f32) -> bool {
    second == u32::MAX || best as f32 <= ratio * second as f32
}

fn inside(x: f32, y: f32, [min_x, min_y, max_x, max_y]: [f32; 4]) -> bool {
    x >= min_x && y >= min_y && x <= max_x && y <= max_y
}

/// Whether a pixel lies within the bounds of undistorted pixels.
pub(crate) fn in_bounds(px: [f32; 2], bounds: [f32; 4]) -> bool {
    inside(px[0], px[1], bounds)
}
