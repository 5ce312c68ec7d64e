//! Combined evidence of an object's detections: existence, class and usual score.

use crate::{ClassId, Detection};
use std::collections::BTreeMap;

/// Sum of score excesses over [`EVEN_SCORE`] from which an object is reported: two sure detections (0.8), or several of
/// low scores. Measured on fr1_xyz_walkers and fr1_rpy_walkers with YOLOX-nano: a walker is reported 0.1 s after
/// entering; with PicoDet 0.6 s at worst.
const REPORTED_EVIDENCE: f64 = 0.9;
/// Score that is as likely for furniture taken as a person as for a person: lower ones are counter-evidence. Measured
/// on fr1_xyz_walkers and fr1_rpy_walkers: with 0.3 there are 5 % more ghosts.
const EVEN_SCORE: f64 = 0.35;
/// Minimum score of an object's detection, as a share of its usual score. Measured: 0.5 lets false alarms in, IDF1 of
/// simulated people is 0.02 less.
const AS_SURE: f64 = 0.6;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Votes {
    /// Sum of the scores by class.
    classes: BTreeMap<ClassId, f64>,
    /// Sum of the evidence of the scores for an object.
    evidence: f64,
    /// Sum of the scores minus [`EVEN_SCORE`], clamped to 0 and twice [`REPORTED_EVIDENCE`]: a long certain track must
    /// not last longer than a short one.
    odds: f64,
    /// Whether `odds` has reached [`REPORTED_EVIDENCE`] and not returned to 0 since.
    sure: bool,
    /// Mean score of its detections.
    usual: f64,
}

impl Votes {
    pub(super) fn new(first: &Detection) -> Self {
        let score = f64::from(first.score);
        let mut votes = Self {
            classes: BTreeMap::from([(first.class, score)]),
            evidence: evidence(score),
            odds: 0.0,
            sure: false,
            usual: score,
        };
        votes.weigh(score - EVEN_SCORE);
        votes
    }

    pub(super) fn add(&mut self, d: &Detection, hits: u32) {
        let score = f64::from(d.score);
        self.evidence += evidence(score);
        self.weigh(score - EVEN_SCORE);
        let share = 1.0 / f64::from(hits.max(1));
        self.usual += share * (score - self.usual);
        *self.classes.entry(d.class).or_default() += score;
    }

    pub(super) fn merge(&mut self, other: &Self) {
        self.evidence += other.evidence;
        self.weigh(other.odds);
        for (class, score) in &other.classes {
            *self.classes.entry(*class).or_default() += score;
        }
    }

    /// The class with the most votes; `own` on ties.
    pub(super) fn class(&self, own: ClassId) -> ClassId {
        let least = self.classes.get(&own).copied().unwrap_or(0.0);
        let best = self.classes.iter().max_by(|a, b| a.1.total_cmp(b.1));
        best.filter(|b| *b.1 > least).map_or(own, |b| *b.0)
    }

    /// Whether the evidence suffices to report the object.
    pub(super) fn suffice(&self) -> bool {
        self.evidence >= REPORTED_EVIDENCE
    }

    /// Makes the evidence sufficient after re-identification, and sure if the old object was.
    pub(super) fn are_enough(&mut self, sure: bool) {
        self.evidence = self.evidence.max(REPORTED_EVIDENCE);
        if sure {
            self.odds = self.odds.max(REPORTED_EVIDENCE);
            self.sure = true;
        }
    }

    /// A sequential test (Wald, "Sequential tests of statistical hypotheses", 1945): sure from the upper threshold
    /// until the odds return to 0.
    fn weigh(&mut self, odds: f64) {
        self.odds = (self.odds + odds).clamp(0.0, 2.0 * REPORTED_EVIDENCE);
        self.sure = self.odds >= REPORTED_EVIDENCE || (self.sure && self.odds > 0.0);
    }

    /// Whether the sequential test accepts the object.
    pub(super) fn sure(&self) -> bool {
        self.sure
    }

    /// Whether the usual score is far above this one, which then is rather a false alarm beside the object.
    pub(super) fn surer_than(&self, score: f64) -> bool {
        score < AS_SURE * self.usual
    }

    pub(super) fn surer_than_those_of(&self, other: &Self) -> bool {
        self.surer_than(other.usual)
    }
}

fn evidence(score: f64) -> f64 {
    (score - EVEN_SCORE).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BoundingBox;

    fn scored(score: f32) -> Detection {
        Detection {
            class: ClassId::PERSON,
            score,
            bounds: BoundingBox::default(),
        }
    }

    fn after(scores: impl IntoIterator<Item = f32>) -> Votes {
        let mut votes = Votes::new(&scored(0.3));
        for (n, score) in scores.into_iter().enumerate() {
            votes.add(&scored(score), n as u32 + 2);
        }
        votes
    }

    /// Furniture detected as a person with low scores never becomes sure, regardless of number; a sure person ends when
    /// only low scores follow.
    #[test]
    fn low_scores_never_make_an_object_sure_and_end_it() {
        let furniture = after(
            [0.31, 0.28, 0.36, 0.25, 0.33, 0.4]
                .into_iter()
                .cycle()
                .take(300),
        );
        assert!(furniture.suffice() && !furniture.sure());
        let mut person = after([0.8; 6]);
        assert!(person.sure());
        for n in 0..30 {
            person.add(&scored(0.25), n + 40);
        }
        assert!(!person.sure());
    }
}
