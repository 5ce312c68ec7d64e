//! Blocks of 8x8x8 voxels and their storage: a hash table of keys, and iteration in key order. The table is never iterated, so that no
//! result depends on hash order.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

pub(crate) const SIDE: usize = 8;
pub(crate) const VOXELS: usize = SIDE * SIDE * SIDE;
/// Stored value of a distance of one truncation.
pub(crate) const FULL: f32 = 32767.0;

/// Position of a block: its first voxel is at `8 * key * voxel` m. Ordered by z, y, x.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct Key(pub(crate) [i32; 3]);

impl Key {
    pub(crate) fn new(x: i32, y: i32, z: i32) -> Self {
        Self([z, y, x])
    }

    pub(crate) fn xyz(self) -> [i32; 3] {
        let [z, y, x] = self.0;
        [x, y, z]
    }

    pub(crate) fn moved(self, dx: i32, dy: i32, dz: i32) -> Self {
        let [x, y, z] = self.xyz();
        Self::new(
            x.saturating_add(dx),
            y.saturating_add(dy),
            z.saturating_add(dz),
        )
    }
}

/// 8x8x8 voxels; voxel (x, y, z) is entry `(8 z + y) 8 + x`, so that a row along x is contiguous.
#[repr(C, align(64))]
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct Block {
    /// Signed distance to the surface, positive on the camera's side, as a share of the truncation: `FULL` is one.
    pub(crate) distance: [i16; VOXELS],
    /// Integration weight; 0: unobserved, or free space only where the distance is `FULL`.
    pub(crate) weight: [u16; VOXELS],
    /// Red, green and blue from the lowest byte up, then the number of frames that saw a surface here, minus those that saw through it.
    pub(crate) colour: [u32; VOXELS],
}

impl Block {
    pub(crate) const EMPTY: Self = Self {
        distance: [0; VOXELS],
        weight: [0; VOXELS],
        colour: [0; VOXELS],
    };

    /// Whether a voxel was seen through and never near a surface.
    #[inline]
    pub(crate) fn is_empty_space(&self, voxel: usize) -> bool {
        self.weight[voxel] == 0 && self.distance[voxel] == FULL as i16
    }

    /// Whether a voxel may be a corner of the surface: inside it needs this many frames, outside one.
    #[inline]
    pub(crate) fn is_known(&self, voxel: usize, min_seen: u32) -> bool {
        let outside = self.distance[voxel] >= 0;
        self.weight[voxel] > 0 && (outside || self.colour[voxel] >> 24 >= min_seen)
    }

    /// Whether no voxel is inside of a surface.
    pub(crate) fn is_outside(&self) -> bool {
        let inside = |(d, w): (&i16, &u16)| (*w > 0) & (*d < 0);
        !self.distance.iter().zip(&self.weight).any(inside)
    }
}

/// A fast hash: keys are small integers and not hostile.
#[derive(Default)]
pub(crate) struct KeyHasher(u64);

/// Used for look-ups only, never iterated.
pub(crate) type KeyMap<T> = HashMap<Key, T, BuildHasherDefault<KeyHasher>>;

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 29)
    }

    fn write(&mut self, bytes: &[u8]) {
        for b in bytes {
            self.write_u32(u32::from(*b));
        }
    }

    fn write_u32(&mut self, v: u32) {
        self.0 = (self.0.rotate_left(21) ^ u64::from(v)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    }

    fn write_i32(&mut self, v: i32) {
        self.write_u32(v as u32);
    }

    fn write_usize(&mut self, _: usize) {}
}

/// Number of blocks allocated at once, so that growing moves none.
const CHUNK: usize = 64;

impl Default for Block {
    fn default() -> Self {
        Self::EMPTY
    }
}

/// All blocks, of voxels or of other 8x8x8 data.
pub(crate) struct Blocks<B = Block> {
    table: KeyMap<u32>,
    chunks: Vec<Box<[B]>>,
    /// By block number; stale for unused blocks.
    keys: Vec<Key>,
    used: Vec<bool>,
    free: Vec<u32>,
    /// Number of leading blocks with stale contents, which are cleared before use.
    stale: usize,
}

impl<B> Default for Blocks<B> {
    fn default() -> Self {
        Self {
            table: HashMap::default(),
            chunks: Vec::new(),
            keys: Vec::new(),
            used: Vec::new(),
            free: Vec::new(),
            stale: 0,
        }
    }
}

impl<B: Clone + Default> Blocks<B> {
    pub(crate) fn len(&self) -> usize {
        self.table.len()
    }

    /// The number of the block at a position.
    pub(crate) fn find(&self, key: Key) -> Option<usize> {
        self.table.get(&key).map(|n| *n as usize)
    }

    pub(crate) fn get(&self, number: usize) -> &B {
        &self.chunks[number / CHUNK][number % CHUNK]
    }

    pub(crate) fn get_mut(&mut self, number: usize) -> &mut B {
        &mut self.chunks[number / CHUNK][number % CHUNK]
    }

    pub(crate) fn at(&self, key: Key) -> Option<&B> {
        self.find(key).map(|n| self.get(n))
    }

