//! A growable sparse array with copy-on-write chunks, for ids that are never reused and mostly removed. An empty slot
//! takes an eighth of a byte.

use std::sync::Arc;

/// Slots per chunk: copying one on its first write after a clone costs microseconds; cloning the whole array costs one
/// reference count.
const CHUNK: usize = 64 * WORDS;
const WORDS: usize = 4;

/// A copy-on-write array in chunks of occupied values. `clone` is O(1); the first write to a chunk after a clone copies
/// that chunk.
#[derive(Debug)]
pub(crate) struct Sparse<T> {
    chunks: Arc<Vec<Arc<Chunk<T>>>>,
    len: usize,
}

#[derive(Clone, Debug)]
struct Chunk<T> {
    /// Bit per slot, set when occupied.
    taken: [u64; WORDS],
    /// Number of occupied slots before each word.
    before: [u8; WORDS],
    values: Vec<T>,
}

impl<T> Clone for Sparse<T> {
    fn clone(&self) -> Self {
        Self {
            chunks: Arc::clone(&self.chunks),
            len: self.len,
        }
    }
}

impl<T> Default for Sparse<T> {
    fn default() -> Self {
        Self {
            chunks: Arc::default(),
            len: 0,
        }
    }
}

impl<T: Clone> Sparse<T> {
    pub(crate) fn empty(len: usize) -> Self {
        let mut all = Self::default();
        all.grow(len);
        all
    }

    pub(crate) fn len(&self) -> usize {
        self.len
    }

    pub(crate) fn grow(&mut self, len: usize) {
        self.len = self.len.max(len);
        let chunks = self.len.div_ceil(CHUNK);
        if self.chunks.len() < chunks {
            // New chunks share one allocation until written.
            Arc::make_mut(&mut self.chunks).resize(chunks, Arc::default());
        }
    }

    /// The value of a slot.
    #[inline]
    pub(crate) fn get(&self, index: usize) -> Option<&T> {
        let chunk = self.chunks.get(index / CHUNK)?;
        chunk.values.get(chunk.find(index % CHUNK).ok()?)
    }

    /// The mutable value of a slot; copies its chunk when a clone shares it.
    pub(crate) fn get_mut(&mut self, index: usize) -> Option<&mut T> {
        let at = self.chunks.get(index / CHUNK)?.find(index % CHUNK).ok()?;
        self.chunk_mut(index)?.values.get_mut(at)
    }

    /// Sets the value of a slot; appends empty slots if needed.
    pub(crate) fn set(&mut self, index: usize, value: T) {
        self.grow(index.saturating_add(1));
        if let Some(chunk) = self.chunk_mut(index) {
            chunk.set(index % CHUNK, value);
        }
    }

    pub(crate) fn take(&mut self, index: usize) -> Option<T> {
        let at = self.chunks.get(index / CHUNK)?.find(index % CHUNK).ok()?;
        Some(self.chunk_mut(index)?.take(index % CHUNK, at))
    }

    /// All values with their indices, in order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (usize, &T)> {
        self.chunks.iter().enumerate().flat_map(|(c, chunk)| {
            let places = chunk.places().map(move |p| c * CHUNK + p);
            places.zip(&chunk.values)
        })
    }

    /// Bytes used, without heap memory of the values.
    pub(crate) fn bytes(&self) -> usize {
        let of = |c: &Arc<Chunk<T>>| size_of::<Chunk<T>>() + c.values.capacity() * size_of::<T>();
        let chunks = self.chunks.iter();
        chunks.map(|c| size_of_val(c) + of(c)).sum()
    }

    fn chunk_mut(&mut self, index: usize) -> Option<&mut Chunk<T>> {
        let chunk = Arc::make_mut(&mut self.chunks).get_mut(index / CHUNK)?;
        Some(Arc::make_mut(chunk))
    }
}

impl<T> Default for Chunk<T> {
    fn default() -> Self {
        Self {
            taken: [0; WORDS],
            before: [0; WORDS],
            values: Vec::new(),
        }
    }
}

impl<T> Chunk<T> {
    /// Index of a slot's value, or where to insert it.
    #[inline]
    fn find(&self, place: usize) -> Result<usize, usize> {
        let (word, bit) = (place / 64, 1_u64 << (place % 64));
        let lower = self.taken[word] & (bit - 1);
        let at = usize::from(self.before[word]) + lower.count_ones() as usize;
        if self.taken[word] & bit == 0 {
            Err(at)
        } else {
            Ok(at)
        }
    }

