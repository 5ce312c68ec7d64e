//! The flow vote: camera motion since the last frame by robust voting, before moving objects are known.
//!
//! Two measures keep a crowd from winning. Every pair is weighted by the surface area it represents: people are near
//! and their clothes full of corners, but a room is large. And inliers are judged sharply: between two frames, a
//! compromise between the motion of a desk and that of a person walking slowly past it fits both to a few pixels.

use super::Tracker;
use super::choice::{Choice, PLAIN_SHARE, Vote};
use super::crowd::{CROWD, SOME_MOVE, UNDECIDED};
use super::known::{GATE_POSE, Known};
use crate::association::{Candidate, match_by_descriptor, measurement};
use crate::static_filter::FlowPair;
use stillpoint_estimation::{
    Intrinsics, KnownPlace, Measurement, MotionFinder, MotionOptions, MotionPair, MotionPrior,
    Purpose, find_camera_motion, rng,
};
use stillpoint_geometry::{Se3, Vec6};
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::KeyframeData;

/// Assumed error of the flow in a sharp image, px, including that of corners on edges and of depths. Chosen: with
/// [`SIGMAS`] of a sharp pair (0.1 px) it is about 1 px in all, with which the gates of decision 21 are 2.8 px.
const SIGMA_PX: f64 = 0.85;
/// Number of standard deviations of a flow pair that are added in quadrature to its assumed error: chosen on the
/// recordings of decision 23, which brought a deviation per pair.
const SIGMAS: f64 = 5.0;
/// Sharpness of the vote: it is halved at an eighth of the gate's residual, a third of a pixel, which flow errs by
/// (decision 21).
const PEAK: f64 = 60.0;
/// Sharpness for matches by descriptor, which err by a pixel and more (decision 21): the vote is halved at a third of
/// the gate's residual, one pixel.
const ROUGH_PEAK: f64 = 6.0;
/// Error of a constant-velocity prediction after a frame, m and rad (decision 54, which measured a
/// prior of 20 mm).
const PRIOR_SIGMA: f64 = 0.02;
/// Minimum error of a prediction by wheels, including that of votes, rad: chosen, between the error of two poses
/// (`trust::POSES_SIGMA`) and [`GATE_POSE`], which is that of the translation.
const WHEELED_SIGMA_RAD: f64 = 0.004;
/// Maximum number of voting pairs: enough for a pose to a millimetre. Chosen: a pair that errs by a third of a pixel
/// gives 1.2 mm at 2 m (f = 535 px), and 300 average out their independent errors.
const MAX_PAIRS: usize = 300;
/// Minimum share of the weight that must agree on the motion. Chosen: people held 28 % of the image in the case of
/// decision 21.
const MIN_WEIGHT_SHARE: f64 = 0.4;
/// Minimum number of agreeing matches by descriptor, together with half of [`MIN_WEIGHT_SHARE`]: over a wide baseline
/// most matches are wrong, and such an agreement to a pixel is no coincidence. Flow starting from that motion then
/// decides which motion is the camera's. The code of ORB-SLAM2 (Mur-Artal, Tardos 2017) requires as many matches to the
/// last frame.
const ROUGH_AGREED: usize = 20;
/// Minimum share of the weight for a motion bound to sensors, which rule out other motions. People fill up to nine
/// tenths of a view (decision 39), of which this is the rest.
const MIN_BOUND_SHARE: f64 = 0.1;
/// Side of the image blocks with equal weight, px: chosen, 16x12 blocks of 640x480, each as wide as a head of 15 cm at
/// 2 m (f = 535 px).
const BLOCK_PX: f64 = 40.0;
/// Depth above which the weight does not grow, m: farther points constrain rotation only. It is half of the default of
/// `sensor.max_depth`; chosen.
const FAR: f64 = 4.0;

/// How a vote searches for the motion.
#[derive(Clone, Copy, Debug)]
pub(super) enum Search {
    /// RANSAC, with the predicted motion as first hypothesis.
    Samples,
    /// Refinement of the predicted motion alone.
    Refine,
}

impl Search {
    /// Options of a vote, judged sharply if `exact`, with the shift that the motion model predicts.
    fn options(self, exact: bool, place: Option<KnownPlace>) -> MotionOptions {
        let options = MotionOptions {
            peak: if exact { PEAK } else { 0.0 },
            place,
            ..MotionOptions::default()
        };
        let max_iterations = match self {
            Self::Samples => options.max_iterations,
            Self::Refine => 0,
        };
        MotionOptions {
            max_iterations,
            ..options
        }
    }
}

#[derive(Default)]
pub(super) struct VoteMemory {
    voters: Vec<MotionPair>,
    /// Image block of each pair.
    blocks: Vec<[i64; 2]>,
    finder: MotionFinder,
    inliers: Vec<bool>,
}

