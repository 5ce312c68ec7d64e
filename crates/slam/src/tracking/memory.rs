//! Memory that tracking a frame takes, used again from frame to frame: it holds nothing that is known.

use super::ego_motion::EgoMotion;
use super::flow::Guess;
use super::pose::PoseSolver;
use super::self_calibration::RowPair;
use super::statistics::Sighting;
use super::vote::VoteMemory;
use crate::association::{Candidate, MatchMemory};
use crate::recycle::Lists;
use crate::static_filter::{self, FlowPair};
use stillpoint_map::LandmarkId;

/// A memory for each part of the way of a frame.
#[derive(Default)]
pub(super) struct Memory {
    pub(super) filter: static_filter::Memory,
    pub(super) solver: PoseSolver,
    pub(super) vote: VoteMemory,
    pub(super) matching: MatchMemory,
    /// What the last frame saw.
    pub(super) candidates: Vec<Candidate>,
    /// Raw pixels of features.
    pub(super) pixels: Vec<[f32; 2]>,
    /// Features that are looked at again, with where they are expected, raw px.
    pub(super) again: Vec<Guess>,
    pub(super) pairs: Lists<Option<FlowPair>>,
    pub(super) guesses: Lists<Guess>,
    pub(super) rows: Lists<RowPair>,
    pub(super) sightings: Lists<Sighting>,
    pub(super) landmarks: Lists<Option<LandmarkId>>,
    pub(super) depths: Vec<f32>,
}

impl Memory {
    /// Takes back what a motion was found from.
    pub(super) fn give(&mut self, motion: EgoMotion) {
        self.matching.targets.give(motion.matches.targets);
        self.pairs.give(motion.pairs);
        self.guesses.give(motion.rest);
    }
}
