//! Corrections of a map that has changed since.

use proptest::prelude::*;
use std::sync::Arc;
use stillpoint_features::{Descriptor, FeatureGrid, Keypoint};
use stillpoint_geometry::{Camera, Mat6, Se3, Vec3, Vec6};
use stillpoint_map::{
    Correction, Join, KeyframeData, KeyframeId, LandmarkCorrection, LandmarkId, LoopEdge, Map,
    MapView, NewLandmark, PoseCorrection, SubmapId,
};

const FEATURES: usize = 8;

fn data(id: u32) -> Arc<KeyframeData> {
    let positions: Vec<[f32; 2]> = (0..FEATURES)
        .map(|i| [20.0 * i as f32 + 30.0, 50.0])
        .collect();
    let levels = [0; FEATURES];
    let keypoint = |p: &[f32; 2]| Keypoint {
        x: p[0],
        y: p[1],
        level: 0,
        angle: 0.0,
        response: 1.0,
    };
    Arc::new(KeyframeData {
        stamp: f64::from(id),
        camera: Camera::pinhole(640, 480, [500.0, 500.0, 320.0, 240.0]),
        keypoints: positions.iter().map(keypoint).collect(),
        sigma_px: vec![1.0; FEATURES],
        depths: vec![2.0; FEATURES],
        depth_sigmas: vec![0.01; FEATURES],
        descriptors: (0..FEATURES as u64)
            .map(|i| Descriptor([i, u64::from(id), 0, 0]))
            .collect(),
        mappable: vec![true; FEATURES],
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
        -0.03 * s,
    ))
}

/// A chain of keyframes, each the parent of the next; `landmarks` of each, the first also seen by the next one.
fn chain(keyframes: u32, landmarks: u32) -> Map {
    let mut map = Map::new(8, 1.2);
    for k in 0..keyframes {
        extend(&mut map, k, k.checked_sub(1), landmarks);
    }
    map
}

fn extend(map: &mut Map, k: u32, parent: Option<u32>, landmarks: u32) {
    let parent = parent.map(KeyframeId);
    assert!(map.insert_keyframe(KeyframeId(k), data(k), pose(k), parent));
    for f in 0..landmarks {
        let position = pose(k).transform(&Vec3::new(0.1 * f64::from(f), 0.2, 2.0));
        let new = NewLandmark {
            position,
            observation: (KeyframeId(k), f),
        };
        map.insert_landmark(&new).unwrap();
    }
    if let Some(p) = parent {
        let first = map.view().keyframe(p).and_then(|p| p.matches[0]);
        if let Some(l) = first {
            map.add_observation(l, KeyframeId(k), FEATURES as u32 - 1);
        }
    }
}

/// A correction that moves the live keyframes of a view, each by its own small motion.
fn correction(view: &MapView, shifts: &[u32]) -> Correction {
    let poses = view.keyframes().zip(shifts.iter().cycle());
    Correction {
        base_version: view.version(),
        poses: poses
            .map(|(k, s)| PoseCorrection {
                keyframe: k.id,
                before: k.world_from_camera,
                after: pose(*s) * k.world_from_camera,
            })
            .collect(),
        ..Correction::default()
    }
}

fn at(map: &Map, k: u32) -> Se3 {
    map.view().world_from_keyframe(KeyframeId(k)).unwrap()
}

fn distance(a: &Se3, b: &Se3) -> f64 {
    (a.inverse() * *b).log().norm()
}

#[derive(Clone, Debug)]
enum Change {
    Keyframe(u32),
    Move(u32, u32),
    Cull(u32),
    Merge(u32, u32),
    Forget(u32, u32),
    CullLandmark(u32),
}

fn change() -> impl Strategy<Value = Change> {
    prop_oneof![
        4 => (0..12u32).prop_map(Change::Keyframe),
        3 => (0..12u32, 0..30u32).prop_map(|(k, s)| Change::Move(k, s)),
        2 => (1..12u32).prop_map(Change::Cull),
        2 => (0..20u32, 0..20u32).prop_map(|(a, b)| Change::Merge(a, b)),
        1 => (0..20u32, 0..12u32).prop_map(|(l, k)| Change::Forget(l, k)),
        1 => (0..20u32).prop_map(Change::CullLandmark),
    ]
}

