//! Scores of place recognition with known overlap.

use super::keyframes::Keyframe;
use super::method::Method;

/// Minimum overlap of views of the same place.
const SAME: f64 = 0.3;
/// Views with less overlap are different places. Those in between are neither right nor wrong.
const OTHER: f64 = 0.05;
/// Keyframes closer in time are excluded from queries, s.
const RECENT: f64 = 5.0;

/// Keyframes in temporal order, and distractors: similar keyframes of another place.
pub(crate) struct Trial {
    pub(crate) keyframes: Vec<Keyframe>,
    pub(crate) elsewhere: Vec<Keyframe>,
    /// Overlap of keyframe i with the earlier keyframe j.
    overlaps: Vec<Vec<f32>>,
}

impl Trial {
    pub(crate) fn new(keyframes: Vec<Keyframe>, elsewhere: Vec<Keyframe>) -> Self {
        let row = |i: usize| {
            let earlier = keyframes[..i].iter();
            earlier.map(|k| keyframes[i].overlap(k) as f32).collect()
        };
        Self {
            overlaps: (0..keyframes.len()).map(row).collect(),
            keyframes,
            elsewhere,
        }
    }

    fn is_recent(&self, i: usize, j: usize) -> bool {
        self.keyframes[i].stamp - self.keyframes[j].stamp < RECENT
    }

    pub(crate) fn revisits(&self) -> usize {
        (0..self.keyframes.len())
            .filter(|i| self.is_revisit(*i))
            .count()
    }

    fn is_revisit(&self, i: usize) -> bool {
        (0..i).any(|j| !self.is_recent(i, j) && f64::from(self.overlaps[i][j]) >= SAME)
    }
}

#[derive(Clone, Copy)]
struct Found {
    revisit: bool,
    /// Score of the best match: raw, and relative to the previous keyframe's.
    score: [f64; 2],
    right: bool,
    wrong: bool,
    /// Rank of the first correct match.
    rank: Option<usize>,
}

#[derive(Default)]
pub(crate) struct Figures {
    found: Vec<Found>,
}

/// Results of a method, as shares of the revisits.
pub(crate) struct Row {
    /// The best match is correct and scores higher than any wrong one: raw, relative.
    pub(crate) safe: [f64; 2],
    /// The best match is correct.
    pub(crate) first: f64,
    /// One of the ten best matches is correct.
    pub(crate) ten: f64,
}

impl Figures {
    pub(crate) fn add(&mut self, method: &mut dyn Method, trial: &Trial) {
        method.clear();
        let count = trial.keyframes.len();
        for (k, keyframe) in trial.elsewhere.iter().enumerate() {
            method.insert(count + k, &keyframe.descriptors);
        }
        for (i, keyframe) in trial.keyframes.iter().enumerate() {
            let descriptors = &keyframe.descriptors;
            let admit = |key: usize| key >= count || !trial.is_recent(i, key);
            let ranked = method.query(descriptors, &admit, 10);
            let neighbour = method.query(descriptors, &|key| key + 1 == i, 1);
            let overlap = |key: usize| trial.overlaps[i].get(key).map_or(0.0, |o| f64::from(*o));
            if let Some((first, score)) = ranked.first() {
                let beside = neighbour.first().map_or(1.0, |n| n.1.max(0.01));
                self.found.push(Found {
                    revisit: trial.is_revisit(i),
                    score: [*score, score / beside],
                    right: overlap(*first) >= SAME,
                    wrong: overlap(*first) < OTHER,
                    rank: ranked.iter().position(|(key, _)| overlap(*key) >= SAME),
                });
            } else if trial.is_revisit(i) {
                self.found.push(Found {
                    revisit: true,
                    score: [0.0; 2],
                    right: false,
                    wrong: false,
                    rank: None,
                });
            }
            method.insert(i, descriptors);
        }
    }

    pub(crate) fn row(&self) -> Row {
        let revisits = self.found.iter().filter(|f| f.revisit).count().max(1) as f64;
        let share = |test: &dyn Fn(&Found) -> bool| {
            self.found.iter().filter(|f| f.revisit && test(f)).count() as f64 / revisits
        };
        let safe = [0, 1].map(|kind| {
            let wrong = self.found.iter().filter(|f| f.wrong);
            let highest = wrong.map(|f| f.score[kind]).fold(0.0, f64::max);
            share(&|f| f.right && f.score[kind] > highest)
        });
        Row {
            safe,
            first: share(&|f| f.right),
            ten: share(&|f| f.rank.is_some()),
        }
    }
}
