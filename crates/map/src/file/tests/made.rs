//! Random maps that exercise all features.

use crate::file::Extension;
use crate::landmark::LandmarkSlot;
use crate::{
    Correction, KeyframeData, KeyframeId, KeyframeSlot, LandmarkId, LoopEdge, Map, NewLandmark,
};
use std::sync::Arc;
use stillpoint_features::{Descriptor, Edge, FeatureGrid, Keypoint};
use stillpoint_geometry::{BrownConrady, Camera, Mat6, Se3, Vec3, Vec6};

pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: u32) -> u32 {
        (self.bits() % u64::from(n.max(1))) as u32
    }

    /// In [0, 1).
    fn share(&mut self) -> f32 {
        self.below(1 << 20) as f32 / (1 << 20) as f32
    }
}

const LEVELS: usize = 8;

fn cameras() -> [Camera; 2] {
    let mut wide = Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3]);
    wide.distortion = BrownConrady {
        k1: 0.26,
        k2: -0.95,
        p1: -0.0054,
        p2: 0.0026,
        k3: 1.16,
    };
    [
        wide,
        Camera::pinhole(320, 240, [260.0, 260.0, 160.0, 120.0]),
    ]
}

pub(super) fn data(random: &mut Random, features: u32, stamp: f64) -> Arc<KeyframeData> {
    let camera = cameras()[random.below(2) as usize];
    let n = features as usize;
    let keypoint = |i: usize| Keypoint {
        x: random.below(camera.width) as f32,
        y: random.below(camera.height) as f32,
        level: random.below(LEVELS as u32) as u8,
        angle: 6.0 * random.share() - 3.0,
        response: 1.0 + random.below(255) as f32,
        // Not random, so that the file of version 1, which has no edges, is that of the same numbers.
        edge: Edge::from_bytes([(i % 80) as u8, 255 - (i % 70) as u8]),
    };
    let keypoints: Vec<Keypoint> = (0..n).map(keypoint).collect();
    let positions: Vec<[f32; 2]> = keypoints
        .iter()
        .map(|k| {
            [
                k.x + 20.0 * random.share() - 10.0,
                k.y - 3.0 * random.share(),
            ]
        })
        .collect();
    let levels: Vec<u8> = keypoints.iter().map(|k| k.level).collect();
    let depths: Vec<f32> = (0..n)
        .map(|_| (5.0 * random.share() - 1.0).max(0.0))
        .collect();
    Arc::new(KeyframeData {
        stamp,
        camera,
        sigma_px: levels.iter().map(|l| 1.0 + 0.2 * f32::from(*l)).collect(),
        depth_sigmas: depths.iter().map(|z| 0.002 * z * z).collect(),
        depths,
        descriptors: (0..n)
            .map(|_| Descriptor(std::array::from_fn(|_| random.bits())))
            .collect::<Vec<_>>()
            .into(),
        mappable: (0..n).map(|_| random.below(10) > 0).collect(),
        grid: FeatureGrid::build(&positions, &levels, KeyframeData::grid_bounds(&camera)),
        keypoints,
        positions,
    })
}

fn pose(random: &mut Random) -> Se3 {
    let mut twist = Vec6::zeros();
    for x in twist.iter_mut() {
        *x = f64::from(random.share()) - 0.5;
    }
    Se3::exp(&twist)
}

fn point(random: &mut Random) -> Vec3 {
    let mut x = || 4.0 * f64::from(random.share()) - 2.0;
    Vec3::new(x(), x(), x() + 3.0)
}