    /// The number of the block at a position, which is created if missing.
    pub(crate) fn find_or_make(&mut self, key: Key) -> usize {
        if let Some(number) = self.find(key) {
            return number;
        }
        let number = self.free.pop().unwrap_or_else(|| {
            let next = self.keys.len();
            if next == CHUNK * self.chunks.len() {
                self.chunks
                    .push(vec![B::default(); CHUNK].into_boxed_slice());
            } else if next < self.stale {
                *self.get_mut(next) = B::default();
            }
            self.keys.push(key);
            self.used.push(false);
            next as u32
        });
        self.table.insert(key, number);
        let number = number as usize;
        (self.keys[number], self.used[number]) = (key, true);
        number
    }

    pub(crate) fn remove(&mut self, number: usize) {
        if !std::mem::replace(&mut self.used[number], false) {
            return;
        }
        self.table.remove(&self.keys[number]);
        *self.get_mut(number) = B::default();
        self.free.push(number as u32);
    }

    /// Numbers and keys of all blocks within a box of keys (inclusive), ordered by number.
    pub(crate) fn within(
        &self,
        [least, most]: [[i32; 3]; 2],
    ) -> impl Iterator<Item = (usize, Key)> {
        let inside = move |k: &Key| {
            let at = k.xyz();
            (0..3).all(|i| at[i] >= least[i] && at[i] <= most[i])
        };
        let all = self.keys.iter().zip(&self.used).enumerate();
        all.filter(move |(_, (k, used))| **used && inside(k))
            .map(|(n, (k, _))| (n, *k))
    }

    /// Keys and numbers in the order of keys.
    pub(crate) fn sorted(&self) -> Vec<(Key, usize)> {
        let all = self.keys.iter().zip(&self.used).enumerate();
        let mut sorted: Vec<(Key, usize)> = all
            .filter(|(_, (_, used))| **used)
            .map(|(n, (k, _))| (*k, n))
            .collect();
        sorted.sort_unstable();
        sorted
    }

    pub(crate) fn bytes(&self) -> usize {
        let entry = size_of::<(Key, u32)>() + 1;
        self.chunks.len() * CHUNK * size_of::<B>()
            + self.table.capacity() * entry
            + self.keys.capacity() * (size_of::<Key>() + 1)
    }
}

/// Copies the blocks in the order of their keys, independent of the history.
impl<B: Clone + Default> Clone for Blocks<B> {
    fn clone(&self) -> Self {
        let mut copy = Self::default();
        copy.clone_from(self);
        copy
    }

    fn clone_from(&mut self, source: &Self) {
        self.stale = CHUNK * self.chunks.len();
        self.table.clear();
        self.keys.clear();
        self.used.clear();
        self.free.clear();
        for (key, number) in source.sorted() {
            let to = self.find_or_make(key);
            self.get_mut(to).clone_from(source.get(number));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_found_by_key_and_listed_in_order() {
        let mut blocks = Blocks::<Block>::default();
        let keys = [(3, 0, 0), (-2, 5, 1), (0, 0, 0), (3, 0, -7)];
        for (i, (x, y, z)) in keys.into_iter().enumerate() {
            let n = blocks.find_or_make(Key::new(x, y, z));
            blocks.get_mut(n).weight[0] = i as u16 + 1;
        }
        let order: Vec<[i32; 3]> = blocks.sorted().iter().map(|(k, _)| k.xyz()).collect();
        assert_eq!(order, [[3, 0, -7], [0, 0, 0], [3, 0, 0], [-2, 5, 1]]);
        assert_eq!(blocks.at(Key::new(-2, 5, 1)).unwrap().weight[0], 2);
        let gone = blocks.find(Key::new(0, 0, 0)).unwrap();
        blocks.remove(gone);
        blocks.remove(gone);
        assert_eq!(
            (blocks.len(), blocks.at(Key::new(0, 0, 0)).is_none()),
            (3, true)
        );
        // The block is reused and cleared.
        let again = blocks.find_or_make(Key::new(9, 9, 9));
        assert_eq!((again, blocks.get(again).weight[0]), (gone, 0));
        let copy = blocks.clone();
        assert_eq!(copy.len(), 4);
        assert!(copy.sorted().iter().map(|p| p.1).eq(0..4));
        // A copy into a larger one is equal, and reuses its memory.
        let mut other = Blocks::<Block>::default();
        for x in 0..70 {
            let n = other.find_or_make(Key::new(x, 1, 0));
            other.get_mut(n).weight.fill(7);
        }
        let bytes = other.bytes();
        other.clone_from(&blocks);
        assert!(other.bytes() <= bytes);
        assert_eq!(other.sorted(), copy.sorted());
        assert!((0..4).all(|n| other.get(n) == copy.get(n)));
        let more = other.find_or_make(Key::new(50, 50, 50));
        assert_eq!((more, other.get(more).weight[0]), (4, 0));
        let within: Vec<Key> = copy.within([[0; 3], [9; 3]]).map(|p| p.1).collect();
        assert_eq!(within, [Key::new(3, 0, 0), Key::new(9, 9, 9)]);
    }
}
