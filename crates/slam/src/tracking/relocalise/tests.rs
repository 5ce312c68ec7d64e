#![allow(clippy::unwrap_used)] // A failed helper is a failed test.

use super::super::motion::CameraMotion;
use super::super::state::State;
use super::*;
use crate::anchored_pose::AnchoredPose;
use crate::config::Config;
use crate::messages::Exposure;
use crate::synthetic::{World, at, blocks, camera, data, point, see, see_points, wall};
use stillpoint_geometry::{Se3, Vec3, so3};
use stillpoint_imaging::{FrameId, Simd};
use stillpoint_map::SubmapId;

/// A tracker in a map, and a frame without features.
fn tracker(world: &mut World) -> (Tracker, RgbdFrame) {
    let tracker = Tracker::new(Config::default(), camera(), Simd::detect());
    (
        tracker.in_map(world.map.publish(), true),
        wall(40, |_, _| 0),
    )
}

/// A keyframe with 100 points, and another with others.
fn world() -> World {
    let mut world = World::new();
    world.add(0, None, at(0.0, 0.0, 0.0), 0..100);
    world.add(1, Some(0), at(0.3, 0.0, 0.0), 100..200);
    world
}

/// A camera pose different from the keyframe's.
fn elsewhere() -> Se3 {
    let mut pose = at(0.4, -0.2, -0.3);
    pose.rotation = so3::exp(&Vec3::new(0.05, -0.15, 0.1));
    pose
}

#[test]
fn pose_is_found_despite_wrong_matches() {
    let mut world = world();
    let (tracker, frame) = tracker(&mut world);
    let view = Arc::clone(&tracker.map.view);
    let keyframe = view.keyframe(KeyframeId(0)).unwrap();
    let camera = elsewhere();
    // 40 of the features look like points that are elsewhere.
    let mut seen = see_points(0..60, &camera);
    seen.extend((60..100).map(|n| see(&point(n + 500), n, &camera)));
    let found = tracker.find_at(&frame, &data(&seen), keyframe).unwrap();
    let off = found.camera_from_world * camera;
    assert!(
        off.translation.norm() < 5e-3 && off.rotation.angle() < 2e-3,
        "{off:?}"
    );
    assert!(!found.follows);
    assert!(
        (55..=62).contains(&found.matches.count),
        "{}",
        found.matches.count
    );
    for (number, target) in found.matches.targets.iter().enumerate().take(60) {
        let landmark = target.and_then(|t| t.landmark);
        assert!(landmark.is_none_or(|l| l == world.landmarks[&(0, number)]));
    }
}

#[test]
fn no_pose_without_similar_or_consistent_features() {
    let mut world = world();
    let (tracker, frame) = tracker(&mut world);
    let view = Arc::clone(&tracker.map.view);
    let keyframe = view.keyframe(KeyframeId(0)).unwrap();
    let strange = data(&see_points(300..400, &elsewhere()));
    assert!(tracker.find_at(&frame, &strange, keyframe).is_none());
    // Each looks like a point of the keyframe but is at another one's position.
    let seen: Vec<_> = (0..100)
        .map(|n| see(&point(n + 500), n, &elsewhere()))
        .collect();
    let found = tracker.find_at(&frame, &data(&seen), keyframe);
    assert!(found.is_none_or(|f| f.matches.count < 20));
}

#[test]
fn only_similar_keyframes_in_the_view_are_recognised() {
    let mut world = world();
    let (mut tracker, _) = tracker(&mut world);
    let seen = data(&see_points(0..100, &elsewhere()));
    assert!(tracker.recognise(&seen).is_empty(), "the index is empty");
    let view = Arc::clone(&tracker.map.view);
    let places = &mut tracker.map.places;
    for k in view.keyframes() {
        let vector = places
            .vocabulary
            .vector_of(&k.data.descriptors, |i| k.data.mappable[i]);
        places.index.insert(k.id, Arc::new(vector));
    }
    // A keyframe that the loop closer knows and this view does not.
    let vector = places.vocabulary.vector_of(&seen.descriptors, |_| true);
    places.index.insert(KeyframeId(30), Arc::new(vector));
    assert_eq!(tracker.recognise(&seen).first(), Some(&KeyframeId(0)));
    assert!(!tracker.recognise(&seen).contains(&KeyframeId(30)));
    let other = data(&see_points(100..200, &elsewhere()));
    assert_eq!(tracker.recognise(&other).first(), Some(&KeyframeId(1)));
}

fn last(x: f64) -> LastFrame {
    let pose = at(x, 0.0, 0.0);
    LastFrame {
        stamp: 0.9,
        time: 0.9,
        data: data(&[]),
        matches: Vec::new(),
        pose: AnchoredPose {
            keyframe: None,
            reference: KeyframeId(0),
            reference_from_camera: pose,
            online_world_from_camera: pose,
        },
        world_from_camera: pose,
    }
}

fn lose(tracker: &mut Tracker) {
    let motion = CameraMotion::default();
    let last = last(0.0);
    tracker.state = State::Tracking { last, motion };
    tracker.state.lose(FrameId(30));
    tracker.beginning.submap = Some(SubmapId(0));
}

