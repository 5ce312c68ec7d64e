//! How the camera moved, before anything is known of what else does.

use super::flow::Guess;
use super::{Notes, Tracker};
use crate::association::Matches;
use crate::report::LostReason;
use crate::static_filter::FlowPair;
use stillpoint_geometry::{Se3, Vec6};
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::{KeyframeData, KeyframeId};

/// The camera's motion since the last frame, and what it was found from.
pub(super) struct EgoMotion {
    /// The first pose.
    pub(super) camera_from_world: Se3,
    /// The velocity that it amounts to, twist per second; none when the last frame has no pose.
    pub(super) velocity: Option<Vec6>,
    /// What the features see of the last frame, or of the map where that failed.
    pub(super) matches: Matches,
    /// Where each feature was in the frame before; empty where flow is not known of any.
    pub(super) pairs: Vec<Option<FlowPair>>,
    /// Features that were not looked for there, with where they are expected.
    pub(super) rest: Vec<Guess>,
    /// `camera_from_world` by a vote of the flow alone.
    pub(super) by_flow: Option<Se3>,
}

impl EgoMotion {
    /// What is known of the first frame of a map: that the camera is where the map begins.
    pub(super) fn unknown() -> Self {
        Self {
            camera_from_world: Se3::identity(),
            velocity: None,
            matches: Matches::new(0),
            pairs: Vec::new(),
            rest: Vec::new(),
            by_flow: None,
        }
    }
}

impl Tracker {
    /// Finds the camera's motion by flow and by matches to the last frame, from the prediction `predicted`
    /// (`camera_from_world`).
    pub(super) fn estimate_motion(
        &mut self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        reference: KeyframeId,
        predicted: &Se3,
        notes: &mut Notes,
    ) -> Result<EgoMotion, LostReason> {
        if data.len() < self.setup.tracking.min_inliers {
            return Err(LostReason::FewFeatures);
        }
        let (mut pairs, rest) = self.flow(data, predicted);
        let by_flow = self.pose_by_flow(frame, data, &pairs, predicted);
        let (matches, pose) = self
            .match_last_frame(frame.id, data, reference, &by_flow.unwrap_or(*predicted))
            .or_else(|lost| Ok((Matches::new(data.len()), by_flow.ok_or(lost)?)))?;
        notes.counts.frame_matches = matches.count as u32;
        self.recheck_flow(data, &mut pairs, &pose);
        Ok(EgoMotion {
            camera_from_world: pose,
            velocity: self.state.motion_to(&pose, frame.stamp).velocity().copied(),
            matches,
            pairs,
            rest,
            by_flow,
        })
    }
}