impl Tracker {
    /// Camera motion since the last frame by a flow vote. Features on surfaces that moved before have little weight.
    pub(super) fn vote(
        &mut self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        pairs: &[Option<FlowPair>],
        predicted: &Se3,
        search: Search,
    ) -> Option<Vote> {
        let mut memory = std::mem::take(&mut self.memory.vote);
        let vote = self.vote_in(&mut memory, frame, data, (pairs, predicted), search);
        self.memory.vote = memory;
        vote
    }

    fn vote_in(
        &mut self,
        memory: &mut VoteMemory,
        frame: &RgbdFrame,
        data: &KeyframeData,
        (pairs, predicted): (&[Option<FlowPair>], &Se3),
        search: Search,
    ) -> Option<Vote> {
        let _span = tracing::info_span!("motion").entered();
        let last = self.state.last().filter(|_| !pairs.is_empty())?;
        let known = self.known_since_last();
        let prior = self.prior(&last.world_from_camera, predicted, known.as_ref());
        // Once moving surfaces are known and down-weighted, wide gates are more accurate, also in blurred images.
        let exact = frame.stamp - self.beginning.stamp < UNDECIDED || self.moving_share > SOME_MOVE;
        let velocity = self.motion_to(predicted).at_before();
        let VoteMemory {
            voters: votes,
            blocks,
            finder,
            inliers,
        } = memory;
        self.voters(data, pairs, velocity.as_ref(), votes)?;
        if exact {
            give_say_by_area(votes, blocks);
        }
        let options = search.options(exact, self.known_shift());
        let (address, camera) = (u64::from(frame.id.0), Intrinsics::from(&data.camera));
        let last_from_world = last.world_from_camera.inverse();
        let mut find = |votes: &[MotionPair], turn, least, inliers: &mut Vec<bool>| {
            let options = MotionOptions { turn, ..options };
            let rng = rng(self.setup.seed, address, Purpose::CAMERA_MOTION);
            let motion = finder.find(&camera, votes, Some(&prior), &options, rng)?;
            finder.reuse(std::mem::replace(inliers, motion.inliers));
            (motion.weight_share >= least).then(|| Vote {
                camera_from_world: motion.b_from_a.inverse() * last_from_world,
                exact,
                agreed: motion.count,
                voted: votes.len(),
                information: motion.information,
                share: motion.weight_share,
                is_bound: turn.is_some(),
            })
        };
        let free = find(votes, None, MIN_WEIGHT_SHARE, inliers);
        let Some((known, turn)) = known.and_then(|k| Some((k, self.known_motion(&k)?))) else {
            return free;
        };
        let allowed = |v: &Vote| turn.allows(&(last_from_world * v.camera_from_world.inverse()));
        let rules = self.rules(&known);
        if let Some(vote) = &free {
            // If nearly all agree, nothing else moves, unless a person fills the view; contradicting wheels slip.
            let is_plain = vote.share >= PLAIN_SHARE && (allowed(vote) || !known.by_gyro);
            if is_plain && !(rules && self.may_be_filled()) {
                return free;
            }
            // Pairs that contradict a deciding sensor lose their weight.
            if rules && !allowed(vote) {
                let riders = votes.iter_mut().zip(&*inliers).filter(|(_, rides)| **rides);
                riders.for_each(|(pair, _)| pair.weight = 0.0);
            }
        }
        let bound = find(votes, Some(turn), MIN_BOUND_SHARE, inliers);
        // A person who fills the view and moves nearly as the camera does passes the gate too.
        let free = free.filter(|_| !self.may_ride(&known));
        let agrees = free.as_ref().is_none_or(allowed);
        let choice = Choice::between(free, bound, agrees, rules);
        if choice.against {
            self.stand_against(&known);
        }
        choice.vote
    }

    /// Whether a person may fill the view, so that near-unanimity is no proof.
    fn may_be_filled(&self) -> bool {
        self.was_blind() || self.moving_share > CROWD
    }

    /// Whether only the sensor's motion may be accepted as the camera's, because a person may fill the view. Wheels
    /// slip, so the map takes precedence over them while it is visible.
    pub(super) fn may_ride(&self, known: &Known) -> bool {
        let filled = self.was_blind() || (known.by_gyro && self.may_be_filled());
        filled && self.rules(known)
    }

    /// Prior on the motion: from confirmed wheels, else constant velocity.
    fn prior(&self, world_from_last: &Se3, predicted: &Se3, known: Option<&Known>) -> MotionPrior {
        let wheels = known
            .filter(|k| k.confirmed)
            .and_then(|k| Some((k, k.shift?)));
        let (sigma_m, sigma_rad) = match wheels {
            Some((known, shift)) => (
                shift.sigma.max(GATE_POSE),
                known.turn.sigma.max(WHEELED_SIGMA_RAD),
            ),
            None => (PRIOR_SIGMA, PRIOR_SIGMA),
        };
        MotionPrior {
            b_from_a: world_from_last.inverse() * predicted.inverse(),
            sigma_m,
            sigma_rad,
        }
    }

