//! Relocalisation: where the camera is when nothing is known of it, and what becomes of it when that is not found either.

use super::ego_motion::EgoMotion;
use super::{LastFrame, Notes, Solution, Tracker, pose};
use crate::association::{Target, candidates_of, match_by_descriptor, measurement};
use std::sync::Arc;
use stillpoint_estimation::{
    AbsolutePoseOptions, Intrinsics, PoseObservation, Purpose, find_absolute_pose, rng,
};
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::{Keyframe, KeyframeData, KeyframeId};
use stillpoint_place::{PlaceIndex, Vocabulary};

/// Keyframes that look most alike and are looked into. Neighbours look alike as well, so that these are two or three places.
const CANDIDATES: usize = 6;

/// Landmarks that must agree with the pose, as a share of those in the image. The same poster in two places agrees with a few.
const MIN_SHARE: f64 = 0.1;
/// In this time (s) a camera can be carried anywhere. Before, it is no farther from where it was lost than a thrown one ...
const CARRIED_S: f64 = 1.0;
/// ... m at once, for what is not known of the pose, and ...
const REACH_M: f64 = 0.5;
/// ... m/s.
const REACH_M_S: f64 = 3.0;
/// Time to recognise another piece of map, once the camera can be there, s.
const RECOGNISED_S: f64 = 0.5;

/// The places that can be recognised.
pub(super) struct Places {
    vocabulary: Vocabulary,
    index: PlaceIndex<KeyframeId>,
}

impl Default for Places {
    fn default() -> Self {
        Self {
            vocabulary: Vocabulary::embedded(),
            index: PlaceIndex::default(),
        }
    }
}

impl Tracker {
    /// Takes a newer index of the places in the map.
    pub fn receive_places(&mut self, index: PlaceIndex<KeyframeId>) {
        self.places.index = index;
    }

    /// Looks for the camera in the whole map: candidates by place, a pose from three points of each by RANSAC, then all that
    /// tracking does with a first pose. Returns the keyframe that was recognised along with the pose.
    pub(super) fn relocalise(
        &mut self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        notes: &mut Notes,
    ) -> Option<(KeyframeId, Solution)> {
        let min_inliers = self.config.tracking.min_relocalisation_inliers;
        if data.len() < min_inliers {
            return None;
        }
        for candidate in self.recognise(data) {
            let view = Arc::clone(&self.view);
            let Some(keyframe) = view.keyframe(candidate) else {
                continue;
            };
            let Some(motion) = self.find_at(frame, data, keyframe) else {
                continue;
            };
            // What is noted on the way to a pose that is refused goes with it.
            let mut tried = notes.clone();
            if self.piece != Some(keyframe.piece) {
                self.forget_what_moves(&mut tried);
            }
            let solution = self.settle(frame, data, candidate, &motion, &mut tried);
            if let Ok(solution) = solution
                && self.is_plausible(frame.stamp, keyframe, &solution, &tried)
            {
                *notes = tried;
                return Some((candidate, solution));
            }
        }
        None
    }

    /// Whether a pose may be true: enough landmarks agree, of those that should be seen not too few, and the camera can have got
    /// there, which two equal places do not tell.
    fn is_plausible(
        &self,
        stamp: f64,
        keyframe: &Keyframe,
        solution: &Solution,
        tried: &Notes,
    ) -> bool {
        let (inliers, visible) = (tried.counts.inliers, tried.counts.local_visible);
        let enough = inliers as usize >= self.config.tracking.min_relocalisation_inliers;
        let share = f64::from(inliers) / f64::from(visible.max(1));
        let Some(last) = &self.last else {
            return enough && share >= MIN_SHARE;
        };
        let centre = solution.camera_from_world.inverse().translation;
        let moved = (centre - last.world_from_camera.translation).norm();
        let seconds = (stamp - last.stamp).max(0.0);
        let other_piece = self.piece != Some(keyframe.piece);
        let reachable = if other_piece {
            seconds >= CARRIED_S
        } else {
            seconds >= CARRIED_S || moved <= REACH_M + REACH_M_S * seconds
        };
        enough && share >= MIN_SHARE && reachable
    }

    /// The keyframes that look most like what the frame shows.
    fn recognise(&self, data: &KeyframeData) -> Vec<KeyframeId> {
        let _span = tracing::info_span!("recognise").entered();
        if self.places.index.is_empty() {
            return Vec::new();
        }
        let vocabulary = &self.places.vocabulary;
        let vector = vocabulary.vector_of(&data.descriptors, |i| data.mappable[i]);
        let is_live = |k| self.view.keyframe(k).is_some();
        let found = self.places.index.query(&vector, is_live, CANDIDATES);
        found.into_iter().map(|m| m.key).collect()
    }

    /// The pose in which the landmarks of one keyframe make most sense.
    fn find_at(
        &self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        keyframe: &Keyframe,
    ) -> Option<EgoMotion> {
        let _span = tracing::info_span!("verify").entered();
        let candidates = candidates_of(&self.view, keyframe);
        let matches = match_by_descriptor(data, &keyframe.data, &candidates);
        let observed = |(i, target): (usize, &Option<Target>)| {
            Some(PoseObservation {
                point: (*target)?.position,
                measurement: measurement(data, i),
            })
        };
        let targets = matches.targets.iter().enumerate();
        let observations: Vec<PoseObservation> = targets.filter_map(observed).collect();
        // Both are in the address: several keyframes are tried for one frame.
        let address = u64::from(frame.id.0) << 32 | u64::from(keyframe.id.0);
        let outcome = find_absolute_pose(
            &Intrinsics::from(&data.camera),
            &observations,
            &AbsolutePoseOptions::default(),
            rng(self.config.seed, address, Purpose::RELOCALISATION),
        );
        let found = outcome.found()?;
        let (matches, camera_from_world) = pose::solve(data, &found.camera_from_world, matches);
        Some(EgoMotion {
            camera_from_world,
            matches,
            ..EgoMotion::unknown()
        })
    }

    /// Whether it is time to begin a new piece of map: for so many frames there was enough to see, and none of it was known.
    /// Where there are other pieces, that is not before these had their time to be recognised.
    pub(super) fn is_piece_due(&mut self, stamp: f64, notes: &Notes) -> bool {
        let enough = self.config.tracking.min_initial_points;
        if notes.counts.with_depth as usize >= enough {
            self.unplaced += 1;
        }
        let due = self.grows && self.unplaced >= self.config.tracking.new_piece_after;
        let recent = |last: &LastFrame| stamp - last.stamp < CARRIED_S + RECOGNISED_S;
        due && !(self.last.as_ref().is_some_and(recent) && self.view.pieces().len() > 1)
    }

    /// Forgets what belongs to the piece of map that is left.
    pub(super) fn leave_piece(&mut self, notes: &mut Notes) {
        self.last = None;
        self.motion.forget();
        self.forget_what_moves(notes);
    }

    /// Has the static filter forget what it saw, as it saw it in another frame of reference, should this frame's notes be kept.
    fn forget_what_moves(&self, notes: &mut Notes) {
        let filter = notes.filter.get_or_insert_with(|| self.filter.clone());
        filter.forget();
    }
}
