//! Matches to the last frame, or if that fails to keyframes.

use super::Tracker;
use super::pose::PosePrior;
use super::state::LastFrame;
use crate::association::{
    Candidate, Matches, candidates_of, match_by_descriptor, match_by_projection, measurement,
};
use crate::report::LostReason;
use std::sync::Arc;
use stillpoint_estimation::{
    Intrinsics, MotionOptions, MotionPair, Purpose, address, find_camera_motion, rng,
};
use stillpoint_geometry::Se3;
use stillpoint_imaging::FrameId;
use stillpoint_map::{Keyframe, KeyframeData, KeyframeId};

/// Search radius around the prediction from the last frame, px on level 0, as in ORB-SLAM2 (Mur-Artal, Tardos 2017).
const MOTION_RADIUS_PX: f32 = 15.0;
/// If the last frame does not match, number of keyframes to try that are most covisible with the reference keyframe:
/// chosen, as each costs a comparison of all descriptors. Half as many of the newest follow.
const COVISIBLE: usize = 8;

impl Tracker {
    /// Matches to the last frame around the prediction, else in wider windows, else to keyframes by descriptor alone.
    pub(super) fn match_last_frame(
        &mut self,
        frame: FrameId,
        data: &KeyframeData,
        reference: KeyframeId,
        predicted: &Se3,
    ) -> Result<(Matches, Se3), LostReason> {
        let Some(last) = self.state.last() else {
            return Err(LostReason::FewMatches);
        };
        let min_inliers = self.setup.tracking.min_inliers.min(20);
        let bounds = self.front_end.observer.bounds();
        let prior = PosePrior {
            turn: None,
            place: self.known_place(predicted),
        };
        let mut candidates = std::mem::take(&mut self.memory.candidates);
        {
            let _span = tracing::info_span!("match").entered();
            self.last_frame_points(last, &mut candidates);
        }
        let earlier = (&*Arc::clone(&last.data), &candidates[..]);
        let memory = &mut self.memory;
        let mut found = None;
        for radius in [MOTION_RADIUS_PX, 3.0 * MOTION_RADIUS_PX] {
            let matches = {
                let _span = tracing::info_span!("match").entered();
                let level_scales = self.front_end.observer.level_scales();
                let area = (bounds, level_scales, radius);
                match_by_projection(data, predicted, earlier, area, &mut memory.matching)
            };
            if matches.count >= min_inliers {
                let (matches, pose) = memory.solver.solve(data, predicted, matches, prior);
                if matches.count >= min_inliers {
                    found = Some((matches, pose));
                    break;
                }
            }
        }
        memory.candidates = candidates;
        if let Some(found) = found {
            return Ok(found);
        }
        self.match_keyframes(frame, data, reference)
            .ok_or(LostReason::FewMatches)
    }

    /// Matches by descriptor to the reference keyframe, its most covisible ones, and the newest. Takes the first that
    /// gives a pose.
    fn match_keyframes(
        &mut self,
        frame: FrameId,
        data: &KeyframeData,
        reference: KeyframeId,
    ) -> Option<(Matches, Se3)> {
        let mut ids = vec![reference];
        if let Some(k) = self.map.view.keyframe(reference) {
            ids.extend(k.covisible.iter().take(COVISIBLE).map(|c| c.0));
        }
        let submap = self.map.view.submap_of(reference);
        let of_submap = self
            .map
            .view
            .keyframes()
            .filter(|k| Some(k.submap) == submap);
        let newest: Vec<KeyframeId> = of_submap.map(|k| k.id).collect();
        ids.extend(newest.iter().rev().take(COVISIBLE / 2));
        let mut tried: Vec<KeyframeId> = Vec::new();
        for id in ids {
            if tried.contains(&id) {
                continue;
            }
            tried.push(id);
            let view = Arc::clone(&self.map.view);
            let found = view
                .keyframe(id)
                .and_then(|k| self.match_keyframe(frame, data, k));
            if found.is_some() {
                return found;
            }
        }
        None
    }

    /// Matches to one keyframe by descriptor, estimates the pose by RANSAC, and refines it.
    fn match_keyframe(
        &mut self,
        frame: FrameId,
        data: &KeyframeData,
        keyframe: &Keyframe,
    ) -> Option<(Matches, Se3)> {
        let min_inliers = self.setup.tracking.min_inliers.min(20);
        let (matches, votes) = {
            let _span = tracing::info_span!("match").entered();
            let candidates = candidates_of(&self.map.view, keyframe);
            let matches = match_by_descriptor(data, &keyframe.data, &candidates);
            let camera_from_world = keyframe.world_from_camera.inverse();
            let votes: Vec<MotionPair> = matches
                .targets
                .iter()
                .enumerate()
                .filter_map(|(i, target)| {
                    Some(MotionPair {
                        point: camera_from_world.transform(&(*target)?.position),
                        measurement: measurement(data, i),
                        weight: 1.0,
                    })
                })
                .collect();
            (matches, votes)
        };
        if matches.count < min_inliers {
            return None;
        }
        let motion = find_camera_motion(
            &Intrinsics::from(&data.camera),
            &votes,
            None,
            &MotionOptions::default(),
            rng(
                self.setup.seed,
                address(frame.0, keyframe.id.0),
                Purpose::KEYFRAME_MOTION,
            ),
        )?;
        let start = motion.b_from_a * keyframe.world_from_camera.inverse();
        let (matches, pose) = self
            .memory
            .solver
            .solve(data, &start, matches, PosePrior::default());
        (matches.count >= min_inliers).then_some((matches, pose))
    }

    /// Points seen in the last frame: landmarks, or temporary points from depth. The latter bridge a late map view.
    fn last_frame_points(&self, last: &LastFrame, points: &mut Vec<Candidate>) {
        // Before the first landmarks exist, distant points are needed to constrain rotation.
        let first = self.keyframes.first.is_some();
        let close = self.setup.sensor.close_depth;
        let point = |i: usize| {
            let landmark = last.matches[i].and_then(|id| self.map.view.resolve_landmark(id));
            let position = match landmark {
                Some(id) => self.map.view.landmark_position(id)?,
                None => {
                    last.data.depth(i).filter(|z| first || *z < close)?;
                    last.world_from_camera
                        .transform(&last.data.point_in_camera(i)?)
                }
            };
            Some(Candidate {
                landmark,
                position,
                feature: i as u32,
            })
        };
        points.clear();
        points.reserve(last.data.len());
        points.extend((0..last.data.len()).filter_map(point));
    }
}
