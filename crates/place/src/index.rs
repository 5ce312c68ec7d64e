//! Finds the keyframes most similar to an image.

use crate::{
    PlaceVector,
    vector::{Tally, common_share},
};
use std::sync::Arc;

/// Keyframes compared feature by feature for each requested match: those with most words in common.
const SHORTLIST_FACTOR: usize = 4;
/// Minimum number of keyframes compared feature by feature.
const SHORTLIST: usize = 40;

/// Keyframes by appearance, under keys `K` of the caller.
///
/// Depends only on its keys and vectors, not on the order of insertions and removals, so an index rebuilt from a file
/// gives the same answers. A clone shares the list (O(1)); the first change afterwards copies the list, not the
/// vectors: microseconds at 1000 keyframes.
#[derive(Clone, Debug)]
pub struct PlaceIndex<K> {
    /// Ascending by key.
    entries: Arc<Vec<(K, Arc<PlaceVector>)>>,
}

/// A keyframe found by a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceMatch<K> {
    /// The keyframe.
    pub key: K,
    /// Similarity of the features, 0 to 1: [`PlaceVector::score`].
    pub score: f64,
    /// Similarity of the words, 0 to 1: [`PlaceVector::word_score`].
    pub word_score: f64,
}

impl<K> Default for PlaceIndex<K> {
    fn default() -> Self {
        Self {
            entries: Arc::new(Vec::new()),
        }
    }
}

impl<K: Copy + Ord> PlaceIndex<K> {
    /// Number of keyframes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// True when the index has no keyframes.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The keys, ascending.
    pub fn keys(&self) -> impl Iterator<Item = K> + '_ {
        self.entries.iter().map(|(key, _)| *key)
    }

    /// The vector of a keyframe.
    #[must_use]
    pub fn get(&self, key: K) -> Option<&Arc<PlaceVector>> {
        let at = self.find(key).ok()?;
        Some(&self.entries[at].1)
    }

    /// Adds a keyframe; returns the vector previously stored under `key`.
    pub fn insert(&mut self, key: K, vector: Arc<PlaceVector>) -> Option<Arc<PlaceVector>> {
        let at = self.find(key);
        let entries = Arc::make_mut(&mut self.entries);
        match at {
            Ok(at) => Some(std::mem::replace(&mut entries[at].1, vector)),
            Err(at) => {
                entries.insert(at, (key, vector));
                None
            }
        }
    }

    /// Removes a keyframe; `None` when the key is unknown.
    pub fn remove(&mut self, key: K) -> Option<Arc<PlaceVector>> {
        let at = self.find(key).ok()?;
        Some(Arc::make_mut(&mut self.entries).remove(at).1)
    }

    fn find(&self, key: K) -> Result<usize, usize> {
        self.entries.binary_search_by_key(&key, |(key, _)| *key)
    }

    /// The `limit` keyframes accepted by `admit` that are most similar to `vector`: by descending score, then word
    /// score, then key. Only keyframes with a word in common are found.
    #[must_use]
    pub fn query(
        &self,
        vector: &PlaceVector,
        admit: impl Fn(K) -> bool,
        limit: usize,
    ) -> Vec<PlaceMatch<K>> {
        let mut shortlist = self.by_words(vector, admit);
        shortlist.truncate(SHORTLIST.max(limit.saturating_mul(SHORTLIST_FACTOR)));
        let mut tally = Tally::default();
        let mut found: Vec<PlaceMatch<K>> = shortlist
            .into_iter()
            .map(|(word_score, at)| {
                let (key, other) = &self.entries[at];
                PlaceMatch {
                    key: *key,
                    score: vector.score_with(other, &mut tally),
                    word_score,
                }
            })
            .collect();
        // Stable: the shortlist is ordered by words, then keys.
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        found.truncate(limit);
        found
    }

    /// All keyframes with a word in common, as (word score, position in the list), best first, then by key.
    fn by_words(&self, vector: &PlaceVector, admit: impl Fn(K) -> bool) -> Vec<(f64, usize)> {
        // A table of 16 to 32 kB stays in L1 cache during the scan: no inverted file is needed.
        let last = vector.words().last().map_or(0, |(word, _)| word);
        let mut table = vec![0_u32; usize::from(last) + 1];
        for (word, weight) in vector.words() {
            table[usize::from(word)] = weight;
        }
        let mut scores: Vec<(f64, usize)> = Vec::with_capacity(self.len());
        for (at, (key, other)) in self.entries.iter().enumerate() {
            if !admit(*key) {
                continue;
            }
            let common = other
                .words()
                .map(|(word, weight)| {
                    weight.min(table.get(usize::from(word)).copied().unwrap_or(0))
                })
                .sum();
            if common > 0 {
                scores.push((common_share(common, vector.total(), other.total()), at));
            }
        }
        scores.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        scores
    }
}
