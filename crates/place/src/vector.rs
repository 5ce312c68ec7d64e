//! What one image looks like.
//!
//! Answers: how alike two images are, by words and by features, and which of their features may be the same point.

use crate::{Vocabulary, popcnt};
use stillpoint_features::Descriptor;

/// Words of 64 bits of a descriptor by which features are distinguished: the first half. ORB's tests were chosen one by one, each to vary much and to correlate
/// little with those before (Rublee et al., ICCV 2011), so the first ones say most; on the data of the decision the other half added nothing.
pub(crate) const SIGNATURE: usize = 2;
/// Features whose signatures differ in at most this many bits may be the same point.
const MAX_DISTANCE: u32 = 24;
/// The sum of the weights of an image, about: they are rounded down.
const UNIT: u64 = 1 << 20;

/// A feature as others are compared with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Entry {
    signature: [u64; SIGNATURE],
    word: u16,
    feature: u16,
}

impl Entry {
    #[inline(always)]
    fn distance(&self, other: &Self) -> u32 {
        let mut distance = 0;
        for i in 0..SIGNATURE {
            distance += (self.signature[i] ^ other.signature[i]).count_ones();
        }
        distance
    }
}

/// What an image looks like: its words with their weights, and its features in the order of their words.
///
/// Immutable, so that keyframes, index and readers share it behind an `Arc`. It follows from the descriptors and the vocabulary alone, and takes about 30 kB
/// for 1000 features. Vectors of different vocabularies have nothing to say about each other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlaceVector {
    /// Distinct words, ascending, with their weights and where their entries end.
    words: Box<[u16]>,
    weights: Box<[u32]>,
    ends: Box<[u32]>,
    total: u32,
    /// In the order of (word, feature).
    entries: Box<[Entry]>,
    words_per_group: u16,
}

/// Two features that may be the same point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct FeaturePair {
    /// Feature of the first image.
    pub a: u16,
    /// Feature of the second image.
    pub b: u16,
}

impl PlaceVector {
    pub(crate) fn new(
        vocabulary: &Vocabulary,
        descriptors: &[Descriptor],
        admit: impl Fn(usize) -> bool,
    ) -> Self {
        let count = descriptors.len().min(1 << 16);
        let features: Vec<usize> = (0..count).filter(|i| admit(*i)).collect();
        let chosen: Vec<Descriptor> = features.iter().map(|i| descriptors[*i]).collect();
        let mut entries: Vec<Entry> = vocabulary
            .words(&chosen)
            .into_iter()
            .zip(features.iter().zip(&chosen))
            .map(|(word, (feature, descriptor))| Entry {
                signature: std::array::from_fn(|i| descriptor.0[i]),
                word,
                feature: *feature as u16,
            })
            .collect();
        entries.sort_unstable_by_key(|e| (e.word, e.feature));
        let (mut words, mut raw, mut ends) = (Vec::new(), Vec::new(), Vec::new());
        for run in entries.chunk_by(|a, b| a.word == b.word) {
            words.push(run[0].word);
            ends.push(ends.last().copied().unwrap_or(0) + run.len() as u32);
            raw.push(run.len() as u64 * u64::from(vocabulary.idf(run[0].word)));
        }
        let sum = raw.iter().sum::<u64>().max(1);
        // Integers, so that sums are exact and do not depend on their order.
        let weights: Box<[u32]> = raw.iter().map(|w| (w * UNIT / sum) as u32).collect();
        Self {
            words: words.into(),
            total: weights.iter().sum(),
            weights,
            ends: ends.into(),
            entries: entries.into(),
            words_per_group: vocabulary.words_per_group(),
        }
    }

