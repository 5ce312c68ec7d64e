//! When a frame becomes a keyframe. The rule and its thresholds are those of ORB-SLAM2 for RGB-D cameras (Mur-Artal, Tardos 2017,
//! section III.E), but for the gap between two keyframes: nothing here depends on whether the mapper is idle.

use crate::validation::Checker;
use serde::{Deserialize, Serialize};
use stillpoint_map::{Keyframe, KeyframeData, LandmarkId, MapView};

/// The least share of the reference keyframe's landmarks that is tracked without a keyframe being due, while the map has one keyframe,
/// whose landmarks nothing has confirmed.
const MIN_TRACKED_SHARE_FIRST: f64 = 0.4;

/// When a frame becomes a keyframe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct KeyframeConfig {
    /// A keyframe is due when fewer than this share of the reference keyframe's established landmarks is tracked.
    /// Range: 0.1 to 1. Overlap enough for bundle adjustment, not more keyframes than needed.
    pub min_tracked_share: f64,
    /// A keyframe is due when fewer close points than this are tracked ... Range: 0 to 10000.
    pub min_close_tracked: usize,
    /// ... while more than this many others could be made into landmarks. Range: 0 to 10000.
    pub min_close_untracked: usize,
    /// Time between two keyframes, at least, s. Range: 0 to 100. Nearer ones share all they see; this is three frames of 30 Hz, with their jitter.
    pub min_seconds: f64,
}

impl Default for KeyframeConfig {
    fn default() -> Self {
        Self {
            min_tracked_share: 0.75,
            min_close_tracked: 100,
            min_close_untracked: 70,
            min_seconds: 0.09,
        }
    }
}

impl KeyframeConfig {
    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("min_tracked_share", self.min_tracked_share, 0.1, 1.0);
        c.range("min_close_tracked", self.min_close_tracked as f64, 0.0, 1e4);
        c.range(
            "min_close_untracked",
            self.min_close_untracked as f64,
            0.0,
            1e4,
        );
        c.range("min_seconds", self.min_seconds, 0.0, 100.0);
    }

    /// Whether a frame that observes `matches` (inliers only) is due to become a keyframe.
    pub(super) fn is_due(
        &self,
        view: &MapView,
        reference: &Keyframe,
        data: &KeyframeData,
        matches: &[Option<LandmarkId>],
        close_depth: f64,
    ) -> bool {
        // Of a map, or of a submap of one.
        let alone = reference.covisible.is_empty() && reference.parent.is_none();
        let first = view.keyframe_count() < 2 || alone;
        let min_observers = if first { 1 } else { 3 };
        let established = reference
            .matches
            .iter()
            .flatten()
            .filter(|id| {
                view.landmark(**id)
                    .is_some_and(|l| l.observers >= min_observers)
            })
            .count();
        let inliers = matches.iter().flatten().count();
        let share = if first {
            MIN_TRACKED_SHARE_FIRST
        } else {
            self.min_tracked_share
        };
        let (mut tracked, mut untracked) = (0_u32, 0_u32);
        for ((z, m), mappable) in data.depths.iter().zip(matches).zip(&data.mappable) {
            if *z > 0.0 && f64::from(*z) < close_depth {
                match m {
                    Some(_) => tracked += 1,
                    None => untracked += u32::from(*mappable),
                }
            }
        }
        let few_close = (tracked as usize) < self.min_close_tracked
            && untracked as usize > self.min_close_untracked;
        few_close || (inliers as f64) < share * established as f64
    }
}
