#![allow(clippy::unwrap_used)] // A failed helper is a failed test.

use super::*;
use crate::synthetic::{World, at, camera, data, point, see_points};
use std::collections::BTreeMap;

/// Level sigmas as in the front end.
const SIGMAS: [f32; 8] = [1.0, 1.2, 1.44, 1.728, 2.074, 2.488, 2.986, 3.583];
const AREA: SearchArea<'_> = SearchArea {
    bounds: [0.0, 0.0, 639.0, 479.0],
    level_scales: &SIGMAS,
    radius_px: LOCAL_RADIUS,
};

/// Three keyframes in a row, each sharing points with the next, and a distant one.
fn world() -> World {
    let mut world = World::new();
    world.add(0, None, at(0.0, 0.0, 0.0), 0..40);
    world.add(1, Some(0), at(0.1, 0.0, 0.0), 30..70);
    world.add(2, Some(1), at(0.2, 0.0, 0.0), 60..100);
    world.add(3, Some(2), at(5.0, 0.0, 0.0), 95..110);
    world
}

/// Matches of `features` features, the first of which match these points.
fn matches(world: &World, features: usize, numbers: impl Iterator<Item = usize>) -> Matches {
    let mut matches = Matches::new(features);
    for (slot, number) in matches.targets.iter_mut().zip(numbers) {
        let mut known = Matches::new(1);
        known.assign_point(0, point(number));
        *slot = known.targets[0];
        if let Some(target) = slot {
            target.landmark = Some(world.landmarks[&(0, number)]);
        }
        matches.count += 1;
    }
    matches
}

fn chosen(local: &LocalMap) -> Vec<u32> {
    local.keyframes.iter().map(|k| k.0).collect()
}

#[test]
fn reference_shares_most_landmarks_with_the_frame() {
    let mut world = world();
    let view = world.map.publish();
    let mut local = LocalMap::default();
    // 5 of keyframe 0, 25 of keyframe 1 alone, none of keyframe 2, which is a neighbour of keyframe 1. Keyframe 3 is a
    // neighbour of neither.
    let seen = matches(&world, 60, 35..60);
    let reference = local.update(&view, KeyframeId(0), &seen);
    assert_eq!(reference, KeyframeId(1));
    assert_eq!(chosen(&local), [0, 1, 2]);
    // Each landmark appears once, although several keyframes see it.
    let mut ids: Vec<LandmarkId> = local.entries.iter().map(|e| e.id).collect();
    assert_eq!(ids.len(), 100);
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), 100);
    for e in &local.entries {
        let known = view.landmark_position(e.id).unwrap();
        assert_eq!(e.position, known);
    }
}

#[test]
fn without_matches_the_reference_has_a_fallback() {
    let mut world = world();
    let view = world.map.publish();
    let mut local = LocalMap::default();
    let reference = local.update(&view, KeyframeId(2), &Matches::new(10));
    assert_eq!(reference, KeyframeId(3), "of equals the newest");
    let mut alone = World::new();
    alone.add(0, None, at(0.0, 0.0, 0.0), 0..40);
    let view = alone.map.publish();
    let reference = local.update(&view, KeyframeId(0), &Matches::new(10));
    assert_eq!((reference, chosen(&local)), (KeyframeId(0), vec![0]));
    // A missing keyframe adds nothing.
    let reference = local.update(&view, KeyframeId(9), &Matches::new(10));
    assert_eq!((reference, local.entries.len()), (KeyframeId(9), 0));
}

#[test]
fn newer_map_view_updates_landmark_positions() {
    let mut world = world();
    let view = world.map.publish();
    let mut local = LocalMap::default();
    let seen = matches(&world, 60, 35..60);
    local.update(&view, KeyframeId(1), &seen);
    let id = local.entries[0].id;
    let before = local.entries[0].position;
    world
        .map
        .set_position(id, before + Vec3::new(0.0, 0.0, 0.5));
    let view = world.map.publish();
    local.update(&view, KeyframeId(1), &seen);
    let entry = local.entries.iter().find(|e| e.id == id).unwrap();
    assert!((entry.position.z - before.z - 0.5).abs() < 1e-9);
}

#[test]
fn nearby_keyframes_share_submap_and_view_direction() {
    let mut world = World::new();
    let mut turned = at(0.0, 0.0, 0.0);
    turned.rotation = stillpoint_geometry::so3::exp(&Vec3::new(0.0, 1.2, 0.0));
    world.add(0, None, at(0.0, 0.0, 0.0), 0..20);
    world.add(1, Some(0), at(1.4, 0.0, 0.0), 10..30);
    world.add(2, Some(0), at(1.6, 0.0, 0.0), 10..30);
    world.add(3, Some(0), turned, 0..20);
    world.add(7, None, at(0.0, 0.0, 0.0), 0..20);
    let view = world.map.publish();
    let mut local = LocalMap::default();
    let camera_from_world = at(0.0, 0.0, 0.0).inverse();
    local.update_around(&view, Some(SubmapId(0)), &camera_from_world);
    assert_eq!(chosen(&local), [0, 1]);
    assert_eq!(local.entries.len(), 30);
    local.update_around(&view, Some(SubmapId(7)), &camera_from_world);
    assert_eq!((chosen(&local), local.entries.len()), (vec![7], 20));
    local.update_around(&view, None, &camera_from_world);
    assert_eq!((chosen(&local), local.entries.len()), (vec![], 0));
}