fn solution(x: f64) -> Solution {
    Solution {
        data: data(&[]),
        camera_from_world: at(x, 0.0, 0.0).inverse(),
        reference: KeyframeId(0),
        matches: Vec::new(),
        sightings: Default::default(),
        exposure: Exposure::default(),
        followed: Vec::new(),
        recognised: None,
    }
}

fn notes(inliers: u32, visible: u32) -> Notes {
    let mut notes = Notes::default();
    (notes.counts.inliers, notes.counts.local_visible) = (inliers, visible);
    notes
}

#[test]
fn pose_needs_a_reachable_position_and_enough_inliers() {
    let mut world = world();
    world.add(9, None, at(0.0, 0.0, 0.0), 0..50);
    let (mut tracker, _) = tracker(&mut world);
    let view = Arc::clone(&tracker.map.view);
    let own = view.keyframe(KeyframeId(0)).unwrap();
    let other = view.keyframe(KeyframeId(9)).unwrap();
    // Without a last pose: 50 inliers, and a tenth of the visible landmarks.
    for (inliers, visible, fine) in [
        (50, 500, true),
        (49, 100, false),
        (50, 501, false),
        (500, 0, true),
    ] {
        let believed = tracker.is_plausible(0.0, own, &solution(50.0), &notes(inliers, visible));
        assert_eq!(believed, fine, "{inliers} of {visible}");
    }
    lose(&mut tracker);
    // Half a metre at once and 3 m/s, for a second: then it may be anywhere, and in another submap.
    for (seconds, moved, keyframe, fine) in [
        (0.0, 0.45, own, true),
        (0.0, 0.55, own, false),
        (0.5, 1.9, own, true),
        (0.5, 2.1, own, false),
        (1.0, 100.0, own, true),
        (0.99, 0.0, other, false),
        (1.0, 0.0, other, true),
    ] {
        let stamp = 0.9 + seconds + 1e-9;
        let enough = notes(100, 200);
        let believed = tracker.is_plausible(stamp, keyframe, &solution(moved), &enough);
        assert_eq!(believed, fine, "{moved} m after {seconds} s");
        let few = notes(49, 200);
        assert!(!tracker.is_plausible(stamp, keyframe, &solution(moved), &few));
    }
}

#[test]
fn new_submap_is_due_after_a_second_of_usable_frames() {
    let mut world = world();
    let (mut tracker, frame) = tracker(&mut world);
    tracker.pace.next(&frame);
    lose(&mut tracker);
    let enough = MIN_INITIAL_POINTS as u32;
    let shows = |tracker: &mut Tracker, stamp: f64, with_depth: u32| {
        let mut notes = Notes::default();
        notes.counts.with_depth = with_depth;
        tracker.is_submap_due(stamp, &notes)
    };
    // A covered lens does not count.
    for _ in 0..100 {
        assert!(!shows(&mut tracker, 5.0, enough - 1));
    }
    for _ in 0..29 {
        assert!(!shows(&mut tracker, 5.0, enough));
    }
    assert!(shows(&mut tracker, 5.0, enough));
    // With other submaps, half a second more is given to recognise them.
    assert!(shows(&mut tracker, 1.0, enough));
    world.add(9, None, at(0.0, 0.0, 0.0), 0..50);
    tracker.map.view = world.map.publish();
    assert!(!shows(&mut tracker, 0.9 + 1.49, enough));
    assert!(shows(&mut tracker, 0.9 + 1.51, enough));
    // A read-only map gets no submap.
    tracker.map.grows = false;
    assert!(!shows(&mut tracker, 5.0, enough));
}

/// Builds a map of a wall; a camera started in that map is relocalised at this wall and not at another.
#[test]
fn camera_relocalises_only_at_the_known_wall() {
    use crate::report::Outcome;
    use crate::stages::MapUse;
    use crate::synthetic::{aside, wall_camera};
    use crate::system::System;
    let start = || System::new(Config::default(), wall_camera(), Simd::detect()).unwrap();
    let mut made = start();
    for id in 0..8 {
        made.step(wall(id, |x, y| blocks(1, x + 2 * id as usize, y)));
    }
    made.finish();
    let bytes = made.map().to_bytes(&[]).unwrap();
    let switched_on_at = |paint: u64| {
        let map = stillpoint_map::Map::from_bytes(&bytes).unwrap();
        let mut system = start().with_map(map, MapUse::Localize).unwrap();
        let events = system.step(wall(0, |x, y| blocks(paint, x + 9, y)));
        let frame = events.iter().find_map(|e| e.as_frame()).unwrap();
        (frame.report.outcome, frame.report.world_from_camera)
    };
    let (outcome, pose) = switched_on_at(1);
    assert!(matches!(outcome, Outcome::Relocalised { since, .. } if since.0 == 0));
    let off = pose.unwrap().translation - Vec3::new(aside(9.0), 0.0, 0.0);
    assert!(off.norm() < 5e-3, "{off:?}");
    let (outcome, pose) = switched_on_at(2);
    assert!(matches!(outcome, Outcome::Lost { .. }), "{outcome:?}");
    assert!(pose.is_none());
}
