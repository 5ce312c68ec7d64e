//! Relocalisation, and handling of frames without a pose.

use super::config::MIN_INITIAL_POINTS;
use super::ego_motion::EgoMotion;
use super::outcome::Ending;
use super::pose::{PosePrior, PoseSolver};
use super::starved::MAX_DRIFT_M;
use super::state::LastFrame;
use super::{Notes, Solution, Tracker};
use crate::association::{Target, candidates_of, match_by_descriptor, measurement};
use crate::report::LostReason;
use std::sync::Arc;
use stillpoint_estimation::{
    AbsolutePoseOptions, Intrinsics, PoseObservation, Purpose, address, find_absolute_pose, rng,
};
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::{Keyframe, KeyframeData, KeyframeId};

/// Number of most similar keyframes to try. Neighbours look alike as well, so that these are two or three places
/// (decision 14).
const CANDIDATES: usize = 6;

/// Minimum share of inliers among the landmarks in the image. A poster in two places agrees with a few: measured, an
/// object that hangs in two places has 0.06 at most, the same place 0.21 in the median (decision 46).
const MIN_SHARE: f64 = 0.1;
/// Time after which a lost camera can be anywhere, s. Before that, it is no farther from its last pose than a thrown
/// camera (decision 14).
const CARRIED_S: f64 = 1.0;
/// Speed at which a lost camera may move away from its last pose, m/s: that of a thrown camera. The fastest walk of
/// young men is 2.5 m/s (Bohannon, Age and Ageing 1997).
const REACH_M_S: f64 = 3.0;
/// Time to recognise another submap, once the camera can be there, s: chosen, 15 frames of 30 Hz, in each of which
/// [`CANDIDATES`] keyframes are tried.
const RECOGNISED_S: f64 = 0.5;

impl Tracker {
    /// Searches the camera in the whole map: candidates by appearance, a pose for each by RANSAC with three points,
    /// then the usual tracking from that pose. Returns `reason` if that fails.
    pub(super) fn relocalise(
        &mut self,
        frame: &RgbdFrame,
        data: &Arc<KeyframeData>,
        reason: LostReason,
        notes: &mut Notes,
    ) -> Result<Solution, LostReason> {
        let min_inliers = self.setup.tracking.min_relocalisation_inliers();
        // Too few even if all were inliers: a covered lens costs no search.
        if data.len() < min_inliers {
            return Err(reason);
        }
        for candidate in self.recognise(data) {
            let view = Arc::clone(&self.map.view);
            let Some(keyframe) = view.keyframe(candidate) else {
                continue;
            };
            let Some(motion) = self.find_at(frame, data, keyframe) else {
                continue;
            };
            // Results of a rejected pose are discarded.
            let mut tried = notes.clone();
            // The filter's history refers to another submap's reference frame.
            if self.beginning.submap != Some(keyframe.submap) {
                self.forget_what_moves(&mut tried);
            }
            let solution = self.settle(frame, candidate, &motion, &mut tried);
            if let Ok(solution) = solution
                && self.is_plausible(frame.stamp, keyframe, &solution, &tried)
            {
                *notes = tried;
                return Ok(Solution {
                    recognised: Some(candidate),
                    ..solution
                });
            }
        }
        Err(reason)
    }

    /// Whether a pose is plausible: enough inliers, a sufficient share of the visible landmarks, and reachable from the
    /// last pose, which distinguishes equal places.
    fn is_plausible(
        &self,
        stamp: f64,
        keyframe: &Keyframe,
        solution: &Solution,
        tried: &Notes,
    ) -> bool {
        let (inliers, visible) = (tried.counts.inliers, tried.counts.local_visible);
        let enough = inliers as usize >= self.setup.tracking.min_relocalisation_inliers();
        let share = f64::from(inliers) / f64::from(visible.max(1));
        let Some(last) = self.state.last() else {
            return enough && share >= MIN_SHARE;
        };
        let centre = solution.camera_from_world.inverse().translation;
        let moved = (centre - last.world_from_camera.translation).norm();
        let seconds = (stamp - last.stamp).max(0.0);
        let other_submap = self.beginning.submap != Some(keyframe.submap);
        // The relative pose of two submaps is unknown, so only time limits reachability.
        let reachable = if other_submap {
            seconds >= CARRIED_S
        } else {
            seconds >= CARRIED_S || moved <= MAX_DRIFT_M + REACH_M_S * seconds
        };
        enough && share >= MIN_SHARE && reachable
    }

