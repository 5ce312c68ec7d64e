//! The embedded vocabulary and its format.

use proptest::prelude::*;
use stillpoint_features::Descriptor;
use stillpoint_place::{Vocabulary, VocabularyError};

fn embedded() -> &'static [u8] {
    include_bytes!("../data/vocabulary.bin")
}

#[test]
fn embedded_vocabulary_matches_its_file_and_is_small() {
    assert_eq!(
        Vocabulary::from_bytes(embedded()),
        Ok(Vocabulary::embedded())
    );
    assert!(embedded().len() <= 300_000);
    assert!(!Vocabulary::embedded().is_empty());
}

/// A small tree of two levels: descent to the nearest child, the first one on ties.
#[test]
fn word_is_found_by_descending_to_nearest_children() {
    let centre = |bits: u64| Descriptor([bits, 0, 0, 0]);
    let mut bytes = b"SPWT\x01\x02\x02\x01".to_vec();
    for c in [
        centre(0),
        centre(0xff),
        centre(1),
        centre(2),
        centre(0xff),
        centre(0xff),
    ] {
        bytes.extend(c.0.iter().flat_map(|w| w.to_le_bytes()));
    }
    bytes.extend([0, 4].repeat(4));
    let tree = Vocabulary::from_bytes(&bytes).unwrap();
    assert_eq!(tree.len(), 4);
    let seen = [0, 1, 2, 3, 0xff, 0xf7, 0x0f].map(centre);
    assert_eq!(tree.words(&seen), [0, 0, 1, 0, 2, 2, 0]);
}

/// A change of these changes all place vectors, and the results on saved maps.
#[test]
fn embedded_vocabulary_gives_reference_words() {
    let descriptors: Vec<Descriptor> = (1..=8_u64)
        .map(|i| {
            Descriptor(std::array::from_fn(|k| {
                (4 * i + k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
            }))
        })
        .collect();
    let golden = [3712, 1217, 3494, 2186, 1010, 1512, 3974, 1537];
    assert_eq!(Vocabulary::embedded().words(&descriptors), golden);
}

#[test]
fn invalid_vocabularies_are_reported() {
    let check = |bytes: &[u8], expected: VocabularyError, text: &str| {
        let error = Vocabulary::from_bytes(bytes).unwrap_err();
        assert_eq!(error, expected);
        assert!(error.to_string().contains(text), "{error}");
    };
    let changed = |at: usize, byte: u8| {
        let mut bytes = embedded().to_vec();
        bytes[at] = byte;
        bytes
    };
    check(b"", VocabularyError::Foreign, "version 1");
    check(b"ORBvoc", VocabularyError::Foreign, "version 1");
    check(&changed(4, 2), VocabularyError::Foreign, "version 1");
    let short = VocabularyError::Length {
        expected: 8,
        found: 6,
    };
    check(&embedded()[..6], short, "expected 8 bytes");
    let length = VocabularyError::Length {
        expected: embedded().len(),
        found: embedded().len() - 1,
    };
    check(&embedded()[..embedded().len() - 1], length, "found");
    for (at, byte) in [
        (5, 0),
        (5, 1),
        (5, 255),
        (6, 0),
        (6, 200),
        (6, 8),
        (7, 0),
        (7, 99),
    ] {
        let error = Vocabulary::from_bytes(&changed(at, byte)).unwrap_err();
        assert!(
            matches!(error, VocabularyError::Shape { .. }),
            "{at} {byte}: {error}"
        );
    }
}

proptest! {
    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        let _ = Vocabulary::from_bytes(&bytes);
        let mut begun = b"SPWT\x01".to_vec();
        begun.extend(&bytes);
        let _ = Vocabulary::from_bytes(&begun);
    }

    /// Whatever a file of the right length contains, words must be in range and scores must be shares.
    #[test]
    fn changed_bytes_give_an_error_or_a_valid_tree(
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..200),
        seen in proptest::collection::vec(proptest::array::uniform4(any::<u64>()), 1..40),
    ) {
        let mut bytes = embedded().to_vec();
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Ok(tree) = Vocabulary::from_bytes(&bytes) {
            let seen: Vec<Descriptor> = seen.into_iter().map(Descriptor).collect();
            prop_assert!(tree.words(&seen).iter().all(|w| usize::from(*w) < tree.len()));
            let (all, half) = (tree.vector(&seen), tree.vector_of(&std::sync::Arc::new(seen.to_vec()), |i| i % 2 == 0));
            prop_assert!((0.0..=1.0).contains(&all.word_score(&half)));
            prop_assert!((0.0..=1.0).contains(&all.score(&half)));
        }
    }
}
