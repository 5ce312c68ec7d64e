//! Laws of vectors and index, on random descriptors.

use proptest::prelude::*;
use std::sync::Arc;
use stillpoint_features::Descriptor;
use stillpoint_place::{FeaturePair, PlaceIndex, PlaceVector, Vocabulary};

fn descriptors(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Descriptor>> {
    let one = proptest::array::uniform4(any::<u64>()).prop_map(Descriptor);
    proptest::collection::vec(one, count)
}

/// Images, some of which share descriptors with their predecessor.
fn images(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Vec<Descriptor>>> {
    let image = (descriptors(1..60), 0..40_usize);
    proptest::collection::vec(image, count).prop_map(|images| {
        let mut all: Vec<Vec<Descriptor>> = Vec::new();
        for (mut image, shared) in images {
            if let Some(before) = all.last() {
                image.extend(before.iter().take(shared));
            }
            all.push(image);
        }
        all
    })
}

fn vectors(images: &[Vec<Descriptor>]) -> Vec<Arc<PlaceVector>> {
    let vocabulary = Vocabulary::embedded();
    let vector = |image: &Vec<Descriptor>| Arc::new(vocabulary.vector(image));
    images.iter().map(vector).collect()
}

fn index(vectors: &[Arc<PlaceVector>]) -> PlaceIndex<usize> {
    let mut index = PlaceIndex::default();
    for (key, vector) in vectors.iter().enumerate() {
        assert!(index.insert(key, Arc::clone(vector)).is_none());
    }
    index
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn keyframe_matches_itself_best(images in images(1..12)) {
        let vectors = vectors(&images);
        let index = index(&vectors);
        prop_assert_eq!(index.len(), images.len());
        for (key, vector) in vectors.iter().enumerate() {
            let found = index.query(vector, |_| true, 3);
            prop_assert_eq!(found[0].key, key);
            prop_assert_eq!((found[0].score, found[0].word_score), (1.0, 1.0));
        }
    }

    #[test]
    fn removed_keyframe_is_not_found(images in images(2..12), at in any::<prop::sample::Index>()) {
        let vectors = vectors(&images);
        let mut index = index(&vectors);
        let view = index.clone();
        let gone = at.index(images.len());
        prop_assert_eq!(index.remove(gone), Some(Arc::clone(&vectors[gone])));
        prop_assert!(index.remove(gone).is_none());
        prop_assert_eq!(index.len(), images.len() - 1);
        prop_assert!(index.get(gone).is_none());
        prop_assert!(index.query(&vectors[gone], |_| true, 100).iter().all(|m| m.key != gone));
        // A view taken before is unaffected.
        prop_assert_eq!(view.len(), images.len());
        prop_assert_eq!(view.query(&vectors[gone], |_| true, 1)[0].key, gone);
    }

    #[test]
    fn insertion_order_does_not_matter(
        images in images(2..12),
        order in Just((0..12).collect::<Vec<usize>>()).prop_shuffle(),
        detour in any::<prop::sample::Index>(),
    ) {
        let vectors = vectors(&images);
        let straight = index(&vectors);
        let mut shuffled = PlaceIndex::default();
        for key in order.into_iter().filter(|k| *k < images.len()) {
            shuffled.insert(key, Arc::clone(&vectors[key]));
        }
        let detour = detour.index(images.len());
        shuffled.remove(detour);
        shuffled.insert(detour, Arc::clone(&vectors[detour]));
        for vector in &vectors {
            prop_assert_eq!(straight.query(vector, |_| true, 5), shuffled.query(vector, |_| true, 5));
        }
    }

    #[test]
    fn results_are_sorted_filtered_and_limited(
        images in images(1..20),
        limit in 0..25_usize,
        odd in 0..2_usize,
    ) {
        let vectors = vectors(&images);
        let index = index(&vectors);
        let found = index.query(&vectors[0], |key| key % 2 == odd, limit);
        prop_assert!(found.len() <= limit);
        prop_assert!(found.iter().all(|m| m.key % 2 == odd));
        for pair in found.windows(2) {
            let rank = |i: usize| (pair[i].score, pair[i].word_score);
            prop_assert!(rank(0) > rank(1) || rank(0) == rank(1) && pair[0].key < pair[1].key);
        }
        for m in &found {
            prop_assert_eq!(m.score, vectors[0].score(&vectors[m.key]));
            prop_assert_eq!(m.word_score, vectors[0].word_score(&vectors[m.key]));
        }
    }

    #[test]
    fn scores_and_pairs_are_symmetric(images in images(2..3)) {
        let vectors = vectors(&images);
        let (a, b) = (&vectors[0], &vectors[1]);
        prop_assert_eq!(a.score(b), b.score(a));
        prop_assert_eq!(a.word_score(b), b.word_score(a));
        for score in [a.score(b), a.word_score(b)] {
            prop_assert!((0.0..=1.0).contains(&score));
        }
        let mut back: Vec<FeaturePair> = b.candidate_pairs(a).iter().map(|p| FeaturePair { a: p.b, b: p.a }).collect();
        back.sort_unstable();
        let mut pairs = a.candidate_pairs(b);
        pairs.sort_unstable();
        prop_assert_eq!(pairs, back);
    }

    #[test]
    fn candidate_pairs_use_admitted_features_once(images in images(2..3)) {
        let vocabulary = Vocabulary::embedded();
        let a = vocabulary.vector_of(&std::sync::Arc::new(images[0].clone()), |i| i % 3 != 0);
        let b = vocabulary.vector(&images[1]);
        prop_assert_eq!(a.len(), images[0].len() - images[0].len().div_ceil(3));
        let pairs = a.candidate_pairs(&b);
        let (mut firsts, mut seconds): (Vec<u16>, Vec<u16>) = pairs.iter().map(|p| (p.a, p.b)).unzip();
        prop_assert!(firsts.iter().all(|i| i % 3 != 0 && usize::from(*i) < images[0].len()));
        prop_assert!(seconds.iter().all(|i| usize::from(*i) < images[1].len()));
        for side in [&mut firsts, &mut seconds] {
            side.sort_unstable();
            side.dedup();
            prop_assert_eq!(side.len(), pairs.len());
        }
        // A feature of both images is found unless excluded.
        let shared = |i: usize| images[1].contains(&images[0][i]) && !i.is_multiple_of(3);
        let found = |i: usize| pairs.iter().any(|p| usize::from(p.a) == i);
        prop_assert!((0..images[0].len()).all(|i| !shared(i) || found(i)));
    }

    #[test]
    fn vectors_are_deterministic(images in images(1..4)) {
        prop_assert_eq!(vectors(&images), vectors(&images));
    }
}

#[test]
fn empty_vectors_match_nothing() {
    let vocabulary = Vocabulary::embedded();
    let (nothing, something) = (
        vocabulary.vector(&[]),
        vocabulary.vector(&[Descriptor([1, 2, 3, 4])]),
    );
    assert!(nothing.is_empty() && nothing.candidate_pairs(&something).is_empty());
    for (a, b) in [
        (&nothing, &nothing),
        (&nothing, &something),
        (&something, &nothing),
    ] {
        assert_eq!((a.score(b), a.word_score(b)), (0.0, 0.0));
    }
    let mut index = PlaceIndex::default();
    assert!(index.query(&something, |_: u8| true, 5).is_empty());
    index.insert(1_u8, Arc::new(nothing.clone()));
    index.insert(2, Arc::new(something.clone()));
    assert!(index.query(&nothing, |_| true, 5).is_empty());
    assert_eq!(index.query(&something, |_| true, 5).len(), 1);
    assert_eq!(index.keys().collect::<Vec<_>>(), [1, 2]);
}

#[test]
fn reinserting_a_key_replaces_its_vector() {
    let vocabulary = Vocabulary::embedded();
    let vector =
        |seed: u64| Arc::new(vocabulary.vector(&[Descriptor([seed, !seed, seed << 7, 99])]));
    let mut index = PlaceIndex::default();
    assert!(index.insert('a', vector(1)).is_none());
    assert_eq!(index.insert('a', vector(0xffff_ffff_ffff)), Some(vector(1)));
    assert_eq!(index.len(), 1);
    assert_eq!(index.get('a'), Some(&vector(0xffff_ffff_ffff)));
}

/// Features beyond index 65535 cannot be numbered; they must be ignored.
#[test]
fn features_beyond_index_65535_are_ignored() {
    let many: Vec<Descriptor> = (0..65_600_u64)
        .map(|i| {
            Descriptor([
                i.wrapping_mul(0x9e37_79b9_7f4a_7c15),
                i,
                i << 20,
                i.wrapping_mul(77),
            ])
        })
        .collect();
    assert_eq!(Vocabulary::embedded().vector(&many).len(), 65_536);
}
