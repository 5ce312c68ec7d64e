//! Kernels compiled with POPCNT; each returns the same integers as its portable twin. The only unsafe code of the
//! crate. 64-bit Arm always has such an instruction, so its portable code already uses it.
#![allow(unsafe_code)]

use crate::{PlaceVector, Vocabulary, vector::Tally};
use stillpoint_features::Descriptor;

/// The standard library caches the detection.
#[cfg(target_arch = "x86_64")]
fn there() -> bool {
    std::arch::is_x86_feature_detected!("popcnt")
}

/// [`Vocabulary::words_portable`].
pub(crate) fn words(vocabulary: &Vocabulary, descriptors: &[Descriptor]) -> Vec<u16> {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "popcnt")]
        fn kernel(vocabulary: &Vocabulary, descriptors: &[Descriptor]) -> Vec<u16> {
            vocabulary.words_portable(descriptors)
        }
        if there() {
            // SAFETY: the instruction has just been detected.
            return unsafe { kernel(vocabulary, descriptors) };
        }
    }
    vocabulary.words_portable(descriptors)
}

/// [`PlaceVector::tally_portable`].
pub(crate) fn tally(a: &PlaceVector, b: &PlaceVector, words_per_group: u16, out: &mut Tally) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "popcnt")]
        fn kernel(a: &PlaceVector, b: &PlaceVector, words_per_group: u16, out: &mut Tally) {
            a.tally_portable(b, words_per_group, out);
        }
        if there() {
            // SAFETY: the instruction has just been detected.
            return unsafe { kernel(a, b, words_per_group, out) };
        }
    }
    a.tally_portable(b, words_per_group, out);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn popcnt_kernels_match_the_portable_ones(
            a in proptest::collection::vec(proptest::array::uniform4(any::<u64>()), 0..80),
            b in proptest::collection::vec(proptest::array::uniform4(any::<u64>()), 0..80),
        ) {
            let vocabulary = Vocabulary::embedded();
            let [a, b] = [a, b].map(|d| d.into_iter().map(Descriptor).collect::<Vec<_>>());
            prop_assert_eq!(words(&vocabulary, &a), vocabulary.words_portable(&a));
            // Random descriptors rarely match; half of one image is added to the other to get pairs.
            let b: Vec<_> = b.iter().chain(a.iter().step_by(2)).copied().collect();
            let (a, b) = (vocabulary.vector(&a), vocabulary.vector(&b));
            let (mut fast, mut portable) = (Tally::default(), Tally::default());
            for words_per_group in [1, 8, 512] {
                tally(&a, &b, words_per_group, &mut fast);
                a.tally_portable(&b, words_per_group, &mut portable);
                prop_assert_eq!(fast.pairs(), portable.pairs());
            }
        }
    }
}
