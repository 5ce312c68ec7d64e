//! The compared place recognition methods.

use std::sync::Arc;
use stillpoint::features::{Descriptor, match_brute_force};
use stillpoint::place::{PlaceIndex, PlaceVector, Vocabulary};

/// A place recognition method. Keyframes are identified by numbers.
pub(crate) trait Method {
    fn name(&self) -> String;
    fn clear(&mut self);
    fn insert(&mut self, key: usize, descriptors: &[Descriptor]);
    /// The most similar admitted keyframes, best first, with their scores.
    fn query(
        &self,
        descriptors: &[Descriptor],
        admit: &dyn Fn(usize) -> bool,
        limit: usize,
    ) -> Vec<(usize, f64)>;
    /// Memory of the index, without the descriptors that keyframes hold anyway.
    fn bytes(&self) -> usize;
}

/// The library's method: words make the shortlist, and also decide if `features` is false.
pub(crate) struct Words {
    pub(crate) name: String,
    pub(crate) vocabulary: Vocabulary,
    pub(crate) features: bool,
    pub(crate) index: PlaceIndex<usize>,
}

impl Words {
    pub(crate) fn new(name: &str, vocabulary: Vocabulary, features: bool) -> Self {
        Self {
            name: name.to_owned(),
            vocabulary,
            features,
            index: PlaceIndex::default(),
        }
    }
}

impl Method for Words {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn clear(&mut self) {
        self.index = PlaceIndex::default();
    }

    fn insert(&mut self, key: usize, descriptors: &[Descriptor]) {
        self.index
            .insert(key, Arc::new(self.vocabulary.vector(descriptors)));
    }

    fn query(
        &self,
        descriptors: &[Descriptor],
        admit: &dyn Fn(usize) -> bool,
        limit: usize,
    ) -> Vec<(usize, f64)> {
        let vector = self.vocabulary.vector(descriptors);
        if self.features {
            let found = self.index.query(&vector, admit, limit);
            return found.iter().map(|m| (m.key, m.score)).collect();
        }
        let word_score = |key: usize| Some((key, self.index.get(key)?.word_score(&vector)));
        let keys = self.index.keys().filter(|key| admit(*key));
        best(keys.filter_map(word_score).collect(), limit)
    }

    fn bytes(&self) -> usize {
        let vectors = self.index.keys().filter_map(|key| self.index.get(key));
        vectors.map(|v: &Arc<PlaceVector>| v.bytes()).sum()
    }
}

/// Sorts by descending score, then by key.
pub(crate) fn best(mut scores: Vec<(usize, f64)>, limit: usize) -> Vec<(usize, f64)> {
    scores.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    scores.retain(|s| s.1 > 0.0);
    scores.truncate(limit);
    scores
}

/// All pairs of descriptors: an upper bound, too slow for any system.
#[derive(Default)]
pub(crate) struct BruteForce {
    images: Vec<(usize, Vec<Descriptor>)>,
}

impl Method for BruteForce {
    fn name(&self) -> String {
        "all pairs of descriptors".to_owned()
    }

    fn clear(&mut self) {
        self.images.clear();
    }

    fn insert(&mut self, key: usize, descriptors: &[Descriptor]) {
        self.images.push((key, descriptors.to_vec()));
    }

    fn query(
        &self,
        descriptors: &[Descriptor],
        admit: &dyn Fn(usize) -> bool,
        limit: usize,
    ) -> Vec<(usize, f64)> {
        let score = |image: &[Descriptor]| {
            let matches = match_brute_force(descriptors, image, 50, 0.9);
            let pairs = matches.iter().flatten().count() as f64;
            2.0 * pairs / (descriptors.len() + image.len()).max(1) as f64
        };
        let images = self.images.iter().filter(|(key, _)| admit(*key));
        best(images.map(|(key, d)| (*key, score(d))).collect(), limit)
    }

    fn bytes(&self) -> usize {
        0
    }
}
