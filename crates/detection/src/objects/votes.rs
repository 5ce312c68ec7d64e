//! What the detections of an object say together: that it is one, of which class, and how sure they are as a rule.

use crate::{ClassId, Detection};
use std::collections::BTreeMap;

/// Scores of false alarms are about the detector's threshold: this much is no evidence.
const LEAST_SCORE: f64 = 0.2;
/// What scores exceed [`LEAST_SCORE`] by in sum, from which an object is reported as one.
const REPORTED_EVIDENCE: f64 = 0.9;
/// Share of the score that its detections usually have, from which one may be its own.
const AS_SURE: f64 = 0.6;
/// Detections of which a mean is kept.
const USUAL: u32 = 10;

/// See the module.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Votes {
    /// Sum of the scores by class.
    classes: BTreeMap<ClassId, f64>,
    /// What the scores say in sum for there being something.
    evidence: f64,
    /// Mean score of the last detections.
    usual: f64,
}

impl Votes {
    pub(super) fn new(first: &Detection) -> Self {
        let score = f64::from(first.score);
        Self {
            classes: BTreeMap::from([(first.class, score)]),
            evidence: evidence(score),
            usual: score,
        }
    }

    /// Takes in the detection that is number `hits`.
    pub(super) fn add(&mut self, d: &Detection, hits: u32) {
        let score = f64::from(d.score);
        self.evidence += evidence(score);
        let share = 1.0 / f64::from(hits.clamp(1, USUAL));
        self.usual += share * (score - self.usual);
        *self.classes.entry(d.class).or_default() += score;
    }

    /// Takes in those of an object that turned out to be the same.
    pub(super) fn merge(&mut self, other: &Self) {
        self.evidence += other.evidence;
        for (class, score) in &other.classes {
            *self.classes.entry(*class).or_default() += score;
        }
    }

    /// The class that most speaks for; of equals `own`, the one that it is.
    pub(super) fn class(&self, own: ClassId) -> ClassId {
        let least = self.classes.get(&own).copied().unwrap_or(0.0);
        let best = self.classes.iter().max_by(|a, b| a.1.total_cmp(b.1));
        best.filter(|b| *b.1 > least).map_or(own, |b| *b.0)
    }

    /// Whether the scores are enough to call it an object.
    pub(super) fn suffice(&self) -> bool {
        self.evidence >= REPORTED_EVIDENCE
    }

    /// They are enough from now on.
    pub(super) fn are_enough(&mut self) {
        self.evidence = self.evidence.max(REPORTED_EVIDENCE);
    }

    /// Whether they are far surer than a detection of this score: that is rather a false alarm beside the object than its own.
    pub(super) fn surer_than(&self, score: f64) -> bool {
        score < AS_SURE * self.usual
    }

    /// Whether they are far surer than those of another object.
    pub(super) fn surer_than_those_of(&self, other: &Self) -> bool {
        self.surer_than(other.usual)
    }
}

fn evidence(score: f64) -> f64 {
    (score - LEAST_SCORE).max(0.0)
}