    fn recognise(&self, data: &KeyframeData) -> Vec<KeyframeId> {
        let _span = tracing::info_span!("recognise").entered();
        if self.map.places.index.is_empty() {
            return Vec::new();
        }
        let vocabulary = &self.map.places.vocabulary;
        let vector = vocabulary.vector_of(&data.descriptors, |i| data.mappable[i]);
        // The index comes from the loop closer and may contain keyframes that this view lacks or has culled.
        let is_live = |k| self.map.view.keyframe(k).is_some();
        let found = self.map.places.index.query(&vector, is_live, CANDIDATES);
        found.into_iter().map(|m| m.key).collect()
    }

    /// Pose from the landmarks of one keyframe.
    fn find_at(
        &self,
        frame: &RgbdFrame,
        data: &Arc<KeyframeData>,
        keyframe: &Keyframe,
    ) -> Option<EgoMotion> {
        let _span = tracing::info_span!("verify").entered();
        let candidates = candidates_of(&self.map.view, keyframe);
        let matches = match_by_descriptor(data, &keyframe.data, &candidates);
        let observed = |(i, target): (usize, &Option<Target>)| {
            Some(PoseObservation {
                point: (*target)?.position,
                measurement: measurement(data, i),
            })
        };
        let targets = matches.targets.iter().enumerate();
        let observations: Vec<PoseObservation> = targets.filter_map(observed).collect();
        // Several keyframes are tried for one frame.
        let address = address(frame.id.0, keyframe.id.0);
        let outcome = find_absolute_pose(
            &Intrinsics::from(&data.camera),
            &observations,
            &AbsolutePoseOptions::default(),
            rng(self.setup.seed, address, Purpose::RELOCALISATION),
        );
        let found = outcome.found()?;
        let mut solver = PoseSolver::default();
        let (matches, camera_from_world) = solver.solve(
            data,
            &found.camera_from_world,
            matches,
            PosePrior::default(),
        );
        Some(EgoMotion {
            camera_from_world,
            matches,
            ..EgoMotion::unknown(Arc::clone(data))
        })
    }

    /// Handles a frame without a pose: starts a submap if one is due, else the frame is lost.
    pub(super) fn give_up(
        &mut self,
        frame: &RgbdFrame,
        data: &Arc<KeyframeData>,
        reason: LostReason,
        notes: &mut Notes,
    ) -> Ending {
        let since = self.state.lose(frame.id);
        if !self.is_submap_due(frame.stamp, notes) {
            return Ending::lost(since, reason);
        }
        self.state.leave_submap();
        self.forget_what_moves(notes);
        self.begin_submap(frame, data, notes)
    }

    /// Whether a new submap is due: enough time with well-textured frames but no match. If other submaps exist, these
    /// are given time to be recognised first.
    fn is_submap_due(&mut self, stamp: f64, notes: &Notes) -> bool {
        let shows_enough = notes.counts.with_depth as usize >= MIN_INITIAL_POINTS;
        let unplaced = self.state.count_unplaced(shows_enough, self.pace.worth());
        let due = self.map.grows && unplaced >= self.setup.tracking.new_submap_seconds - 1e-9;
        let recent = |last: &LastFrame| stamp - last.stamp < CARRIED_S + RECOGNISED_S;
        due && !(self.state.last().is_some_and(recent) && self.map.view.submaps().len() > 1)
    }

    /// Resets the static filter of this frame's notes, as its history refers to another reference frame.
    fn forget_what_moves(&self, notes: &mut Notes) {
        let filter = notes.filter.get_or_insert_with(|| self.filter.clone());
        filter.forget();
    }
}

#[cfg(test)]
mod tests;