/// Changes a map as the mapper does while somebody works on an older version.
fn evolve(map: &mut Map, changes: &[Change]) {
    let mut next = 100;
    for c in changes {
        match *c {
            Change::Keyframe(p) => {
                if let Some(p) = map.view().resolve_keyframe(KeyframeId(p)) {
                    extend(map, next, Some(p.0), 2);
                    next += 1;
                }
            }
            Change::Move(k, s) => {
                if let Some(k) = map.view().keyframe(KeyframeId(k)) {
                    let (id, moved) = (k.id, pose(s) * k.world_from_camera);
                    map.set_pose(id, moved);
                }
            }
            Change::Cull(k) => {
                map.cull_keyframe(KeyframeId(k));
            }
            Change::Merge(a, b) => {
                map.merge_landmarks(LandmarkId(a), LandmarkId(b));
            }
            Change::Forget(l, k) => map.remove_observation(LandmarkId(l), KeyframeId(k)),
            Change::CullLandmark(l) => map.cull_landmark(LandmarkId(l)),
        }
    }
}

fn landmark_moves(view: &MapView, by: f64) -> Vec<LandmarkCorrection> {
    let of = |(id, l): (LandmarkId, &stillpoint_map::Landmark)| LandmarkCorrection {
        landmark: id,
        anchor: l.anchor,
        before: l.position_in_anchor,
        after: l.position_in_anchor + Vec3::new(by, 0.0, -by),
    };
    view.landmarks().map(of).collect()
}

