//! Random changes to a map, checked against its invariants and a naive model of observations.

use proptest::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;
use stillpoint_features::{Descriptor, Edge, FeatureGrid, Keypoint};
use stillpoint_geometry::{Camera, Se3, Vec3, Vec6};
use stillpoint_map::{KeyframeData, KeyframeId, LandmarkId, Map, NewLandmark};

const FEATURES: u32 = 6;

fn data(id: u32) -> Arc<KeyframeData> {
    let n = FEATURES as usize;
    let positions: Vec<[f32; 2]> = (0..n).map(|i| [20.0 * i as f32 + 30.0, 50.0]).collect();
    let levels: Vec<u8> = (0..n).map(|i| i as u8 % 3).collect();
    let keypoint = |i: usize| Keypoint {
        x: positions[i][0],
        y: positions[i][1],
        level: levels[i],
        angle: 0.0,
        response: 1.0,
        edge: Edge::default(),
    };
    Arc::new(KeyframeData {
        stamp: f64::from(id),
        camera: Camera::pinhole(640, 480, [500.0, 500.0, 320.0, 240.0]),
        keypoints: (0..n).map(keypoint).collect(),
        sigma_px: vec![1.0; n],
        depths: (0..n).map(|i| if i % 2 == 0 { 2.0 } else { 0.0 }).collect(),
        depth_sigmas: vec![0.01; n],
        descriptors: (0..n)
            .map(|i| Descriptor([i as u64, u64::from(id), 0, 0]))
            .collect::<Vec<_>>()
            .into(),
        mappable: vec![true; n],
        grid: FeatureGrid::build(&positions, &levels, [0.0, 0.0, 640.0, 480.0]),
        positions,
    })
}

fn pose(seed: u32) -> Se3 {
    let s = f64::from(seed);
    Se3::exp(&Vec6::new(
        0.1 * s,
        -0.05 * s,
        0.02 * s,
        0.01 * s,
        0.02,
        -0.03,
    ))
}

#[derive(Clone, Debug)]
enum Change {
    Keyframe,
    Landmark(u32, u32),
    Observe(u32, u32, u32),
    Forget(u32, u32),
    Merge(u32, u32),
    CullLandmark(u32),
    CullKeyframe(u32),
    Move(u32, u32),
    Refresh(u32, u32),
}

fn change() -> impl Strategy<Value = Change> {
    let (k, l, f) = (0..8u32, 0..12u32, 0..FEATURES);
    prop_oneof![
        2 => Just(Change::Keyframe),
        4 => (k.clone(), f.clone()).prop_map(|(k, f)| Change::Landmark(k, f)),
        6 => (l.clone(), k.clone(), f).prop_map(|(l, k, f)| Change::Observe(l, k, f)),
        2 => (l.clone(), k.clone()).prop_map(|(l, k)| Change::Forget(l, k)),
        1 => (l.clone(), l.clone()).prop_map(|(a, b)| Change::Merge(a, b)),
        1 => l.clone().prop_map(Change::CullLandmark),
        1 => k.clone().prop_map(Change::CullKeyframe),
        1 => (k.clone(), 0..20u32).prop_map(|(k, p)| Change::Move(k, p)),
        2 => (l, k).prop_map(|(l, k)| Change::Refresh(l, k)),
    ]
}

/// Observations: landmark -> keyframe -> feature. Contains only those accepted by the map.
type Model = BTreeMap<u32, BTreeMap<u32, u32>>;

fn apply(map: &mut Map, model: &mut Model, next: &mut u32, change: &Change) {
    match *change {
        Change::Keyframe => {
            let parent = next.checked_sub(1).map(KeyframeId);
            let parent = parent.and_then(|p| map.view().resolve_keyframe(p));
            assert!(map.insert_keyframe(KeyframeId(*next), data(*next), pose(*next), parent));
            *next += 1;
        }
        Change::Landmark(k, f) => {
            let taken = model.values().any(|o| o.get(&k) == Some(&f));
            let live = map.view().keyframe(KeyframeId(k)).is_some();
            let new = NewLandmark {
                position: Vec3::new(0.1, 0.2, 3.0),
                observation: (KeyframeId(k), f),
            };
            let id = map.insert_landmark(&new);
            assert_eq!(id.is_some(), live && !taken);
            if let Some(id) = id {
                model.insert(id.number(), BTreeMap::from([(k, f)]));
            }
        }
        Change::Observe(l, k, f) => {
            let taken = model.values().any(|o| o.get(&k) == Some(&f));
            let live = map.view().keyframe(KeyframeId(k)).is_some();
            let known = model.get(&l).is_some_and(|o| !o.contains_key(&k));
            let added = map.add_observation(LandmarkId::new(l), KeyframeId(k), f);
            assert_eq!(added, live && known && !taken);
            if added {
                model.get_mut(&l).unwrap().insert(k, f);
            }
        }
        Change::Forget(l, k) => {
            map.remove_observation(LandmarkId::new(l), KeyframeId(k));
            if let Some(o) = model.get_mut(&l) {
                o.remove(&k);
            }
            model.retain(|_, o| !o.is_empty());
        }
        Change::Merge(a, b) => {
            let expected = a != b && model.contains_key(&a) && model.contains_key(&b);
            assert_eq!(
                map.merge_landmarks(LandmarkId::new(a), LandmarkId::new(b)),
                expected
            );
            if expected {
                let from = model.remove(&a).unwrap();
                let into = model.get_mut(&b).unwrap();
                for (k, f) in from {
                    into.entry(k).or_insert(f);
                }
                assert_eq!(
                    map.view().resolve_landmark(LandmarkId::new(a)),
                    Some(LandmarkId::new(b))
                );
            }
        }
        Change::CullLandmark(l) => {
            map.cull_landmark(LandmarkId::new(l));
            model.remove(&l);
        }
        Change::CullKeyframe(k) => {
            let before = map.view().world_from_keyframe(KeyframeId(k));
            if map.cull_keyframe(KeyframeId(k)) {
                for o in model.values_mut() {
                    o.remove(&k);
                }
                model.retain(|_, o| !o.is_empty());
                let after = map.view().world_from_keyframe(KeyframeId(k)).unwrap();
                assert!((after.translation - before.unwrap().translation).norm() < 1e-9);
            }
        }
        Change::Move(k, p) => map.set_pose(KeyframeId(k), pose(p)),
        Change::Refresh(l, k) => {
            map.refresh_landmark(LandmarkId::new(l));
            map.refresh_covisibility(KeyframeId(k), 1);
        }
    }
}

