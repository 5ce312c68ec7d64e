//! Matches to the last frame, or where that fails to the reference keyframe.

use super::matching::{self, Candidate, Matches};
use super::{LastFrame, Tracker, pose};
use crate::event::LostReason;
use stillpoint_geometry::Se3;
use stillpoint_map::{KeyframeData, KeyframeId};

impl Tracker {
    /// Matches to the last frame around the prediction, else wider, else to the reference keyframe by descriptor alone.
    pub(super) fn match_last_frame(
        &self,
        data: &KeyframeData,
        reference: KeyframeId,
        predicted: &Se3,
    ) -> Result<(Matches, Se3), LostReason> {
        let Some(last) = &self.last else {
            return Err(LostReason::FewMatches);
        };
        let min_inliers = self.config.tracking.min_inliers.min(20);
        let bounds = self.observer.bounds();
        let candidates = {
            let _span = tracing::info_span!("match").entered();
            self.last_frame_points(last)
        };
        let radius = self.config.tracking.motion_radius as f32;
        for radius in [radius, 3.0 * radius] {
            let matches = {
                let _span = tracing::info_span!("match").entered();
                matching::match_by_projection(
                    data,
                    predicted,
                    &last.data,
                    &candidates,
                    bounds,
                    radius,
                )
            };
            if matches.count >= min_inliers {
                let (matches, pose) = pose::solve(data, predicted, matches);
                if matches.count >= min_inliers {
                    return Ok((matches, pose));
                }
            }
        }
        let _span = tracing::info_span!("match").entered();
        let keyframe = self
            .view
            .keyframe(reference)
            .ok_or(LostReason::FewMatches)?;
        let candidates: Vec<Candidate> = keyframe
            .matches
            .iter()
            .enumerate()
            .filter_map(|(i, id)| {
                let landmark = (*id)?;
                Some(Candidate {
                    landmark: Some(landmark),
                    position: self.view.landmark_position(landmark)?,
                    feature: i as u32,
                })
            })
            .collect();
        let matches = matching::match_by_descriptor(data, &keyframe.data, &candidates);
        if matches.count < min_inliers {
            return Err(LostReason::FewMatches);
        }
        let start = last.world_from_camera.inverse();
        let (matches, pose) = pose::solve(data, &start, matches);
        if matches.count < min_inliers {
            return Err(LostReason::FewInliers);
        }
        Ok((matches, pose))
    }

    /// The points that the last frame saw: landmarks, and where there is none the point behind its depth. The latter
    /// are there at once, so a map view that comes late costs nothing.
    fn last_frame_points(&self, last: &LastFrame) -> Vec<Candidate> {
        let close = self.config.sensor.close_depth;
        let point = |i: usize| {
            let landmark = last.matches[i].and_then(|id| self.view.resolve_landmark(id));
            let position = match landmark {
                Some(id) => self.view.landmark_position(id)?,
                None => {
                    last.data.depth(i).filter(|z| *z < close)?;
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
        (0..last.data.len()).filter_map(point).collect()
    }
}
