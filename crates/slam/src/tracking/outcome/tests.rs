#![allow(clippy::unwrap_used)] // A failed helper is a failed test.

use super::super::sight::Sight;
use super::super::statistics::Sightings;
use super::*;
use crate::config::Config;
use crate::messages::Exposure;
use crate::recycle::Lists;
use crate::synthetic::{World, at, blocks, camera, data, see_points, wall, wall_camera};
use stillpoint_geometry::Vec3;
use stillpoint_imaging::{DepthImage, Simd};
use stillpoint_map::KeyframeId;

/// Two keyframes 0.3 m apart, and one of another submap.
fn world() -> World {
    let mut world = World::new();
    world.add(0, None, at(0.0, 0.0, 0.0), 0..60);
    world.add(1, Some(0), at(0.3, 0.0, 0.0), 20..80);
    world.add(9, None, at(0.0, 0.0, 0.0), 0..50);
    world
}

fn frame(id: u32) -> RgbdFrame {
    wall(id, |_, _| 0)
}

/// A tracker with a pose at the origin in frame 0, whose clock has frame 1.
fn tracker(world: &mut World) -> Tracker {
    let tracker = Tracker::new(Config::default(), camera(), Simd::detect());
    let mut tracker = tracker.in_map(world.map.publish(), true);
    let place = CapturePose {
        anchored: AnchoredPose::default(),
        camera_from_depth: Se3::identity(),
    };
    for id in 0..2 {
        tracker.pace.next(&frame(id));
        tracker.front_end.clock.take(&frame(id));
        if id == 0 {
            let motion = CameraMotion::default();
            tracker.follow_from(&frame(0), &data(&[]), Vec::new(), &place, motion);
        }
    }
    tracker.beginning.submap = Some(SubmapId(0));
    tracker
}

/// A pose that sees some points of keyframe 1.
fn solution(world: &World) -> Solution {
    let camera = at(0.5, 0.1, 0.0);
    Solution {
        data: data(&see_points(30..50, &camera)),
        camera_from_world: camera.inverse(),
        reference: KeyframeId(1),
        matches: (30..50).map(|n| Some(world.landmarks[&(0, n)])).collect(),
        sightings: Sightings::default(),
        exposure: Exposure::default(),
        followed: Vec::new(),
        recognised: None,
    }
}

fn notes() -> Notes {
    let mut notes = Notes::default();
    notes.counts.inliers = 20;
    notes
}

/// A read-only map, so that no frame becomes a keyframe.
fn without_keyframes(world: &mut World) -> Tracker {
    let mut tracker = tracker(world);
    tracker.map.grows = false;
    tracker
}

fn near(found: Vec3, expected: [f64; 3]) -> bool {
    (found - Vec3::from(expected)).norm() < 1e-9
}

#[test]
fn accepted_pose_is_recorded_relative_to_its_reference() {
    let mut world = world();
    let mut tracker = without_keyframes(&mut world);
    let solution = solution(&world);
    let (seen, matches) = (Arc::clone(&solution.data), solution.matches.clone());
    let ending = tracker.accept(&frame(1), solution, &notes());
    assert_eq!(ending.outcome, Outcome::Tracked);
    assert!(ending.keyframe.is_none());
    let entry = *tracker.trajectory.entries().last().unwrap();
    assert_eq!(
        (entry.frame, entry.inliers, entry.carried),
        (FrameId(1), 20, false)
    );
    let pose = entry.pose;
    assert_eq!((pose.keyframe, pose.reference), (None, KeyframeId(1)));
    assert!(near(
        pose.reference_from_camera.translation,
        [0.2, 0.1, 0.0]
    ));
    assert!(near(
        pose.online_world_from_camera.translation,
        [0.5, 0.1, 0.0]
    ));
    assert_eq!(ending.place.unwrap().anchored, pose);
    // It follows corrections of the map.
    world.map.set_pose(KeyframeId(1), at(1.3, 0.0, 0.0));
    let moved = pose.world_from_camera_in(&world.map.publish()).unwrap();
    assert!(near(moved.translation, [1.5, 0.1, 0.0]));
    let last = tracker.state.tracked().unwrap();
    assert!(Arc::ptr_eq(&last.data, &seen));
    assert_eq!((&last.matches, last.pose), (&matches, pose));
    let velocity = tracker.state.velocity().unwrap();
    assert!(velocity.norm() > 10.0, "{velocity:?}");
}

