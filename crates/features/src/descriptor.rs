//! Binary descriptors and their distance.

/// A binary descriptor of 256 bits; bit `i` is bit `i % 64` of word `i / 64`.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Descriptor(pub [u64; 4]);

impl Descriptor {
    /// Hamming distance, 0..=256 bits.
    #[must_use]
    #[inline(always)]
    pub fn distance(&self, other: &Self) -> u32 {
        #[cfg(target_arch = "aarch64")]
        if stillpoint_imaging::Simd::Neon.has_neon() {
            return crate::neon::distance(&self.0, &other.0);
        }
        self.distance_portable(other)
    }

    /// [`Descriptor::distance`] for the instruction set of its caller, into which it is inlined.
    #[inline(always)]
    pub(crate) fn distance_portable(&self, other: &Self) -> u32 {
        let bits = |i: usize| (self.0[i] ^ other.0[i]).count_ones();
        bits(0) + bits(1) + bits(2) + bits(3)
    }

    /// The descriptor with the smallest median distance to all given ones (including itself; the lower median of an
    /// even number). Ties go to the first. `None` for no descriptors.
    #[must_use]
    pub fn medoid<'a>(descriptors: impl IntoIterator<Item = &'a Descriptor>) -> Option<Descriptor> {
        let all: Vec<Descriptor> = descriptors.into_iter().copied().collect();
        let mut distances = vec![0; all.len()];
        let median_of = |candidate: &Descriptor, distances: &mut Vec<u32>| {
            for (distance, other) in distances.iter_mut().zip(&all) {
                *distance = candidate.distance(other);
            }
            let middle = (distances.len() - 1) / 2;
            *distances.select_nth_unstable(middle).1
        };
        let mut best: Option<(u32, Descriptor)> = None;
        for candidate in &all {
            let median = median_of(candidate, &mut distances);
            if best.is_none_or(|(least, _)| median < least) {
                best = Some((median, *candidate));
            }
        }
        best.map(|(_, descriptor)| descriptor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn distance_matches_the_portable_implementation(a in any::<[u64; 4]>(), b in any::<[u64; 4]>()) {
            let none = Descriptor([0; 4]);
            let all = Descriptor([u64::MAX; 4]);
            for (a, b) in [(Descriptor(a), Descriptor(b)), (none, Descriptor(a)), (none, all)] {
                prop_assert_eq!(a.distance(&b), a.distance_portable(&b));
            }
            prop_assert_eq!(none.distance(&all), 256);
        }
    }
}