proptest! {
    #[test]
    fn what_changes_nothing_changes_nothing(changes in prop::collection::vec(change(), 0..30)) {
        let mut map = chain(8, 3);
        let base = map.publish();
        let mut nothing = correction(&base, &[0]);
        for p in &mut nothing.poses {
            p.after = p.before;
        }
        nothing.landmarks = landmark_moves(&base, 0.0);
        evolve(&mut map, &changes);
        let before = format!("{:?}", map.view());
        let applied = map.apply(&nothing);
        prop_assert_eq!(format!("{:?}", map.view()), before);
        prop_assert_eq!(applied.merged, 0);
    }

    #[test]
    fn invariants_hold_whatever_happened_since(
        changes in prop::collection::vec(change(), 0..30),
        shifts in prop::collection::vec(0..30u32, 1..8),
        merges in prop::collection::vec((0..24u32, 0..24u32), 0..10),
        by in -0.1..0.1,
    ) {
        let mut map = chain(8, 3);
        let base = map.publish();
        let mut c = correction(&base, &shifts);
        c.landmarks = landmark_moves(&base, by);
        c.merges = merges.iter().map(|(a, b)| (LandmarkId(*a), LandmarkId(*b))).collect();
        evolve(&mut map, &changes);
        map.apply(&c);
        prop_assert_eq!(map.check(), Ok(()));
        for (from, into) in &c.merges {
            let (from, into) = (map.view().resolve_landmark(*from), map.view().resolve_landmark(*into));
            prop_assert!(from == into || from.is_none() || into.is_none());
        }
    }

    /// Correct, then go on, or go on, then correct: the same map, up to rounding.
    #[test]
    fn it_does_not_matter_when_it_arrives(
        parents in prop::collection::vec(0..8u32, 1..8),
        culled in prop::collection::vec(1..8u32, 0..3),
        shift in 0..30u32,
        refined in prop::collection::vec((0..8u32, 0..9u32), 0..4),
    ) {
        // One rigid motion for all, under which whatever happens between is the same seen from elsewhere.
        let mut early = chain(8, 3);
        let mut late = chain(8, 3);
        let c = correction(&early.publish(), &[shift]);
        late.publish();
        early.apply(&c);
        for (map, world) in [(&mut early, pose(shift)), (&mut late, Se3::identity())] {
            for (i, p) in parents.iter().enumerate() {
                let id = KeyframeId(100 + i as u32);
                // As the mapper does: relative to the parent, wherever that is.
                let at = map.view().world_from_keyframe(KeyframeId(*p)).unwrap() * pose(3);
                let parent = map.view().resolve_keyframe(KeyframeId(*p));
                prop_assert!(map.insert_keyframe(id, data(id.0), at, parent));
            }
            for (k, s) in &refined {
                let at = pose(*k) * pose(*s);
                map.set_pose(KeyframeId(*k), world * at);
            }
            for k in &culled {
                map.cull_keyframe(KeyframeId(*k));
            }
        }
        late.apply(&c);
        for k in (0..8).chain(100..100 + parents.len() as u32) {
            prop_assert!(distance(&at(&early, k), &at(&late, k)) < 1e-9, "keyframe {}", k);
        }
        for (id, _) in early.view().landmarks() {
            let (a, b) = (early.view().landmark_position(id), late.view().landmark_position(id));
            prop_assert!((a.unwrap() - b.unwrap()).norm() < 1e-9);
        }
        prop_assert_eq!(late.check(), Ok(()));
    }

    /// What hangs on a corrected keyframe keeps its pose relative to it.
    #[test]
    fn what_was_not_seen_moves_along(
        parents in prop::collection::vec(0..8u32, 1..8),
        shifts in prop::collection::vec(1..30u32, 8),
    ) {
        let mut map = chain(8, 2);
        let c = correction(&map.publish(), &shifts);
        for (i, p) in parents.iter().enumerate() {
            extend(&mut map, 100 + i as u32, Some(*p), 2);
        }
        // A tail of two: the second hangs on one that was not seen either.
        extend(&mut map, 200, Some(100), 2);
        let before = map.publish();
        let applied = map.apply(&c);
        prop_assert_eq!(applied.propagated as usize, parents.len() + 1);
        prop_assert_eq!(applied.composed, 0);
        let relative = |view: &MapView, a: u32, b: u32| {
            let pose = |k| view.world_from_keyframe(KeyframeId(k)).unwrap();
            pose(a).inverse() * pose(b)
        };
        for (i, p) in parents.iter().enumerate() {
            let k = 100 + i as u32;
            prop_assert!(distance(&relative(&before, *p, k), &relative(map.view(), *p, k)) < 1e-9);
        }
        prop_assert!(distance(&relative(&before, 100, 200), &relative(map.view(), 100, 200)) < 1e-9);
        for p in &c.poses {
            prop_assert_eq!(at(&map, p.keyframe.0), p.after);
        }
    }
}

#[test]
fn a_pose_refined_since_is_not_overwritten() {
    let mut map = chain(3, 2);
    let c = correction(&map.publish(), &[5, 6, 7]);
    let refined = pose(1) * Se3::exp(&Vec6::new(0.01, 0.0, 0.0, 0.0, 0.0, 0.002));
    map.set_pose(KeyframeId(1), refined);
    let applied = map.apply(&c);
    assert_eq!((applied.poses, applied.composed), (3, 1));
    assert!(distance(&at(&map, 1), &(pose(6) * refined)) < 1e-9);
    // Control: that is neither what the correction said nor what the mapper did.
    assert!(distance(&at(&map, 1), &c.poses[1].after) > 5e-3);
    assert!(distance(&at(&map, 1), &refined) > 5e-3);
    assert_eq!(at(&map, 0), c.poses[0].after);
}