#[test]
fn relocalisation_names_the_first_lost_frame() {
    let mut world = world();
    let mut tracker = without_keyframes(&mut world);
    assert_eq!(tracker.state.lose(FrameId(1)), FrameId(1));
    assert_eq!(tracker.state.lose(FrameId(2)), FrameId(1));
    let ending = tracker.accept(&frame(3), solution(&world), &notes());
    let (since, with) = (FrameId(1), KeyframeId(1));
    assert_eq!(ending.outcome, Outcome::Relocalised { since, with });
    assert!(tracker.state.lost_since().is_none() && tracker.state.velocity().is_none());
}

#[test]
fn relocalisation_may_change_the_submap() {
    let mut world = world();
    let mut tracker = without_keyframes(&mut world);
    let found = Solution {
        recognised: Some(KeyframeId(9)),
        reference: KeyframeId(9),
        ..solution(&world)
    };
    let ending = tracker.accept(&frame(1), found, &notes());
    let (since, with) = (FrameId(1), KeyframeId(9));
    assert_eq!(ending.outcome, Outcome::Relocalised { since, with });
    assert_eq!(tracker.beginning.submap, Some(SubmapId(9)));
    assert!(tracker.state.velocity().is_none());
}

fn sightings(world: &World) -> Sightings {
    let mut seen = Sightings::new(&mut Lists::default());
    seen.expected(world.landmarks[&(0, 33)], Sight::Through);
    seen.expected(world.landmarks[&(0, 31)], Sight::Open);
    seen
}

#[test]
fn sightings_are_counted_for_accepted_poses() {
    let mut world = world();
    let mut tracker = without_keyframes(&mut world);
    for id in 1..4 {
        let seen = Solution {
            sightings: sightings(&world),
            ..solution(&world)
        };
        tracker.accept(&frame(id), seen, &notes());
    }
    let counted = tracker.keyframes.since.statistics.take();
    let counted: Vec<_> = counted.iter().map(|s| (s.id, s.visible, s.gone)).collect();
    let [gone, there] = [33, 31].map(|n| world.landmarks[&(0, n)]);
    assert_eq!(counted, [(there, 3, 0), (gone, 0, 3)]);
}

#[test]
fn wanted_keyframe_is_built_from_the_solution() {
    let mut world = world();
    let mut tracker = tracker(&mut world);
    tracker.keyframes.wanted = true;
    let seen = Solution {
        sightings: sightings(&world),
        ..solution(&world)
    };
    let (data, matches) = (Arc::clone(&seen.data), seen.matches.clone());
    let ending = tracker.accept(&frame(1), seen, &notes());
    let keyframe = ending.keyframe.unwrap();
    // Ids continue after those of the existing map.
    assert_eq!(keyframe.id, KeyframeId(11));
    assert_eq!(keyframe.reference, Some(KeyframeId(1)));
    assert!(near(
        keyframe.reference_from_camera.translation,
        [0.2, 0.1, 0.0]
    ));
    assert_eq!((keyframe.matches, keyframe.statistics.len()), (matches, 2));
    assert_eq!(keyframe.data.positions, data.positions);
    assert!(
        !Arc::ptr_eq(&keyframe.data, &data),
        "the frame's memory is free again"
    );
    // Statistics restart after a keyframe, and the request is cleared.
    assert!(!tracker.keyframes.wanted);
    assert!(tracker.keyframes.since.statistics.take().is_empty());
    let entry = tracker.trajectory.entries().last().unwrap();
    assert_eq!(entry.pose.keyframe, Some(KeyframeId(11)));
}

