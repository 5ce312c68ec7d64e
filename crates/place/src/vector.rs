//! Appearance vector of an image: similarity by words and by features, and pairs of features that may show the same
//! point.

use crate::{Vocabulary, popcnt};
use std::sync::Arc;
use stillpoint_features::Descriptor;

/// Words of 64 bits of a descriptor compared for matching: the first half. ORB's tests were chosen greedily, each with
/// high variance and low correlation with those before (Rublee et al., ICCV 2011), so the first ones are the most
/// informative; on the data of the decision the other half added nothing.
pub(crate) const SIGNATURE: usize = 2;
/// Maximum Hamming distance of signatures of one point.
const MAX_DISTANCE: u32 = 24;
/// Approximate sum of an image's weights, which are rounded down.
const UNIT: u64 = 1 << 20;

#[inline(always)]
fn distance(a: &Descriptor, b: &Descriptor) -> u32 {
    let mut distance = 0;
    for i in 0..SIGNATURE {
        distance += (a.0[i] ^ b.0[i]).count_ones();
    }
    distance
}

/// Appearance of an image: its words with weights, and its features ordered by word.
///
/// Immutable, so that keyframes, index and readers share it behind an `Arc`. Depends on descriptors and vocabulary
/// alone, shares the descriptors with its keyframe, and takes some 8 kB besides them for 1000 features. Vectors of
/// different vocabularies must not be compared.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlaceVector {
    /// Distinct words, ascending, with their weights and the positions of their last features.
    words: Box<[u16]>,
    weights: Box<[u32]>,
    lasts: Box<[u16]>,
    total: u32,
    /// Ordered by (word, feature).
    features: Box<[u16]>,
    /// Of all features of the image, admitted or not.
    descriptors: Arc<Vec<Descriptor>>,
    words_per_group: u16,
}

/// Two features that may show the same point.
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
        descriptors: &Arc<Vec<Descriptor>>,
        admit: impl Fn(usize) -> bool,
    ) -> Self {
        let count = descriptors.len().min(1 << 16);
        let features: Vec<usize> = (0..count).filter(|i| admit(*i)).collect();
        let chosen: Vec<Descriptor> = features.iter().map(|i| descriptors[*i]).collect();
        let words = vocabulary.words(&chosen).into_iter();
        let mut entries: Vec<(u16, u16)> = words.zip(features.iter().map(|f| *f as u16)).collect();
        entries.sort_unstable();
        let (mut words, mut raw, mut lasts) = (Vec::new(), Vec::new(), Vec::new());
        let mut end = 0;
        for run in entries.chunk_by(|a, b| a.0 == b.0) {
            words.push(run[0].0);
            end += run.len();
            lasts.push((end - 1) as u16);
            raw.push(run.len() as u64 * u64::from(vocabulary.idf(run[0].0)));
        }
        let sum = raw.iter().sum::<u64>().max(1);
        // Integers make sums exact and independent of their order.
        let weights: Box<[u32]> = raw.iter().map(|w| (w * UNIT / sum) as u32).collect();
        Self {
            words: words.into(),
            total: weights.iter().sum(),
            weights,
            lasts: lasts.into(),
            features: entries.iter().map(|e| e.1).collect(),
            descriptors: Arc::clone(descriptors),
            words_per_group: vocabulary.words_per_group(),
        }
    }

    /// Number of features.
    #[must_use]
    pub fn len(&self) -> usize {
        self.features.len()
    }

    /// Memory in bytes, without the descriptors.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of::<Self>()
            + size_of_val(&*self.words)
            + size_of_val(&*self.weights)
            + size_of_val(&*self.lasts)
            + size_of_val(&*self.features)
    }

    /// True when there are no features.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.features.is_empty()
    }

    /// Words, ascending, with weights in 2^-20.
    pub(crate) fn words(&self) -> impl Iterator<Item = (u16, u32)> + '_ {
        self.words.iter().copied().zip(self.weights.iter().copied())
    }

    pub(crate) fn total(&self) -> u32 {
        self.total
    }

    /// Similarity of the words of two images, 0 to 1: `1 - |a - b|_1 / 2` of their weights.
    #[must_use]
    pub fn word_score(&self, other: &Self) -> f64 {
        let (mut i, mut j, mut common) = (0, 0, 0_u32);
        while i < self.words.len() && j < other.words.len() {
            let (a, b) = (self.words[i], other.words[j]);
            if a == b {
                common += self.weights[i].min(other.weights[j]);
            }
            // Branch-free: the comparison is unpredictable.
            i += usize::from(a <= b);
            j += usize::from(b <= a);
        }
        common_share(common, self.total, other.total)
    }

    /// Share of features with a partner of the same word in the other image, 0 to 1; symmetric, 1 for an image and
    /// itself (if no two of its features are equal).
    #[must_use]
    pub fn score(&self, other: &Self) -> f64 {
        let mut tally = Tally::default();
        self.score_with(other, &mut tally)
    }

    /// [`PlaceVector::score`] with reused buffers.
    pub(crate) fn score_with(&self, other: &Self, tally: &mut Tally) -> f64 {
        // Within words, not groups: missed pairs affect right and wrong candidates alike, and there are fewer chance
        // pairs.
        popcnt::tally(self, other, 1, tally);
        let features = self.len() + other.len();
        if features == 0 {
            return 0.0;
        }
        2.0 * tally.pairs.len() as f64 / features as f64
    }

    /// Pairs of features of both images that may show the same point, ordered by this image's words; each feature is in
    /// at most one pair. Their signatures are mutually nearest within a group of words, which is wider than a word:
    /// more pairs than [`PlaceVector::score`] counts, and more wrong ones. The caller still has to compare whole
    /// descriptors.
    #[must_use]
    pub fn candidate_pairs(&self, other: &Self) -> Vec<FeaturePair> {
        let mut tally = Tally::default();
        popcnt::tally(self, other, self.words_per_group, &mut tally);
        tally.pairs
    }

    /// Pairs features within groups of `words_per_group` words. Inlined, to be compiled for the caller's instruction
    /// set.
    #[inline(always)]
    pub(crate) fn tally_portable(&self, other: &Self, words_per_group: u16, out: &mut Tally) {
        out.pairs.clear();
        if words_per_group <= 1 {
            return self.tally_words(other, out);
        }
        let (mut i, mut j) = (0, 0);
        while i < self.words.len() && j < other.words.len() {
            let (of_a, of_b) = (self.words[i], other.words[j]);
            let (group_a, group_b) = (of_a / words_per_group, of_b / words_per_group);
            let (next_a, next_b) = (
                self.end_of_group(i, words_per_group),
                other.end_of_group(j, words_per_group),
            );
            if group_a == group_b {
                let (a, b) = (self.of_words(i, next_a), other.of_words(j, next_b));
                out.add_group(a, b);
            }
            i = if group_a <= group_b { next_a } else { i };
            j = if group_b <= group_a { next_b } else { j };
        }
    }

    /// Index of the first distinct word after the group of the `i`-th one.
    #[inline(always)]
    fn end_of_group(&self, i: usize, words_per_group: u16) -> usize {
        let group = self.words[i] / words_per_group;
        let inside = |word: &&u16| **word / words_per_group == group;
        i + self.words[i..].iter().take_while(inside).count()
    }

    #[inline(always)]
    fn tally_words(&self, other: &Self, out: &mut Tally) {
        let (mut i, mut j) = (0, 0);
        while i < self.words.len() && j < other.words.len() {
            let (a, b) = (self.words[i], other.words[j]);
            if a == b {
                out.add_group(self.of_words(i, i + 1), other.of_words(j, j + 1));
            }
            i += usize::from(a <= b);
            j += usize::from(b <= a);
        }
    }

    /// Features of the distinct words `i` to `end`, exclusive.
    #[inline(always)]
    fn of_words(&self, i: usize, end: usize) -> Group<'_> {
        let end_of = |word: usize| usize::from(self.lasts[word]) + 1;
        let start = if i == 0 { 0 } else { end_of(i - 1) };
        Group {
            features: &self.features[start..end_of(end - 1)],
            descriptors: &self.descriptors,
        }
    }
}