    /// Gathers the voting pairs, spread over the features, with camera velocity `velocity` in the last frame.
    fn voters(
        &self,
        data: &KeyframeData,
        pairs: &[Option<FlowPair>],
        velocity: Option<&Vec6>,
        voters: &mut Vec<MotionPair>,
    ) -> Option<()> {
        let previous = self.images.previous.as_ref()?;
        let reader = self.depth_reader(previous, velocity);
        let shutter = self.front_end.shutter();
        let with_depth =
            || (0..pairs.len()).filter(|i| pairs[*i].is_some() && data.depth(*i).is_some());
        let step = with_depth().count().div_ceil(MAX_PAIRS).max(1);
        let voter = |i: usize| {
            let pair = pairs[i]?;
            let reading =
                reader.read(pair.before_raw.map(f64::from).into(), pair.before_exposed)?;
            let raw_y = f64::from(pair.before_raw[1]);
            let before = shutter.at_stamp(pair.before_exposed, raw_y, reading.z, velocity);
            let (z, sigma) = (data.depth(i)?, f64::from(data.depth_sigmas[i]));
            // Both depths have errors: the point's error is added to that of the measurement.
            let sigma = (reading.sigma * reading.sigma + sigma * sigma).sqrt();
            let sigma_px = libm::hypot(SIGMA_PX, SIGMAS * pair.sigma());
            Some(MotionPair {
                point: data.camera.backproject(pair.now, z),
                measurement: Measurement::new(pair.before, sigma_px, Some((before.z, sigma)))
                    .on_edge(pair.edge),
                // From the last frame, whose surfaces are judged already; those of this frame need its pose first.
                weight: self.filter.say(pair.before_raw),
            })
        };
        voters.clear();
        voters.extend(with_depth().step_by(step).filter_map(voter));
        Some(())
    }

    /// Camera motion since the last frame with a pose from matches by descriptor anywhere in the image: used while
    /// there is no velocity, and when flow failed after an abrupt turn. Points that moved then are excluded.
    pub(super) fn vote_by_descriptors(
        &self,
        frame: &RgbdFrame,
        data: &KeyframeData,
    ) -> Option<Vote> {
        let _span = tracing::info_span!("motion").entered();
        let last = self.state.last()?;
        let candidate = |i: usize| {
            Some(Candidate {
                landmark: None,
                position: last.data.point_in_camera(i)?,
                feature: i as u32,
            })
        };
        let candidates: Vec<Candidate> = (0..last.data.len()).filter_map(candidate).collect();
        let matches = match_by_descriptor(data, &last.data, &candidates);
        let targets = matches.targets.iter().enumerate();
        let mut votes: Vec<MotionPair> = targets
            .filter_map(|(i, t)| {
                Some(MotionPair {
                    point: (*t)?.position,
                    measurement: measurement(data, i),
                    weight: 1.0,
                })
            })
            .collect();
        give_say_by_area(&mut votes, &mut Vec::new());
        let address = u64::from(frame.id.0);
        let motion = find_camera_motion(
            &Intrinsics::from(&data.camera),
            &votes,
            None,
            &MotionOptions {
                peak: ROUGH_PEAK,
                ..MotionOptions::default()
            },
            rng(self.setup.seed, address, Purpose::FIRST_MOTION),
        )?;
        let believed =
            motion.count >= ROUGH_AGREED && motion.weight_share >= 0.5 * MIN_WEIGHT_SHARE;
        believed.then(|| Vote {
            camera_from_world: motion.b_from_a * last.world_from_camera.inverse(),
            exact: false,
            agreed: motion.count,
            voted: votes.len(),
            information: motion.information,
            share: motion.weight_share,
            is_bound: false,
        })
    }
}

/// Gives each image block the same weight, shared by its pairs, and more to distant ones: a surface has as many corners
/// near as far, but covers less of the image.
fn give_say_by_area(votes: &mut [MotionPair], blocks: &mut Vec<[i64; 2]>) {
    let block = |p: &MotionPair| {
        let pixel = p.measurement.pixel / BLOCK_PX;
        [pixel.x.floor() as i64, pixel.y.floor() as i64]
    };
    blocks.clear();
    blocks.extend(votes.iter().map(block));
    blocks.sort_unstable();
    for vote in votes {
        let own = block(vote);
        let first = blocks.partition_point(|b| *b < own);
        let count = blocks[first..].partition_point(|b| *b == own);
        vote.weight *= vote.point.z.clamp(0.0, FAR) / count as f64;
    }
}