#[test]
fn landmarks_move_relative_to_the_anchor_that_was_seen() {
    let mut map = chain(3, 2);
    let base = map.publish();
    let mut c = correction(&base, &[5]);
    c.landmarks = landmark_moves(&base, 0.05);
    let of = |map: &Map, l: u32| {
        map.view()
            .landmark(LandmarkId(l))
            .unwrap()
            .position_in_anchor
    };
    // Landmark 0 is seen by keyframes 0 and 1: it gets another anchor; 1 is refined, 2 is left alone.
    map.remove_observation(LandmarkId(0), KeyframeId(0));
    map.landmark_mut(LandmarkId(1)).unwrap().position_in_anchor += Vec3::new(0.0, 0.01, 0.0);
    let before = [0, 1, 2].map(|l| of(&map, l));
    let applied = map.apply(&c);
    assert_eq!(applied.landmarks as usize, c.landmarks.len() - 1);
    let step = Vec3::new(0.05, 0.0, -0.05);
    assert_eq!(of(&map, 0), before[0]);
    assert!((of(&map, 1) - before[1] - step).norm() < 1e-12);
    assert_eq!(of(&map, 2), c.landmarks[2].after);
}

#[test]
fn merges_follow_what_became_of_the_landmarks() {
    let mut map = chain(6, 2);
    map.publish();
    let l = LandmarkId;
    let c = Correction {
        merges: vec![(l(8), l(0)), (l(9), l(1)), (l(10), l(2)), (l(4), l(4))],
        ..Correction::default()
    };
    // Meanwhile 0 became 3, and 9 is gone.
    assert!(map.merge_landmarks(l(0), l(3)));
    map.cull_landmark(l(9));
    let applied = map.apply(&c);
    map.check().unwrap();
    assert_eq!(applied.merged, 2);
    assert_eq!(map.view().resolve_landmark(l(8)), Some(l(3)));
    assert_eq!(map.view().resolve_landmark(l(1)), Some(l(1)));
    assert_eq!(map.view().resolve_landmark(l(10)), Some(l(2)));
    assert_eq!(map.view().resolve_landmark(l(4)), Some(l(4)));
    assert!(applied.touched.contains(&KeyframeId(4)));
    assert!(!applied.touched.contains(&KeyframeId(0)));
}

/// A map of two submaps, which begin at keyframes 0 and 10.
fn two_submaps() -> Map {
    let mut map = chain(4, 3);
    extend(&mut map, 10, None, 3);
    extend(&mut map, 11, Some(10), 3);
    map
}

#[test]
fn submaps_become_one_with_all_that_was_added_since() {
    let mut map = two_submaps();
    assert_eq!(map.view().submaps(), [(SubmapId(0), 4), (SubmapId(10), 2)]);
    let first = |k: u32, map: &Map| map.view().keyframe(KeyframeId(k)).unwrap().matches[0].unwrap();
    let merges = vec![(first(10, &map), first(2, &map))];
    // Without a join, what is of two submaps stays two things.
    let apart = Correction {
        base_version: map.view().version(),
        merges: merges.clone(),
        ..Correction::default()
    };
    assert_eq!(map.apply(&apart).merged, 0);
    let moved = |k: &u32| PoseCorrection {
        keyframe: KeyframeId(*k),
        before: at(&map, *k),
        after: pose(40) * at(&map, *k),
    };
    let join = Correction {
        poses: [10, 11].iter().map(moved).collect(),
        join: Some(Join {
            submap: SubmapId(10),
            into: SubmapId(0),
            child: KeyframeId(11),
            parent: KeyframeId(2),
            shift: pose(40),
        }),
        ..apart
    };
    extend(&mut map, 12, Some(11), 3);
    map.cull_keyframe(KeyframeId(11));
    let before: Vec<Se3> = [2, 10, 11, 12].map(|k| at(&map, k)).to_vec();
    let applied = map.apply(&join);
    assert_eq!((applied.merged, applied.propagated), (1, 1));
    assert_eq!(map.view().submaps(), [(SubmapId(0), 6)]);
    assert_eq!(map.view().submap_of(KeyframeId(11)), Some(SubmapId(0)));
    assert_eq!(at(&map, 2), before[0]);
    for (k, before) in [10, 11, 12].into_iter().zip(&before[1..]) {
        assert!(distance(&at(&map, k), &(pose(40) * *before)) < 1e-9, "{k}");
    }
    // Keyframe 11 is a tombstone on 10 by now, which hangs on 2.
    let parent = |k: u32| map.view().keyframe(KeyframeId(k)).unwrap().parent;
    assert_eq!(parent(10), Some(KeyframeId(2)));
    assert_eq!(parent(12), Some(KeyframeId(10)));
    assert_eq!(map.check(), Ok(()));
}

