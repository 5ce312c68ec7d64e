//! Laws that hold for any concurrent changes of the map.

use super::*;
use proptest::prelude::*;

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

/// Changes a map like the mapper does during a correction.
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
                map.merge_landmarks(LandmarkId::new(a), LandmarkId::new(b));
            }
            Change::Forget(l, k) => map.remove_observation(LandmarkId::new(l), KeyframeId(k)),
            Change::CullLandmark(l) => map.cull_landmark(LandmarkId::new(l)),
        }
    }
}

proptest! {
    #[test]
    fn empty_correction_changes_nothing(changes in prop::collection::vec(change(), 0..30)) {
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
    fn invariants_hold_after_any_concurrent_changes(
        changes in prop::collection::vec(change(), 0..30),
        shifts in prop::collection::vec(0..30u32, 1..8),
        merges in prop::collection::vec((0..24u32, 0..24u32), 0..10),
        by in -0.1..0.1,
    ) {
        let mut map = chain(8, 3);
        let base = map.publish();
        let mut c = correction(&base, &shifts);
        c.landmarks = landmark_moves(&base, by);
        c.merges = merges.iter().map(|(a, b)| (LandmarkId::new(*a), LandmarkId::new(*b))).collect();
        evolve(&mut map, &changes);
        map.apply(&c);
        prop_assert_eq!(map.check(), Ok(()));
        for (from, into) in &c.merges {
            let (from, into) = (map.view().resolve_landmark(*from), map.view().resolve_landmark(*into));
            prop_assert!(from == into || from.is_none() || into.is_none());
        }
    }

    /// Correcting before or after other changes gives the same map, up to rounding.
    #[test]
    fn rigid_correction_commutes_with_other_changes(
        parents in prop::collection::vec(0..8u32, 1..8),
        culled in prop::collection::vec(1..8u32, 0..3),
        shift in 0..30u32,
        refined in prop::collection::vec((0..8u32, 0..9u32), 0..4),
    ) {
        // One rigid motion for all commutes with the other changes.
        let mut early = chain(8, 3);
        let mut late = chain(8, 3);
        let c = correction(&early.publish(), &[shift]);
        late.publish();
        early.apply(&c);
        for (map, world) in [(&mut early, pose(shift)), (&mut late, Se3::identity())] {
            for (i, p) in parents.iter().enumerate() {
                let id = KeyframeId(100 + i as u32);
                // Like the mapper: relative to the parent.
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

    /// Descendants of a corrected keyframe keep their pose relative to it.
    #[test]
    fn descendants_follow_their_corrected_keyframe(
        parents in prop::collection::vec(0..8u32, 1..8),
        shifts in prop::collection::vec(1..30u32, 8),
    ) {
        let mut map = chain(8, 2);
        let c = correction(&map.publish(), &shifts);
        for (i, p) in parents.iter().enumerate() {
            extend(&mut map, 100 + i as u32, Some(*p), 2);
        }
        // A chain of two: the parent of the second is not corrected either.
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
