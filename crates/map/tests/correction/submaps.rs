//! Joining submaps.

use super::*;
use stillpoint_map::{Join, SubmapId};

/// Two submaps, which begin at keyframes 0 and 10.
fn two_submaps() -> Map {
    let mut map = chain(4, 3);
    extend(&mut map, 10, None, 3);
    extend(&mut map, 11, Some(10), 3);
    map
}

#[test]
fn joining_submaps_includes_later_additions() {
    let mut map = two_submaps();
    assert_eq!(map.view().submaps(), [(SubmapId(0), 4), (SubmapId(10), 2)]);
    let first = |k: u32, map: &Map| map.view().keyframe(KeyframeId(k)).unwrap().matches[0].unwrap();
    let merges = vec![(first(10, &map), first(2, &map))];
    // Without a join, landmarks of two submaps are not merged.
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
    // Keyframe 11 is a tombstone on 10, which is a child of 2.
    let parent = |k: u32| map.view().keyframe(KeyframeId(k)).unwrap().parent;
    assert_eq!(parent(10), Some(KeyframeId(2)));
    assert_eq!(parent(12), Some(KeyframeId(10)));
    assert_eq!(map.check(), Ok(()));
}

#[test]
fn joined_submap_tree_is_rerooted_at_the_join() {
    let mut map = chain(2, 2);
    for (k, parent) in [(10, None), (11, Some(10)), (12, Some(11)), (13, Some(11))] {
        extend(&mut map, k, parent, 2);
    }
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
fn appended_map_becomes_further_submaps() {
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
        let moved = LandmarkId::new(id.number() + landmarks as u32);
        let there = map.view().landmark(moved).unwrap();
        assert_eq!(there.created_at.0, l.created_at.0 + added);
        assert_eq!(
            map.view().landmark_position(moved),
            other.view().landmark_position(id)
        );
    }
    let e = map.append(&Map::new(4, 1.5)).unwrap_err();
    assert!(e.to_string().contains("the same pyramid"), "{e}");
    assert_eq!(map.check(), Ok(()));
}
