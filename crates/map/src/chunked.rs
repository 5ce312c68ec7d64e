//! A growable array whose copies share their unchanged parts.

use std::sync::Arc;

/// Elements per chunk: copying one when it is first written after a copy costs microseconds, and a copy of the whole
/// array is one reference count.
const CHUNK: usize = 256;

/// A copy-on-write array in chunks. `clone` is O(1); the first write to a chunk after a clone copies that chunk.
#[derive(Debug)]
pub struct Chunked<T> {
    chunks: Arc<Vec<Arc<Vec<T>>>>,
    len: usize,
}

impl<T> Clone for Chunked<T> {
    fn clone(&self) -> Self {
        Self {
            chunks: Arc::clone(&self.chunks),
            len: self.len,
        }
    }
}

impl<T> Default for Chunked<T> {
    fn default() -> Self {
        Self {
            chunks: Arc::new(Vec::new()),
            len: 0,
        }
    }
}

impl<T: Clone> Chunked<T> {
    /// `len` times the same, whose full chunks are one as long as nothing is written to them.
    pub(crate) fn filled(value: T, len: usize) -> Self {
        let full = Arc::new(vec![value.clone(); CHUNK]);
        let mut chunks: Vec<_> = std::iter::repeat_n(full, len / CHUNK).collect();
        if !len.is_multiple_of(CHUNK) {
            chunks.push(Arc::new(vec![value; len % CHUNK]));
        }
        Self {
            chunks: Arc::new(chunks),
            len,
        }
    }

    /// Number of elements.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// True when there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The element at `index`.
    #[must_use]
    pub fn get(&self, index: usize) -> Option<&T> {
        self.chunks.get(index / CHUNK)?.get(index % CHUNK)
    }

    /// The element at `index`, to be changed; copies its chunk when a clone still uses it.
    pub fn get_mut(&mut self, index: usize) -> Option<&mut T> {
        if index >= self.len {
            return None;
        }
        let chunk = Arc::make_mut(&mut self.chunks).get_mut(index / CHUNK)?;
        Arc::make_mut(chunk).get_mut(index % CHUNK)
    }

    /// Appends an element.
    pub fn push(&mut self, value: T) {
        let chunks = Arc::make_mut(&mut self.chunks);
        match chunks.last_mut() {
            Some(chunk) if chunk.len() < CHUNK => Arc::make_mut(chunk).push(value),
            _ => {
                let mut chunk = Vec::with_capacity(CHUNK);
                chunk.push(value);
                chunks.push(Arc::new(chunk));
            }
        }
        self.len += 1;
    }

    /// All elements in order.
    pub fn iter(&self) -> impl Iterator<Item = &T> {
        self.chunks.iter().flat_map(|c| c.iter())
    }
}