/// A map after `changes` random changes of every kind.
pub(super) fn random_map(seed: u64, features: u32, changes: u32) -> Map {
    let random = &mut Random(seed);
    let mut map = Map::new(LEVELS, 1.2);
    let mut next = 0;
    for _ in 0..changes {
        // Mostly a live one: most ids are unused.
        let live: Vec<KeyframeId> = map.view.keyframes().map(|k| k.id).collect();
        let one = random.below(live.len() as u32) as usize;
        let keyframe = match live.get(one) {
            Some(id) if random.below(8) > 0 => *id,
            _ => KeyframeId(random.below(next)),
        };
        let landmark = |random: &mut Random, map: &Map| {
            LandmarkId::new(random.below(map.view.landmark_bound() as u32))
        };
        let (a, b) = (landmark(random, &map), landmark(random, &map));
        match random.below(32) {
            0..=3 => {
                let some = || map.view.keyframes().next().map(|k| k.id);
                let parent = map.view.resolve_keyframe(keyframe).or_else(some);
                // A few begin submaps of their own.
                let parent = parent.filter(|_| random.below(16) > 0);
                let data = data(random, features, 1e9 + f64::from(next) / 30.0);
                map.insert_keyframe(KeyframeId(next), data, pose(random), parent);
                next += 1 + random.below(3) * random.below(200);
            }
            4..=11 => {
                let observation = (keyframe, random.below(features));
                let position = point(random);
                map.insert_landmark(&NewLandmark {
                    position,
                    observation,
                });
            }
            12..=22 => {
                map.add_observation(a, keyframe, random.below(features));
            }
            23 => map.remove_observation(a, keyframe),
            24 => {
                map.merge_landmarks(a, b);
            }
            25 => map.cull_landmark(a),
            26 => {
                map.cull_keyframe(keyframe);
            }
            27 => {
                map.disown(keyframe, &[random.below(features)]);
            }
            28 => map.set_pose(keyframe, pose(random)),
            29 => {
                if let Some(l) = map.landmark_mut(a) {
                    l.visible += random.below(20);
                    l.static_odds = 4.0 * random.share() - 2.0;
                }
                map.publish();
            }
            _ => {
                map.refresh_landmark(a);
                map.refresh_covisibility(keyframe, 1);
            }
        }
    }
    map
}

/// A random map with loops between keyframes, in submaps with more than one.
pub(super) fn looped_map(seed: u64, features: u32, changes: u32) -> Map {
    let mut map = random_map(seed, features, changes);
    let random = &mut Random(seed);
    let ids: Vec<KeyframeId> = map.view.keyframes().map(|k| k.id).collect();
    for _ in 0..ids.len() {
        let mut one = || ids[random.below(ids.len() as u32) as usize];
        let (old, new) = (one(), one());
        let mut information = Mat6::from_diagonal_element(f64::from(random.below(1000)));
        information[(1, 4)] = f64::from(random.share());
        information[(4, 1)] = information[(1, 4)];
        map.apply(&Correction {
            measured: Some(Box::new(LoopEdge {
                old,
                new,
                old_from_new: pose(random),
                information,
                inliers: random.below(200),
            })),
            ..Correction::default()
        });
    }
    map
}

/// All content of a map as text, distinguishing all bits.
pub(super) fn words(map: &Map) -> String {
    format!("{map:?}")
}

pub(super) fn extensions() -> Vec<Extension> {
    let extension = |name: &str, bytes: Vec<u8>| Extension {
        name: name.into(),
        bytes,
    };
    vec![
        extension("trajectory", (0..3000u32).map(|i| (i / 7) as u8).collect()),
        extension("calibration", Vec::new()),
        extension("header", vec![0; 5000]),
    ]
}

#[test]
fn random_maps_exercise_all_features() {
    let map = random_map(7, 12, 1500);
    let ids = (0..map.view.keyframe_bound() as u32).map(KeyframeId);
    let slots: Vec<_> = ids.map(|id| map.view.keyframe_slot(id)).collect();
    let count = |f: fn(&KeyframeSlot) -> bool| slots.iter().filter(|s| f(s)).count();
    assert!(count(|s| matches!(s, KeyframeSlot::Empty)) > 256);
    assert!(count(|s| matches!(s, KeyframeSlot::Culled { .. })) > 3);
    assert!(map.view.keyframe_count() > 20);
    assert!(map.view.submaps().len() > 2);
    let covisible: usize = map.view.keyframes().map(|k| k.covisible.len()).sum();
    assert!(covisible > 4, "{covisible}");
    let ids = (0..map.view.landmark_bound() as u32).map(LandmarkId::new);
    let slots: Vec<_> = ids.map(|id| map.view.landmark_slot(id)).collect();
    let count = |f: fn(&LandmarkSlot<'_>) -> bool| slots.iter().filter(|s| f(s)).count();
    assert!(count(|s| matches!(s, LandmarkSlot::Merged(_))) > 3);
    assert!(count(|s| matches!(s, LandmarkSlot::Culled)) > 10);
    let observed_often = |l: &&crate::Landmark| l.observers > 2 && l.depth_observers > 0;
    assert!(
        map.view
            .landmarks()
            .filter(|(_, l)| observed_often(l))
            .count()
            > 10
    );
}
