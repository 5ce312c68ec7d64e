//! First estimate of the camera motion, before the static filter.

use super::choice::Vote;
use super::flow_search::Guess;
use super::vote::Search;
use super::{Notes, Tracker};
use crate::association::Matches;
use crate::report::LostReason;
use crate::static_filter::FlowPair;
use std::sync::Arc;
use stillpoint_geometry::{Se3, Vec6};
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::{KeyframeData, KeyframeId};

/// Change of the rolling-shutter displacement below which pairs are not corrected again, px. Chosen: what flow errs by
/// (decision 21).
const SHUTTER_PX: f64 = 0.3;

/// The camera's motion since the last frame, and its evidence.
pub(super) struct EgoMotion {
    /// The features of the frame, measured with a velocity close to `velocity`.
    pub(super) data: Arc<KeyframeData>,
    pub(super) camera_from_world: Se3,
    /// The resulting velocity, twist per second; `None` if the last frame has no pose.
    pub(super) velocity: Option<Vec6>,
    /// Matches to the last frame, or to the map if that failed.
    pub(super) matches: Matches,
    /// Flow of each feature; empty without flow.
    pub(super) pairs: Vec<Option<FlowPair>>,
    /// Features not searched by flow, with their predicted pixels.
    pub(super) rest: Vec<Guess>,
    /// Motion vote of the flow alone.
    pub(super) by_flow: Option<Vote>,
    /// Whether the camera was tracked from the last frame, and not relocalised.
    pub(super) follows: bool,
}

impl EgoMotion {
    /// For the first frame of a map, which defines the origin.
    pub(super) fn unknown(data: Arc<KeyframeData>) -> Self {
        Self {
            camera_from_world: Se3::identity(),
            velocity: None,
            matches: Matches::new(data.len()),
            data,
            pairs: Vec::new(),
            rest: Vec::new(),
            by_flow: None,
            follows: false,
        }
    }
}

impl Tracker {
    /// Estimates the camera motion by flow and by matches to the last frame, from the prediction `predicted`
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
        let (found, mut pairs, rest) = self.follow(frame, data, predicted);
        notes.bound = found.clone().filter(|v| v.is_bound);
        let voted = found.as_ref().map(|v| v.camera_from_world);
        let start = voted.unwrap_or(*predicted);
        let moved = self.motion_to(&start);
        if voted.is_some() {
            self.measure_first_keyframe(&moved);
        }
        let velocity = moved.at_last();
        // The vote gives the velocity, and with it the correction for rolling shutter.
        let measured = self.front_end.measure(frame, velocity.as_ref());
        let data = &*measured;
        let (matches, matched) = self
            .match_last_frame(frame.id, data, reference, &start)
            .or_else(|lost| Ok((Matches::new(data.len()), voted.ok_or(lost)?)))?;
        // While it is undecided which surfaces move, flow determines the camera's motion: matches may lie on people.
        let exact = found.as_ref().filter(|v| v.exact);
        let pose = exact.map_or(matched, |v| v.camera_from_world);
        notes.counts.frame_matches = matches.count as u32;
        self.bring_to_stamps(data, &mut pairs, &self.motion_to(&pose));
        Ok(EgoMotion {
            data: measured,
            camera_from_world: pose,
            velocity: self.motion_to(&pose).at_last(),
            matches,
            pairs,
            rest,
            by_flow: found,
            follows: true,
        })
    }

    /// The vote of the flow; if it changes the velocity, the vote again after rolling-shutter correction.
    fn vote_twice(
        &mut self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        pairs: &mut [Option<FlowPair>],
        start: &Se3,
    ) -> Option<Vote> {
        let vote = self.vote(frame, data, pairs, start, Search::Samples)?;
        let velocity_at = |pose: &Se3| self.motion_to(pose);
        let (expected, found) = (velocity_at(start), velocity_at(&vote.camera_from_world));
        let change = found.at_last()? - expected.at_last()?;
        if self.front_end.shutter().reach_px(&change) < SHUTTER_PX {
            return Some(vote);
        }
        self.bring_to_stamps(data, pairs, &found);
        // The correction is small: no sampling is needed to find the motion again.
        self.vote(frame, data, pairs, &vote.camera_from_world, Search::Refine)
            .or(Some(vote))
    }

    /// Estimates the motion from the last frame by flow. If the velocity is unknown, or flow from the prediction fails,
    /// starts from matches by descriptor. Returns the vote, and the results of [`Tracker::flow`].
    fn follow(
        &mut self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        predicted: &Se3,
    ) -> (Option<Vote>, Vec<Option<FlowPair>>, Vec<Guess>) {
        if !self.filter.wants_flow() {
            let (pairs, rest) = self.flow(data, predicted);
            return (None, pairs, rest);
        }
        let agreed = |vote: &Option<Vote>| vote.as_ref().map_or(0, |v| v.agreed);
        let enough = self.setup.tracking.min_inliers;
        let first = if self.state.velocity().is_some() {
            let (mut pairs, rest) = self.flow(data, predicted);
            let vote = self.vote_twice(frame, data, &mut pairs, predicted);
            if agreed(&vote) >= enough {
                return (vote, pairs, rest);
            }
            Some((vote, pairs, rest))
        } else {
            None
        };
        let found = self.vote_by_descriptors(frame, data);
        // If a person fills the view, most descriptors lie on that person.
        let may_ride = self.known_since_last().is_some_and(|k| self.may_ride(&k));
        let found = found.filter(|v| !may_ride && self.may_be(&v.camera_from_world));
        let start = found.as_ref().map_or(*predicted, |v| v.camera_from_world);
        let (mut pairs, rest) = self.flow(data, &start);
        let vote = self.vote_twice(frame, data, &mut pairs, &start);
        let second = (vote, pairs, rest);
        let (mut vote, pairs, rest) = match first {
            Some(first) if agreed(&first.0) >= agreed(&second.0) => first,
            _ => second,
        };
        if agreed(&vote) < enough && agreed(&found) >= enough {
            vote = found;
        }
        (vote, pairs, rest)
    }
}
