//! A set of landmarks that is filled and emptied again and again: a bit per id that was ever given, of which only those that were set are cleared.

use stillpoint_map::LandmarkId;

/// Some landmarks. Emptying it takes as long as filling it, however many ids there are.
#[derive(Default)]
pub(crate) struct LandmarkSet {
    bits: Vec<u64>,
    members: Vec<LandmarkId>,
}

impl LandmarkSet {
    /// Adds one; returns whether it is new.
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

    /// Whether it is in the set.
    #[inline]
    pub(crate) fn contains(&self, id: LandmarkId) -> bool {
        let (word, bit) = place(id);
        self.bits.get(word).is_some_and(|w| w & bit != 0)
    }

    /// Takes all out.
    pub(crate) fn clear(&mut self) {
        for id in self.members.drain(..) {
            self.bits[place(id).0] = 0;
        }
    }
}

/// The word and the bit of a landmark.
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
        fn it_holds_what_a_tree_holds(rounds in prop::collection::vec(prop::collection::vec(0_u32..300, 0..40), 1..6)) {
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
