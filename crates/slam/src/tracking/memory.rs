//! Buffers of tracking, reused from frame to frame.

use super::ego_motion::EgoMotion;
use super::flow_search::Guess;
use super::pose::PoseSolver;
use super::self_calibration::RowPair;
use super::statistics::Sighting;
use super::vote::VoteMemory;
use crate::association::{Candidate, MatchMemory};
use crate::recycle::Lists;
use crate::static_filter::{self, FlowPair};
use stillpoint_map::LandmarkId;

#[derive(Default)]
pub(super) struct Memory {
    pub(super) filter: static_filter::Memory,
    pub(super) solver: PoseSolver,
    pub(super) vote: VoteMemory,
    pub(super) matching: MatchMemory,
    /// Points seen in the last frame.
    pub(super) candidates: Vec<Candidate>,
    pub(super) pixels: Vec<[f32; 2]>,
    pub(super) pairs: Lists<Option<FlowPair>>,
    pub(super) guesses: Lists<Guess>,
    pub(super) rows: Lists<RowPair>,
    pub(super) sightings: Lists<Sighting>,
    pub(super) landmarks: Lists<Option<LandmarkId>>,
    pub(super) depths: Vec<f32>,
}

impl Memory {
    pub(super) fn give(&mut self, motion: EgoMotion) {
        self.matching.targets.give(motion.matches.targets);
        self.pairs.give(motion.pairs);
        self.guesses.give(motion.rest);
    }
}