    /// Number of features.
    #[must_use]
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Bytes that it takes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of::<Self>()
            + size_of_val(&*self.words)
            + size_of_val(&*self.weights)
            + size_of_val(&*self.ends)
            + size_of_val(&*self.entries)
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The features' words, ascending, and their weights in 2^-20.
    pub(crate) fn words(&self) -> impl Iterator<Item = (u16, u32)> + '_ {
        self.words.iter().copied().zip(self.weights.iter().copied())
    }

    pub(crate) fn total(&self) -> u32 {
        self.total
    }

    /// How much the words of two images have in common, 0 to 1: `1 - |a - b|_1 / 2` of their weights.
    #[must_use]
    pub fn word_score(&self, other: &Self) -> f64 {
        let (mut i, mut j, mut common) = (0, 0, 0_u32);
        while i < self.words.len() && j < other.words.len() {
            let (a, b) = (self.words[i], other.words[j]);
            if a == b {
                common += self.weights[i].min(other.weights[j]);
            }
            // Sums, not branches: which side comes next is a coin toss that no processor foresees.
            i += usize::from(a <= b);
            j += usize::from(b <= a);
        }
        common_share(common, self.total, other.total)
    }

    /// The share of features that have a partner of the same word in the other image, 0 to 1; the same both ways round, 1 for an image and itself (if no two
    /// of its features are equal).
    #[must_use]
    pub fn score(&self, other: &Self) -> f64 {
        let mut tally = Tally::default();
        self.score_with(other, &mut tally)
    }

    /// [`PlaceVector::score`] in the buffers of an earlier one.
    pub(crate) fn score_with(&self, other: &Self, tally: &mut Tally) -> f64 {
        // Within a word, not a group: what is missed is missed in right and wrong candidates, and chance has less to choose from.
        popcnt::tally(self, other, 1, tally);
        let features = self.len() + other.len();
        if features == 0 {
            return 0.0;
        }
        2.0 * tally.pairs.len() as f64 / features as f64
    }

    /// Features of both images that may be the same point, in the order of this image's words; each feature is in one pair at most. Their signatures are
    /// mutually nearest among the features of their group of words, which is wider than a word: more pairs than [`PlaceVector::score`] counts, and more wrong
    /// ones. What the caller has left to do is to compare whole descriptors.
    #[must_use]
    pub fn candidate_pairs(&self, other: &Self) -> Vec<FeaturePair> {
        let mut tally = Tally::default();
        popcnt::tally(self, other, self.words_per_group, &mut tally);
        tally.pairs
    }

    /// Pairs features within groups of so many words, for the instruction set of the caller, into which it is inlined.
    #[inline(always)]
    pub(crate) fn tally_portable(&self, other: &Self, words_per_group: u16, out: &mut Tally) {
        out.pairs.clear();
        if words_per_group <= 1 {
            return self.tally_words(other, out);
        }
        let group = u32::from(words_per_group);
        let last_of_group = |e: &Entry| (u32::from(e.word) / group + 1) * group - 1;
        let (mut a, mut b) = (&*self.entries, &*other.entries);
        while let (Some(first), Some(second)) = (a.first(), b.first()) {
            let (last_a, last_b) = (last_of_group(first), last_of_group(second));
            let until = |entries: &[Entry], last: u32| {
                let inside = |e: &&Entry| u32::from(e.word) <= last;
                entries.iter().take_while(inside).count()
            };
            let (in_a, in_b) = (until(a, last_a), until(b, last_b));
            if last_a == last_b {
                out.add_group(&a[..in_a], &b[..in_b]);
            }
            a = if last_a <= last_b { &a[in_a..] } else { a };
            b = if last_b <= last_a { &b[in_b..] } else { b };
        }
    }

    /// Pairs features within words.
    #[inline(always)]
    fn tally_words(&self, other: &Self, out: &mut Tally) {
        let (mut i, mut j) = (0, 0);
        while i < self.words.len() && j < other.words.len() {
            let (a, b) = (self.words[i], other.words[j]);
            if a == b {
                out.add_group(self.entries_of(i), other.entries_of(j));
            }
            // As in `word_score`.
            i += usize::from(a <= b);
            j += usize::from(b <= a);
        }
    }

    /// The entries of the `i`-th distinct word.
    #[inline(always)]
    fn entries_of(&self, i: usize) -> &[Entry] {
        let start = if i == 0 { 0 } else { self.ends[i - 1] };
        &self.entries[start as usize..self.ends[i] as usize]
    }
}

/// The share of weights that two images have in common.
pub(crate) fn common_share(common: u32, a: u32, b: u32) -> f64 {
    let both = u64::from(a) + u64::from(b);
    if both == 0 {
        return 0.0;
    }
    2.0 * f64::from(common) / both as f64
}

/// Buffers of one comparison.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tally {
    pairs: Vec<FeaturePair>,
    /// For each feature of the second image's group: the least distance, and the number of the feature that has it.
    back: Vec<(u32, usize)>,
    forward: Vec<(u32, usize)>,
}

impl Tally {
    #[cfg(test)]
    pub(crate) fn pairs(&self) -> &[FeaturePair] {
        &self.pairs
    }

    /// Adds the mutually nearest pairs of two groups; the first feature wins a tie.
    #[inline(always)]
    fn add_group(&mut self, a: &[Entry], b: &[Entry]) {
        if let ([x], [y]) = (a, b) {
            // Most words are there once, and need no search.
            if x.distance(y) <= MAX_DISTANCE {
                self.push(x, y);
            }
            return;
        }
        self.back.clear();
        self.back.resize(b.len(), (u32::MAX, 0));
        self.forward.clear();
        for (i, x) in a.iter().enumerate() {
            let mut best = (u32::MAX, 0);
            for (j, y) in b.iter().enumerate() {
                let distance = x.distance(y);
                if distance < best.0 {
                    best = (distance, j);
                }
                if distance < self.back[j].0 {
                    self.back[j] = (distance, i);
                }
            }
            self.forward.push(best);
        }
        for (i, x) in a.iter().enumerate() {
            let (distance, j) = self.forward[i];
            if distance <= MAX_DISTANCE && self.back[j].1 == i {
                self.push(x, &b[j]);
            }
        }
    }

    fn push(&mut self, a: &Entry, b: &Entry) {
        self.pairs.push(FeaturePair {
            a: a.feature,
            b: b.feature,
        });
    }
}
