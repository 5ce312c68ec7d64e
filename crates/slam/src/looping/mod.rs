//! Loop closing: recognises places mapped twice and computes corrections.
//!
//! Owns the place index. Works on a view of the map, which it does not change.

mod agree;
mod config;
mod correct;
mod drift;
mod evidence;
mod nodes;
mod points;
mod recognise;
mod revisit;
mod shared;
mod support;
mod verify;

pub use config::{LoopCloserSetup, LoopingConfig};

use crate::loop_evidence::LoopEvidence;
use crate::messages::{LoopCloserMsg, LoopCloserOut};
use crate::report::{LoopOutcome, LoopReport};
use agree::agreeing;
use correct::Proposal;
use drift::Drift;
use nodes::{Nodes, group_of};
use recognise::{CANDIDATES, Candidate};
use std::collections::BTreeMap;
use std::sync::Arc;
use stillpoint_map::{Correction, Keyframe, KeyframeId, LoopEdge, MapView, SubmapId};
use stillpoint_place::{PlaceIndex, PlaceVector, Vocabulary};
use verify::Verified;

/// Minimum number of keyframes between two closed loops, so that the map settles. As in ORB-SLAM2 (Mur-Artal, Tardos
/// 2017).
const MIN_GAP: usize = 10;
/// Maximum number of remembered motions to older keyframes: those of six keyframes at least, with as many candidates by
/// appearance as by position (twice `CANDIDATES`). Six are chosen.
const SIGHTINGS: usize = 6 * 2 * CANDIDATES;

/// Closes loops and joins submaps.
pub struct LoopCloser {
    config: LoopingConfig,
    seed: u64,
    scale_factor: f64,
    vocabulary: Vocabulary,
    index: PlaceIndex<KeyframeId>,
    edges: Vec<LoopEdge>,
    /// Motions of the last keyframes to older ones, whether a loop was closed or not.
    sightings: Vec<LoopEdge>,
    min_held: usize,
    last_closed: Option<KeyframeId>,
    /// First version of the map that contains the last correction; `None` until the mapper replies.
    valid_from: Option<u64>,
}

impl LoopCloser {
    /// A loop closer without known places.
    #[must_use]
    pub fn new(setup: impl Into<LoopCloserSetup>) -> Self {
        let setup = setup.into();
        Self {
            config: setup.looping,
            seed: setup.seed,
            scale_factor: f64::from(setup.scale_factor),
            vocabulary: Vocabulary::embedded(),
            index: PlaceIndex::default(),
            edges: Vec::new(),
            sightings: Vec::new(),
            min_held: setup.min_held,
            last_closed: None,
            valid_from: Some(0),
        }
    }

    /// Processes a message; the reply has a correction if a loop was closed.
    pub fn step(&mut self, message: LoopCloserMsg) -> LoopCloserOut {
        match message {
            LoopCloserMsg::Keyframe { id, view } => self.take_keyframe(id, &view),
            LoopCloserMsg::Rejudged { id, view } => {
                if let Some(keyframe) = view.keyframe(id) {
                    self.learn(keyframe);
                }
                self.answer()
            }
            LoopCloserMsg::Revoked { first, last, .. } => {
                let holds = |e: &LoopEdge| {
                    let of_it = |id: KeyframeId| id >= first && id <= last;
                    !of_it(e.old) && !of_it(e.new)
                };
                self.edges.retain(holds);
                self.sightings.retain(holds);
                // Places of revoked keyframes are removed together with culled ones.
                self.answer()
            }
            LoopCloserMsg::Known { view } => {
                for keyframe in view.keyframes() {
                    self.learn(keyframe);
                }
                self.answer()
            }
            LoopCloserMsg::Corrected { map_version } => {
                self.valid_from = Some(map_version);
                self.answer()
            }
        }
    }

    fn take_keyframe(&mut self, id: KeyframeId, view: &MapView) -> LoopCloserOut {
        let Some(keyframe) = view.keyframe(id).map(Arc::clone) else {
            return self.answer();
        };
        let mut candidates = self.recognise(view, &keyframe);
        candidates.extend(self.revisited(view, &keyframe, &candidates));
        let (correction, report) = self.close(view, &keyframe, &candidates);
        LoopCloserOut {
            correction,
            report,
            ..self.answer()
        }
    }

    /// A reply with the current place index only.
    fn answer(&self) -> LoopCloserOut {
        LoopCloserOut {
            correction: None,
            report: None,
            places: self.index.clone(),
        }
    }

    fn learn(&mut self, keyframe: &Keyframe) -> Arc<PlaceVector> {
        let data = &keyframe.data;
        let vector = self
            .vocabulary
            .vector_of(&data.descriptors, |i| data.mappable[i]);
        let vector = Arc::new(vector);
        self.index.insert(keyframe.id, Arc::clone(&vector));
        vector
    }

    /// Evaluates the candidates and corrects the map with the best one, if its evidence suffices.
    fn close(
        &mut self,
        view: &MapView,
        keyframe: &Keyframe,
        candidates: &[Candidate],
    ) -> (Option<Correction>, Option<LoopReport>) {
        if !self.is_up_to_date(view) {
            return (None, None);
        }
        let too_soon = self.is_too_soon(view, keyframe.id);
        let mut look = Look {
            view,
            keyframe,
            drifts: BTreeMap::new(),
        };
        let mut best: Option<(LoopReport, Option<Verified>)> = None;
        for candidate in candidates {
            let Some(with) = view.keyframe(candidate.with) else {
                continue;
            };
            // Submaps are joined without delay, as their poses are unrelated until then.
            if too_soon && with.submap == keyframe.submap {
                continue;
            }
            let mut report = begun(keyframe.id, candidate);
            let verified = self.judge(&mut look, with, candidate, &mut report);
            if best.as_ref().is_none_or(|b| is_better(&report, &b.0)) {
                best = Some((report, verified));
            }
        }
        let Some((mut report, verified)) = best else {
            return (None, None);
        };
        let closed = verified
            .filter(|_| report.outcome == LoopOutcome::Closed)
            .and_then(|verified| self.correct(&mut look, &verified, &mut report));
        (closed, Some(report))
    }

