//! Time and memory of place recognition: `cargo bench -p stillpoint-place`. 1000 features per image; each keyframe
//! shares a third of them with its predecessor.

use std::sync::Arc;

use divan::{AllocProfiler, Bencher, black_box};
use stillpoint_features::Descriptor;
use stillpoint_place::{PlaceIndex, PlaceVector, Vocabulary};

#[global_allocator]
static ALLOCATIONS: AllocProfiler = AllocProfiler::system();

fn main() {
    divan::main();
}

const FEATURES: usize = 1000;

struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn descriptor(&mut self) -> Descriptor {
        Descriptor(std::array::from_fn(|_| self.bits()))
    }

    /// The same point observed again: one bit in eight differs.
    fn seen_again(&mut self, descriptor: &Descriptor) -> Descriptor {
        Descriptor(std::array::from_fn(|i| {
            descriptor.0[i] ^ (self.bits() & self.bits() & self.bits())
        }))
    }
}

fn images(count: usize) -> Vec<Vec<Descriptor>> {
    let mut random = Random(1);
    let mut images: Vec<Vec<Descriptor>> = Vec::new();
    for _ in 0..count {
        let old = images.last().cloned().unwrap_or_default();
        let image = (0..FEATURES).map(|i| match old.get(3 * i) {
            Some(old) => random.seen_again(old),
            None => random.descriptor(),
        });
        images.push(image.collect());
    }
    images
}

fn index(count: usize) -> PlaceIndex<u32> {
    let vocabulary = Vocabulary::embedded();
    let mut index = PlaceIndex::default();
    for (key, image) in images(count).iter().enumerate() {
        index.insert(key as u32, Arc::new(vocabulary.vector(image)));
    }
    index
}

/// Reading the embedded vocabulary, required before the first query.
#[divan::bench]
fn load_vocabulary() -> Vocabulary {
    Vocabulary::embedded()
}

#[divan::bench]
fn vector(bencher: Bencher) {
    let (vocabulary, images) = (Vocabulary::embedded(), images(1));
    bencher.bench(|| vocabulary.vector(black_box(&images[0])));
}

/// An index of 1000 keyframes from their descriptors, as after loading a map.
#[divan::bench(sample_count = 10)]
fn rebuild_1000(bencher: Bencher) {
    let (vocabulary, images) = (Vocabulary::embedded(), images(1000));
    bencher.bench(|| {
        let mut index = PlaceIndex::default();
        for (key, image) in images.iter().enumerate() {
            index.insert(key as u32, Arc::new(vocabulary.vector(image)));
        }
        index
    });
}

#[divan::bench(args = [100, 1000, 2000, 10_000])]
fn query(bencher: Bencher, keyframes: usize) {
    let index = index(keyframes);
    let seen = Arc::clone(index.get(keyframes as u32 / 2).expect("it was inserted"));
    bencher.bench(|| index.query(black_box(&seen), |_| true, 10));
}

#[divan::bench]
fn score(bencher: Bencher) {
    let index = index(2);
    let vectors: Vec<&PlaceVector> = [0, 1]
        .iter()
        .filter_map(|k| index.get(*k))
        .map(|v| &**v)
        .collect();
    bencher.bench(|| black_box(vectors[0]).score(vectors[1]));
}

/// Publishing a view of 1000 keyframes, then an insertion, which copies the list.
#[divan::bench]
fn publish_and_insert(bencher: Bencher) {
    let mut index = index(1000);
    let vector = Arc::clone(index.get(0).expect("it was inserted"));
    let mut key = 1000;
    bencher.bench_local(|| {
        let view = index.clone();
        index.insert(key, Arc::clone(&vector));
        key += 1;
        view
    });
}