#[test]
fn no_keyframe_if_read_only_blocked_or_one_is_pending() {
    let spoil: [fn(&mut Tracker); 3] = [
        |t| t.map.grows = false,
        |t| t.sensors.blind_at = Some(t.front_end.clock.now()),
        |t| {
            t.keyframes.first = Some(NewKeyframe {
                id: KeyframeId(10),
                data: data(&[]),
                reference: None,
                reference_from_camera: Se3::identity(),
                matches: Vec::new(),
                statistics: Vec::new(),
                exposure: Exposure::default(),
            });
        },
    ];
    for (case, spoil) in spoil.iter().enumerate() {
        let mut world = world();
        let mut tracker = tracker(&mut world);
        tracker.keyframes.wanted = true;
        spoil(&mut tracker);
        let ending = tracker.accept(&frame(1), solution(&world), &notes());
        assert!(ending.keyframe.is_none(), "case {case}");
        assert_eq!(ending.outcome, Outcome::Tracked);
        assert!(tracker.keyframes.wanted, "case {case}: it is still wanted");
    }
}

#[test]
fn carried_pose_is_recorded_without_a_keyframe() {
    let mut world = world();
    let mut tracker = tracker(&mut world);
    tracker.keyframes.wanted = true;
    let ending = tracker.accept_carried(&frame(1), solution(&world), FrameId(1));
    let since = FrameId(1);
    assert_eq!(ending.outcome, Outcome::Carried { since });
    assert!(ending.keyframe.is_none() && tracker.keyframes.wanted);
    let entry = tracker.trajectory.entries().last().unwrap();
    assert_eq!((entry.inliers, entry.carried), (0, true));
    assert!(near(
        entry.pose.reference_from_camera.translation,
        [0.2, 0.1, 0.0]
    ));
    assert!(tracker.state.velocity().is_some());
}

/// A frame of a wall from a camera moving sideways, or of a covered lens.
fn shown(id: u32, covered: bool) -> Arc<RgbdFrame> {
    let grey = |x, y| blocks(1, x + 2 * id as usize, y);
    Arc::new(if covered { frame(id) } else { wall(id, grey) })
}

#[test]
fn tracking_initialises_loses_and_relocalises() {
    let mut tracker = Tracker::new(Config::default(), wall_camera(), Simd::detect());
    let mut track = |id, covered| tracker.track(&shown(id, covered));
    let began = track(0, false);
    assert_eq!(began.report.outcome, Outcome::Initialised);
    // The keyframe waits for the next frame, which gives the velocity.
    assert!(began.keyframe.is_none() && !began.report.verdicts.is_empty());
    let next = track(1, false);
    assert_eq!(next.report.outcome, Outcome::Tracked);
    assert_eq!(next.keyframe.map(|k| k.id), Some(KeyframeId(0)));
    for id in 2..4 {
        let lost = track(id, true);
        let (since, reason) = (FrameId(2), LostReason::FewFeatures);
        assert_eq!(lost.report.outcome, Outcome::Lost { since, reason });
        assert!(lost.report.world_from_camera.is_none() && lost.report.submap.is_none());
        assert!(lost.keyframe.is_none() && !lost.report.is_keyframe);
    }
    let found = track(4, false);
    assert!(matches!(found.report.outcome, Outcome::Relocalised { since, .. } if since.0 == 2));
    assert_eq!(found.report.submap, Some(SubmapId(0)));
    let frames = tracker.trajectory.entries().iter().map(|e| e.frame.0);
    assert_eq!(frames.collect::<Vec<_>>(), [0, 1, 4]);
}

#[test]
fn initialisation_needs_features_with_depth() {
    let mut tracker = Tracker::new(Config::default(), wall_camera(), Simd::detect());
    let mut blind = RgbdFrame::clone(&shown(1, false));
    let (w, h) = (blind.depth.width(), blind.depth.height());
    blind.depth = DepthImage::from_vec(w, h, vec![0.0; w * h]).unwrap();
    for (frame, reason) in [
        (shown(0, true), LostReason::FewFeatures),
        (Arc::new(blind), LostReason::FewDepths),
    ] {
        let since = FrameId(0);
        let lost = tracker.track(&frame).report.outcome;
        assert_eq!(lost, Outcome::Lost { since, reason });
    }
    let began = tracker.track(&shown(2, false)).report;
    assert_eq!(began.outcome, Outcome::Initialised);
    assert_eq!(began.submap, Some(SubmapId(2)));
    assert_eq!(began.world_from_camera, Some(Se3::identity()));
}