    /// Estimates the motion to a candidate and weighs the evidence.
    fn judge<'a>(
        &mut self,
        look: &mut Look<'a>,
        with: &Keyframe,
        candidate: &Candidate,
        report: &mut LoopReport,
    ) -> Option<Verified> {
        let (view, keyframe, by) = (look.view, look.keyframe, candidate.by);
        let verified = match self.verify(view, keyframe, with, by, report) {
            Ok(verified) => verified,
            Err(reason) => {
                report.outcome = reason;
                return None;
            }
        };
        let edge = verified.edge(with.id, keyframe.id, report.inliers);
        self.remember(edge);
        let drift = self.drift(look, with.submap);
        report.agreeing = agreeing(view, drift, &edge, &self.sightings) as u32;
        let mut evidence = LoopEvidence {
            prior: evidence::prior(by),
            looks: evidence::looks(candidate.score, candidate.rival, by),
            landmarks: evidence::landmarks(report.inliers, report.expected),
            witnesses: evidence::witnesses(report.agreeing),
            place: 0.0,
        };
        // Different submaps have no relative pose yet, so position is no evidence.
        if with.submap == keyframe.submap {
            let Some((cost, covariance)) = drift.cost(view, &edge) else {
                report.outcome = LoopOutcome::TooLittle;
                return None;
            };
            report.cost = cost;
            evidence.place = evidence::place(cost, &covariance, drift.spread, by);
        }
        let least = libm::log(self.config.min_odds);
        report.evidence = Some(evidence);
        report.outcome = if evidence.log_odds() >= least {
            LoopOutcome::Closed
        } else if evidence.is_elsewhere(least) {
            LoopOutcome::Elsewhere
        } else {
            LoopOutcome::TooLittle
        };
        Some(verified)
    }

    fn correct(
        &mut self,
        look: &mut Look<'_>,
        verified: &Verified,
        report: &mut LoopReport,
    ) -> Option<Correction> {
        let (view, keyframe) = (look.view, look.keyframe);
        let with = view.keyframe(report.with)?;
        let edge = verified.edge(with.id, keyframe.id, report.inliers);
        let proposal = Proposal {
            view,
            keyframe,
            with,
            verified,
            edge,
            min_held: self.min_held,
            scale_factor: self.scale_factor,
        };
        let Some(correction) = proposal.correct(self.drift(look, with.submap), report) else {
            report.outcome = LoopOutcome::Elsewhere;
            return None;
        };
        // Joined submaps are connected by their tree of parents.
        if correction.join.is_none() {
            self.edges.push(edge);
        }
        self.last_closed = Some(keyframe.id);
        // Until the mapper replies, every view predates this correction.
        self.valid_from = None;
        // These sightings belong to the loop just closed.
        self.sightings.clear();
        report.joined = correction.join;
        Some(correction)
    }

    /// Drift between the keyframe's submap and another one.
    fn drift<'b, 'a>(&self, look: &'b mut Look<'a>, submap: SubmapId) -> &'b Drift<'a> {
        let (view, own) = (look.view, look.keyframe.submap);
        look.drifts.entry(submap).or_insert_with(|| {
            let nodes = Nodes::new(view, submap, own);
            Drift::new(view, nodes, &self.edges)
        })
    }

    /// Stores a sighting, dropping the oldest if full.
    fn remember(&mut self, sighting: LoopEdge) {
        if self.sightings.len() == SIGHTINGS {
            self.sightings.remove(0);
        }
        self.sightings.push(sighting);
    }

    /// Whether a view contains the last correction. Correcting an older one would remove the same drift twice.
    fn is_up_to_date(&self, view: &MapView) -> bool {
        self.valid_from.is_some_and(|v| view.version() >= v)
    }

    fn is_too_soon(&self, view: &MapView, now: KeyframeId) -> bool {
        self.last_closed.is_some_and(|last| {
            let between = view.keyframes().filter(|k| k.id > last && k.id <= now);
            between.count() < MIN_GAP
        })
    }
}

struct Look<'a> {
    view: &'a MapView,
    keyframe: &'a Keyframe,
    /// Drift by the candidate's submap, computed on first use, as it is the most expensive step.
    drifts: BTreeMap<SubmapId, Drift<'a>>,
}

/// Whether candidate `a` has more evidence, or without evidence more inliers.
fn is_better(a: &LoopReport, b: &LoopReport) -> bool {
    let odds = |r: &LoopReport| r.evidence.map_or(f64::NEG_INFINITY, |e| e.log_odds());
    let found = |r: &LoopReport| (r.inliers, r.rigid_inliers);
    odds(a)
        .total_cmp(&odds(b))
        .then(found(a).cmp(&found(b)))
        .is_gt()
}

/// An empty report on a candidate.
fn begun(keyframe: KeyframeId, candidate: &Candidate) -> LoopReport {
    LoopReport {
        keyframe,
        with: candidate.with,
        score: candidate.score,
        rival: candidate.rival,
        rigid_inliers: 0,
        inliers: 0,
        expected: 0,
        agreeing: 0,
        edge: None,
        joined: None,
        cost: 0.0,
        evidence: None,
        merges: 0,
        moved_m: 0.0,
        bundle: Default::default(),
        outcome: LoopOutcome::Closed,
        applied: None,
    }
}

#[cfg(test)]
mod tests;