#[test]
fn what_was_measured_stays_when_its_keyframes_move_or_go() {
    let mut map = chain(6, 2);
    let edge = |old: u32, new: u32| LoopEdge {
        old: KeyframeId(old),
        new: KeyframeId(new),
        old_from_new: pose(old + 3),
        information: Mat6::identity() * 40.0,
        inliers: 40,
    };
    let measured = |edge| Correction {
        measured: Some(Box::new(edge)),
        ..Correction::default()
    };
    map.apply(&measured(edge(0, 4)));
    // What cannot have been measured is not kept: with itself, with nothing, with a motion that is none.
    map.apply(&measured(edge(3, 3)));
    map.apply(&measured(edge(0, 77)));
    let mut broken = edge(1, 5);
    broken.old_from_new.translation.x = f64::NAN;
    map.apply(&measured(broken));
    map.set_pose(KeyframeId(4), pose(9));
    assert!(map.cull_keyframe(KeyframeId(4)));
    assert!(map.view().loops().eq([&edge(0, 4)]));
    assert_eq!(map.check(), Ok(()));
    // In another map their keyframes have other ids.
    let mut other = chain(3, 2);
    let added = other.append(&map).unwrap();
    assert!(other.view().loops().eq([&LoopEdge {
        old: KeyframeId(added),
        new: KeyframeId(added + 4),
        ..edge(0, 4)
    }]));
    assert_eq!(other.check(), Ok(()));
}

#[test]
fn the_tree_of_a_submap_turns_round_where_it_is_joined() {
    let mut map = chain(2, 2);
    for (k, parent) in [(10, None), (11, Some(10)), (12, Some(11)), (13, Some(11))] {
        extend(&mut map, k, parent, 2);
    }
    // Nothing is named: what the correction does not reach comes along all the same.
    let before = at(&map, 13);
    map.apply(&Correction {
        base_version: map.view().version(),
        join: Some(Join {
            submap: SubmapId(10),
            into: SubmapId(0),
            child: KeyframeId(12),
            parent: KeyframeId(1),
            shift: pose(7),
        }),
        ..Correction::default()
    });
    let parents: Vec<Option<u32>> = [0, 1, 10, 11, 12, 13]
        .map(|k| {
            map.view()
                .keyframe(KeyframeId(k))
                .unwrap()
                .parent
                .map(|p| p.0)
        })
        .to_vec();
    let expected = [None, Some(0), Some(11), Some(12), Some(1), Some(11)];
    assert_eq!(parents, expected);
    assert!(distance(&at(&map, 13), &(pose(7) * before)) < 1e-9);
    assert_eq!(map.check(), Ok(()));
}

#[test]
fn another_map_comes_as_further_submaps() {
    let (mut map, other) = (chain(4, 3), two_submaps());
    let (own, landmarks) = (map.view().keyframe_count(), map.view().landmark_count());
    let added = map.append(&other).unwrap();
    assert_eq!(added, 4);
    let submaps = [(SubmapId(0), own), (SubmapId(4), 4), (SubmapId(14), 2)];
    assert_eq!(map.view().submaps(), submaps);
    assert_eq!(
        map.view().landmark_count(),
        landmarks + other.view().landmark_count()
    );
    assert_eq!(map.check(), Ok(()));
    for (id, l) in other.view().landmarks() {
        let moved = LandmarkId(id.0 + landmarks as u32);
        let there = map.view().landmark(moved).unwrap();
        assert_eq!(there.created_at.0, l.created_at.0 + added);
        assert_eq!(
            map.view().landmark_position(moved),
            other.view().landmark_position(id)
        );
    }
    let e = map.append(&Map::new(4, 1.5)).unwrap_err();
    assert!(e.to_string().contains("features.levels"), "{e}");
    assert_eq!(map.check(), Ok(()));
}