fn observed(map: &Map) -> Model {
    let landmarks = map.view().landmarks().map(|(id, _)| {
        let list = map.observations(id).iter().map(|o| (o.0.0, o.1)).collect();
        (id.number(), list)
    });
    landmarks.collect()
}

proptest! {
    #[test]
    fn random_changes_keep_invariants_and_match_the_model(changes in prop::collection::vec(change(), 1..80)) {
        let mut map = Map::new(8, 1.2);
        let (mut model, mut next) = (Model::new(), 0);
        for c in &changes {
            apply(&mut map, &mut model, &mut next, c);
            prop_assert_eq!(map.check(), Ok(()), "after {:?}", c);
            prop_assert_eq!(&observed(&map), &model, "after {:?}", c);
        }
    }

    #[test]
    fn published_view_never_changes(changes in prop::collection::vec(change(), 2..60), cut in 1usize..40) {
        let mut map = Map::new(8, 1.2);
        let (mut model, mut next) = (Model::new(), 0);
        let cut = cut.min(changes.len() - 1);
        for c in &changes[..cut] {
            apply(&mut map, &mut model, &mut next, c);
        }
        let view = map.publish();
        let before = format!("{view:?}");
        for c in &changes[cut..] {
            apply(&mut map, &mut model, &mut next, c);
        }
        prop_assert_eq!(format!("{view:?}"), before);
        prop_assert!(map.publish().version() > view.version());
    }
}

#[test]
fn landmarks_move_with_their_anchor() {
    let mut map = Map::new(8, 1.2);
    map.insert_keyframe(KeyframeId(0), data(0), pose(0), None);
    let position = Vec3::new(0.3, -0.2, 2.0);
    let new = NewLandmark {
        position,
        observation: (KeyframeId(0), 0),
    };
    let id = map.insert_landmark(&new).unwrap();
    assert!((map.view().landmark_position(id).unwrap() - position).norm() < 1e-12);
    let correction = pose(7);
    map.set_pose(KeyframeId(0), correction * pose(0));
    let moved = map.view().landmark_position(id).unwrap();
    assert!((moved - correction.transform(&position)).norm() < 1e-12);
}

#[test]
fn disowned_features_stay_unmapped() {
    let mut map = Map::new(8, 1.2);
    for k in 0..2u32 {
        let parent = k.checked_sub(1).map(KeyframeId);
        map.insert_keyframe(KeyframeId(k), data(k), pose(k), parent);
    }
    let landmark = |map: &mut Map, k: u32, f: u32| {
        map.insert_landmark(&NewLandmark {
            position: Vec3::new(0.0, 0.0, 2.0),
            observation: (KeyframeId(k), f),
        })
    };
    let made_here = landmark(&mut map, 1, 0).unwrap();
    let made_before = landmark(&mut map, 0, 1).unwrap();
    assert!(map.add_observation(made_before, KeyframeId(1), 1));
    let published = map.publish();

    assert_eq!(map.disown(KeyframeId(1), &[0, 1, 2]), 1);
    map.check().unwrap();
    assert!(map.view().landmark(made_here).is_none());
    assert_eq!(map.observations(made_before), &[(KeyframeId(0), 1)]);
    // The feature can neither create a landmark nor observe an old one.
    assert!(landmark(&mut map, 1, 0).is_none());
    assert!(!map.add_observation(made_before, KeyframeId(1), 2));
    assert!(map.add_observation(made_before, KeyframeId(1), 3));
    // The published view is unchanged.
    let before = published.keyframe(KeyframeId(1)).unwrap();
    assert_eq!(before.matches[0], Some(made_here));
    assert!(before.data.mappable.iter().all(|m| *m));
}
