//! A reusable set of landmarks: a bit per id, of which clearing resets only those set.

use stillpoint_map::LandmarkId;

/// A set of landmarks whose clearing time depends only on its size.
#[derive(Default)]
pub(crate) struct LandmarkSet {
    bits: Vec<u64>,
    members: Vec<LandmarkId>,
}

impl LandmarkSet {
    /// Adds a landmark; returns whether it was new.
    #[inline]
    pub(crate) fn insert(&mut self, id: LandmarkId) -> bool {
        let (word, bit) = place(id);
        if word >= self.bits.len() {
            self.bits.resize(word + 1, 0);
        }
        let is_new = self.bits[word] & bit == 0;
        if is_new {
            self.bits[word] |= bit;
            self.members.push(id);
        }
        is_new
    }

    #[inline]
    pub(crate) fn contains(&self, id: LandmarkId) -> bool {
        let (word, bit) = place(id);
        self.bits.get(word).is_some_and(|w| w & bit != 0)
    }

    pub(crate) fn clear(&mut self) {
        for id in self.members.drain(..) {
            self.bits[place(id).0] = 0;
        }
    }
}

fn place(id: LandmarkId) -> (usize, u64) {
    (id.index() / 64, 1 << (id.index() % 64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    proptest! {
        #[test]
        fn landmark_set_matches_a_btree_set(rounds in prop::collection::vec(prop::collection::vec(0_u32..300, 0..40), 1..6)) {
            let mut set = LandmarkSet::default();
            for round in rounds {
                let mut tree = BTreeSet::new();
                for id in round {
                    prop_assert_eq!(set.insert(LandmarkId::new(id)), tree.insert(id));
                }
                prop_assert!((0..400).all(|id| set.contains(LandmarkId::new(id)) == tree.contains(&id)));
                set.clear();
                prop_assert!((0..400).all(|id| !set.contains(LandmarkId::new(id))));
            }
        }
    }
}