/// A local map of a keyframe at the origin with `count` points.
fn local(count: usize) -> (World, LocalMap) {
    let mut world = World::new();
    world.add(0, None, at(0.0, 0.0, 0.0), 0..count);
    let view = world.map.publish();
    let mut local = LocalMap::default();
    local.update(&view, KeyframeId(0), &Matches::new(0));
    (world, local)
}

#[test]
fn landmarks_match_near_projections_others_are_tested() {
    let (world, mut local) = local(60);
    // Points 0 to 9 are matched already, 50 to 59 have no feature.
    let camera = at(0.05, 0.02, -0.1);
    let seen = data(&see_points(0..50, &camera));
    let mut found = matches(&world, 50, 0..10);
    let mut noted: BTreeMap<LandmarkId, Sight> = BTreeMap::new();
    let pose = camera.inverse();
    let rough = at(0.004, 0.0, 0.0) * pose;
    let sight = |p: &Vec3| {
        if p.x > 0.0 {
            Sight::Through
        } else {
            Sight::Hidden
        }
    };
    let search = local.search(&seen, &rough, &AREA, &mut found, sight, |id, s| {
        assert!(noted.insert(id, s).is_none(), "{id:?} is noted twice");
    });
    assert_eq!((search.visible, noted.len()), (60, 60));
    assert_eq!((found.count, found.landmarks()), (50, 50));
    for (number, target) in found.targets.iter().enumerate() {
        let expected = world.landmarks[&(0, number)];
        assert_eq!(target.unwrap().landmark, Some(expected), "{number}");
    }
    for number in 0..60 {
        let expected = match (number < 50, rough.transform(&point(number)).x > 0.0) {
            (true, _) => Sight::Open,
            (false, true) => Sight::Through,
            (false, false) => Sight::Hidden,
        };
        assert_eq!(noted[&world.landmarks[&(0, number)]], expected, "{number}");
    }
}

#[test]
fn wrong_pose_matches_nothing_and_tests_every_landmark() {
    let (_, mut local) = local(60);
    let camera = at(0.0, 0.0, 0.0);
    let seen = data(&see_points(0..60, &camera));
    let mut found = Matches::new(60);
    // 20 px at 2.5 m, outside windows of 5 px.
    let off = at(0.1, 0.0, 0.0);
    let mut looked = 0;
    let search = local.search(
        &seen,
        &off,
        &AREA,
        &mut found,
        |_| Sight::Through,
        |_, s| {
            looked += u32::from(s == Sight::Through);
        },
    );
    assert!(found.count <= 2, "{}", found.count);
    assert_eq!(looked, search.visible - found.count as u32);
}

/// Landmarks observed at level 0, from 2 to 3 m away.
#[test]
fn unrecognisable_landmarks_are_not_expected() {
    let (_, mut local) = local(60);
    let mut visible = |world_from_camera: Se3| {
        let nothing = data(&[]);
        let mut found = Matches::new(0);
        let pose = world_from_camera.inverse();
        let search = local.search(
            &nothing,
            &pose,
            &AREA,
            &mut found,
            |_| Sight::Open,
            |_, _| (),
        );
        search.visible
    };
    let turned = |place: Se3, angle: f64| {
        let mut pose = place;
        pose.rotation = stillpoint_geometry::so3::exp(&Vec3::new(0.0, angle, 0.0));
        pose
    };
    assert_eq!(visible(at(0.0, 0.0, 0.0)), 60);
    // On the finest level they are searched up to 1.2 times the distance.
    assert_eq!(visible(at(0.0, 0.0, -0.4)), 60);
    assert_eq!(visible(at(0.0, 0.0, -2.0)), 0);
    // Behind the camera, and outside the image.
    assert_eq!(visible(at(0.0, 0.0, 4.0)), 0);
    assert_eq!(visible(turned(at(0.0, 0.0, 0.0), 1.5)), 0);
    // From 40 and from 80 degrees aside.
    let aside = |degrees: f64| {
        let angle = degrees.to_radians();
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        turned(at(-2.5 * sin, 0.0, 2.5 - 2.5 * cos), angle)
    };
    assert!(visible(aside(40.0)) > 40);
    assert!(visible(aside(80.0)) < 10);
    assert_eq!(camera().width, 640);
}
