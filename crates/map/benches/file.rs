//! Times and sizes of map files: `cargo bench -p stillpoint-map`. 1000 keyframes of 1000 features, 300 of which make a
//! landmark that the following keyframes also observe. Values are as noisy as real ones: raw keypoints on the pixels of
//! their level, depths with all bits.
#![allow(clippy::print_stdout)] // The sizes are results.

use divan::counter::BytesCount;
use divan::{AllocProfiler, Bencher, black_box};
use std::sync::Arc;
use stillpoint_features::{Descriptor, Edge, FeatureGrid, Keypoint};
use stillpoint_geometry::{BrownConrady, Camera, Se3, Vec3, Vec6};
use stillpoint_map::{KeyframeData, KeyframeId, LandmarkId, Map, NewLandmark};

#[global_allocator]
static ALLOCATIONS: AllocProfiler = AllocProfiler::system();

const KEYFRAMES: u32 = 1000;
const FEATURES: u32 = 1000;

fn main() {
    let bytes = map().to_bytes(&[]).expect("the map is sound");
    println!(
        "{KEYFRAMES} keyframes of {FEATURES} features: {} bytes",
        bytes.len()
    );
    divan::main();
}

struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In [0, 1).
    fn share(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }
}

fn camera() -> Camera {
    let mut camera = Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3]);
    camera.distortion = BrownConrady {
        k1: 0.26,
        k2: -0.95,
        p1: -0.0054,
        p2: 0.0026,
        k3: 1.16,
    };
    camera
}

fn data(random: &mut Random, camera: &Camera, stamp: f64) -> Arc<KeyframeData> {
    let keypoint = |i: u32, random: &mut Random| {
        let level = (i * 5 / FEATURES) as u8;
        let scale = (0..level).fold(1.0f32, |s, _| s * 1.45);
        Keypoint {
            x: (random.share() * 640.0 / scale).floor() * scale,
            y: (random.share() * 480.0 / scale).floor() * scale,
            level,
            angle: 6.2 * random.share() - 3.1,
            response: (7.0 + 60.0 * random.share()).floor(),
            edge: Edge::default(),
        }
    };
    let keypoints: Vec<Keypoint> = (0..FEATURES).map(|i| keypoint(i, random)).collect();
    let positions: Vec<[f32; 2]> = keypoints
        .iter()
        .map(|k| {
            [
                k.x + 4.0 * random.share() - 2.0,
                k.y + 4.0 * random.share() - 2.0,
            ]
        })
        .collect();
    let levels: Vec<u8> = keypoints.iter().map(|k| k.level).collect();
    let depths: Vec<f32> = (0..FEATURES)
        .map(|i| {
            if i % 6 == 0 {
                0.0
            } else {
                0.6 + 4.0 * random.share()
            }
        })
        .collect();
    Arc::new(KeyframeData {
        stamp,
        camera: *camera,
        sigma_px: keypoints
            .iter()
            .map(|k| 1.0 + 0.2 * f32::from(k.level))
            .collect(),
        depth_sigmas: depths.iter().map(|z| 0.0015 * z * z).collect(),
        depths,
        descriptors: (0..FEATURES)
            .map(|_| Descriptor(std::array::from_fn(|_| random.bits())))
            .collect::<Vec<_>>()
            .into(),
        mappable: (0..FEATURES).map(|i| i % 20 > 0).collect(),
        grid: FeatureGrid::build(&positions, &levels, KeyframeData::grid_bounds(camera)),
        keypoints,
        positions,
    })
}

/// Keyframe ids are ten frames apart.
fn map() -> Map {
    let (mut map, random, camera) = (Map::new(5, 1.45), &mut Random(1), camera());
    for k in 0..KEYFRAMES {
        let (id, parent) = (
            KeyframeId(10 * k),
            k.checked_sub(1).map(|p| KeyframeId(10 * p)),
        );
        let share = |random: &mut Random| f64::from(random.share()) - 0.5;
        let twist = Vec6::from_fn(|_, _| share(random));
        map.insert_keyframe(
            id,
            data(random, &camera, f64::from(k) / 3.0),
            Se3::exp(&twist),
            parent,
        );
        let first = map.view().landmark_bound() as u32;
        // Landmarks of earlier keyframes are observed again by the next features.
        for (feature, back) in (300..800).enumerate() {
            let landmark = first.checked_sub(3 * feature as u32 + 1);
            if let Some(landmark) = landmark {
                map.add_observation(LandmarkId::new(landmark), id, back);
            }
        }
        for feature in 0..300 {
            let position = Vec3::new(3.0 * share(random), share(random), 2.0 + share(random));
            map.insert_landmark(&NewLandmark {
                position,
                observation: (id, feature),
            });
        }
        map.refresh_covisibility(id, 15);
    }
    map.publish();
    map
}

/// All checks, the sections and the file in memory.
#[divan::bench(sample_count = 10)]
fn save(bencher: Bencher) {
    let map = map();
    bencher.bench(|| black_box(&map).to_bytes(&[]));
}

/// From the file's bytes to a checked map.
#[divan::bench(sample_count = 10)]
fn load(bencher: Bencher) {
    let bytes = map().to_bytes(&[]).expect("the map is sound");
    bencher
        .counter(BytesCount::new(bytes.len()))
        .bench(|| Map::from_bytes(black_box(&bytes)));
}

#[divan::bench(sample_count = 10)]
fn check(bencher: Bencher) {
    let map = map();
    bencher.bench(|| black_box(&map).check());
}