    fn set(&mut self, place: usize, value: T) {
        match self.find(place) {
            Ok(at) => self.values[at] = value,
            Err(at) => {
                self.values.insert(at, value);
                self.mark(place);
            }
        }
    }

    /// Removes the value at index `at`, that of `place`, and releases memory.
    fn take(&mut self, place: usize, at: usize) -> T {
        let value = self.values.remove(at);
        if 4 * self.values.len() <= self.values.capacity() {
            self.values.shrink_to(2 * self.values.len());
        }
        self.mark(place);
        value
    }

    /// Toggles whether a slot is occupied.
    fn mark(&mut self, place: usize) {
        self.taken[place / 64] ^= 1 << (place % 64);
        let mut sum = 0;
        for (before, word) in self.before.iter_mut().zip(&self.taken) {
            *before = sum;
            // At most 192 before the last word.
            sum = sum.wrapping_add(word.count_ones() as u8);
        }
    }

    fn places(&self) -> impl Iterator<Item = usize> {
        self.taken.iter().enumerate().flat_map(|(w, word)| {
            let mut left = *word;
            std::iter::from_fn(move || {
                let place = (left != 0).then(|| 64 * w + left.trailing_zeros() as usize);
                left &= left.wrapping_sub(1);
                place
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    #[derive(Clone, Copy, Debug)]
    enum Act {
        Set(usize, u32),
        Change(usize, u32),
        Take(usize),
        Grow(usize),
        /// Keeps a clone from here on.
        Copy,
    }

    fn act() -> impl Strategy<Value = Act> {
        // Few slots, so that they collide, at the borders of words and chunks.
        let place = || prop::sample::select(vec![0, 1, 63, 64, 127, 191, 192, 255, 256, 700]);
        prop_oneof![
            4 => (place(), any::<u32>()).prop_map(|(i, v)| Act::Set(i, v)),
            2 => (place(), any::<u32>()).prop_map(|(i, v)| Act::Change(i, v)),
            3 => place().prop_map(Act::Take),
            1 => (0_usize..900).prop_map(Act::Grow),
            1 => Just(Act::Copy),
        ]
    }

    proptest! {
        #[test]
        fn sparse_array_matches_a_btree_map_and_copies_are_fixed(acts in prop::collection::vec(act(), 1..200)) {
            let (mut sparse, mut tree, mut len) = (Sparse::default(), BTreeMap::new(), 0);
            let mut copies = Vec::new();
            for act in acts {
                match act {
                    Act::Set(i, value) => {
                        sparse.set(i, value);
                        tree.insert(i, value);
                        len = len.max(i + 1);
                    }
                    Act::Change(i, value) => {
                        let (a, b) = (sparse.get_mut(i), tree.get_mut(&i));
                        prop_assert_eq!(&a, &b);
                        a.into_iter().chain(b).for_each(|v| *v = value);
                    }
                    Act::Take(i) => prop_assert_eq!(sparse.take(i), tree.remove(&i)),
                    Act::Grow(to) => {
                        sparse.grow(to);
                        len = len.max(to);
                    }
                    Act::Copy => copies.push((sparse.clone(), tree.clone(), len)),
                }
            }
            copies.push((sparse, tree, len));
            for (sparse, tree, len) in copies {
                prop_assert_eq!(sparse.len(), len);
                prop_assert!(sparse.iter().map(|(i, v)| (i, *v)).eq(tree.iter().map(|(i, v)| (*i, *v))));
                prop_assert!((0..1000).all(|i| sparse.get(i) == tree.get(&i)));
            }
        }
    }

    #[test]
    fn removed_entries_free_their_memory() {
        let mut sparse = Sparse::default();
        let count = 100 * CHUNK;
        (0..count).for_each(|i| sparse.set(i, [i; 3]));
        let full = sparse.bytes();
        assert!(full >= count * size_of::<[usize; 3]>());
        let gone = (0..count).filter(|i| i % 100 != 0);
        assert_eq!(
            gone.filter_map(|i| sparse.take(i)).count(),
            99 * count / 100
        );
        let left = sparse.bytes() as f64 / count as f64;
        assert!(
            left < 2.0 && left > 0.24,
            "{left} bytes per place, of {full}"
        );
        assert!(Sparse::<[usize; 3]>::empty(count).iter().next().is_none());
    }
}