/// Share of weights common to two images.
pub(crate) fn common_share(common: u32, a: u32, b: u32) -> f64 {
    let both = u64::from(a) + u64::from(b);
    if both == 0 {
        return 0.0;
    }
    2.0 * f64::from(common) / both as f64
}

#[derive(Clone, Copy)]
struct Group<'a> {
    features: &'a [u16],
    /// Of all features of the image.
    descriptors: &'a [Descriptor],
}

impl Group<'_> {
    #[inline(always)]
    fn descriptor(&self, feature: u16) -> &Descriptor {
        &self.descriptors[usize::from(feature)]
    }
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Tally {
    pairs: Vec<FeaturePair>,
    /// Per feature of the second image's group: the minimum distance and the index of the feature that has it.
    back: Vec<(u32, usize)>,
    forward: Vec<(u32, usize)>,
}

impl Tally {
    #[cfg(test)]
    pub(crate) fn pairs(&self) -> &[FeaturePair] {
        &self.pairs
    }

    /// Adds the mutually nearest pairs of two groups; the first feature wins ties.
    #[inline(always)]
    fn add_group(&mut self, a: Group<'_>, b: Group<'_>) {
        if let ([x], [y]) = (a.features, b.features) {
            // Most words occur once and need no search.
            if distance(a.descriptor(*x), b.descriptor(*y)) <= MAX_DISTANCE {
                self.push(*x, *y);
            }
            return;
        }
        self.back.clear();
        self.back.resize(b.features.len(), (u32::MAX, 0));
        self.forward.clear();
        for (i, x) in a.features.iter().enumerate() {
            let mut best = (u32::MAX, 0);
            let x = a.descriptor(*x);
            for (j, y) in b.features.iter().enumerate() {
                let distance = distance(x, b.descriptor(*y));
                if distance < best.0 {
                    best = (distance, j);
                }
                if distance < self.back[j].0 {
                    self.back[j] = (distance, i);
                }
            }
            self.forward.push(best);
        }
        for (i, x) in a.features.iter().enumerate() {
            let (distance, j) = self.forward[i];
            if distance <= MAX_DISTANCE && self.back[j].1 == i {
                self.push(*x, b.features[j]);
            }
        }
    }

    fn push(&mut self, a: u16, b: u16) {
        self.pairs.push(FeaturePair { a, b });
    }
}
