//! Single corrections with known results.

use super::*;
use stillpoint_geometry::Mat6;
use stillpoint_map::LoopEdge;

#[test]
fn correction_composes_with_later_refinement() {
    let mut map = chain(3, 2);
    let c = correction(&map.publish(), &[5, 6, 7]);
    let refined = pose(1) * Se3::exp(&Vec6::new(0.01, 0.0, 0.0, 0.0, 0.0, 0.002));
    map.set_pose(KeyframeId(1), refined);
    let applied = map.apply(&c);
    assert_eq!((applied.poses, applied.composed), (3, 1));
    assert!(distance(&at(&map, 1), &(pose(6) * refined)) < 1e-9);
    // Control: neither the correction nor the refinement alone.
    assert!(distance(&at(&map, 1), &c.poses[1].after) > 5e-3);
    assert!(distance(&at(&map, 1), &refined) > 5e-3);
    assert_eq!(at(&map, 0), c.poses[0].after);
}

#[test]
fn landmarks_move_relative_to_the_anchor_at_base_version() {
    let mut map = chain(3, 2);
    let base = map.publish();
    let mut c = correction(&base, &[5]);
    c.landmarks = landmark_moves(&base, 0.05);
    let of = |map: &Map, l: u32| {
        map.view()
            .landmark(LandmarkId::new(l))
            .unwrap()
            .position_in_anchor
    };
    // Landmark 0 is observed by keyframes 0 and 1: it gets another anchor; 1 is refined, 2 is unchanged.
    map.remove_observation(LandmarkId::new(0), KeyframeId(0));
    map.landmark_mut(LandmarkId::new(1))
        .unwrap()
        .position_in_anchor += Vec3::new(0.0, 0.01, 0.0);
    let before = [0, 1, 2].map(|l| of(&map, l));
    let applied = map.apply(&c);
    assert_eq!(applied.landmarks as usize, c.landmarks.len() - 1);
    let step = Vec3::new(0.05, 0.0, -0.05);
    assert_eq!(of(&map, 0), before[0]);
    assert!((of(&map, 1) - before[1] - step).norm() < 1e-12);
    assert_eq!(of(&map, 2), c.landmarks[2].after);
}

#[test]
fn merges_follow_later_merges_and_culling() {
    let mut map = chain(6, 2);
    map.publish();
    let l = LandmarkId::new;
    let c = Correction {
        merges: vec![(l(8), l(0)), (l(9), l(1)), (l(10), l(2)), (l(4), l(4))],
        ..Correction::default()
    };
    // Meanwhile 0 became 3, and 9 was culled.
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

#[test]
fn loop_edges_survive_moved_or_culled_keyframes() {
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
    // Invalid measurements are not stored: self loops, unknown keyframes, invalid motions.
    map.apply(&measured(edge(3, 3)));
    map.apply(&measured(edge(0, 77)));
    let mut broken = edge(1, 5);
    broken.old_from_new.translation.x = f64::NAN;
    map.apply(&measured(broken));
    map.set_pose(KeyframeId(4), pose(9));
    assert!(map.cull_keyframe(KeyframeId(4)));
    assert!(map.view().loops().eq([&edge(0, 4)]));
    assert_eq!(map.check(), Ok(()));
    // Appending renumbers keyframes.
    let mut other = chain(3, 2);
    let added = other.append(&map).unwrap();
    assert!(other.view().loops().eq([&LoopEdge {
        old: KeyframeId(added),
        new: KeyframeId(added + 4),
        ..edge(0, 4)
    }]));
    assert_eq!(other.check(), Ok(()));
}
