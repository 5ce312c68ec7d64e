//! The map follows corrected poses.

use crate::room::{Run, config, dense, run};
use std::sync::{Arc, OnceLock};
use stillpoint_dense::{Dense, DenseConfig, DenseMap, FinalPose, Fuser, MeshOptions, Occupancy};
use stillpoint_geometry::{Se3, Vec3};
use stillpoint_imaging::{FrameId, Simd};
use stillpoint_map::{Map, MapView};
use stillpoint_slam::{CorrectionReport, Event, FrameEvent, MapShift, Segments, Subscriber};

const FRAMES: usize = 36;

fn desk() -> &'static Run {
    static RUN: OnceLock<Run> = OnceLock::new();
    RUN.get_or_init(|| {
        let mut run = run("xyz", FRAMES);
        // Without the reduced weights of the first second, and without movers.
        for event in &mut run.events {
            if let Event::Frame(frame) = event {
                let mut settled = FrameEvent::clone(frame);
                settled.report.undecided = None;
                settled.report.segments = Segments::default();
                *frame = Arc::new(settled);
            }
        }
        run
    })
}

fn fed(config: &DenseConfig) -> Dense {
    let mut dense = dense(desk(), config);
    dense.receive_all(&desk().events);
    dense
}

/// The pose of a frame at the time of its depth.
fn at_depth(poses: &[FinalPose], i: usize) -> Se3 {
    let stamp = desk().simulator.depth_stamp(i);
    let own = &poses[i];
    let Some(next) = poses.get(i + 1) else {
        return own.world_from_camera;
    };
    let share = (stamp - own.stamp) / (next.stamp - own.stamp);
    own.world_from_camera
        .interpolate(&next.world_from_camera, share)
}

#[test]
fn final_map_equals_integration_at_the_final_poses() {
    let dense = fed(&config());
    let taken: Vec<FrameId> = dense.taken().to_vec();
    assert_eq!(desk().poses.len(), FRAMES);
    assert!(taken.len() >= FRAMES / 2 - 1, "{taken:?}");
    let found = dense.finish(&desk().poses);
    let room = &desk().simulator;
    let mut fresh = Fuser::new(&config(), room.camera(), Simd::Scalar).unwrap();
    for frame in &taken {
        let i = frame.0 as usize;
        fresh.add(&room.frame_with_colour(i), &[], &at_depth(&desk().poses, i));
    }
    assert_eq!(found.digest(), fresh.map().digest());
    assert_eq!(found.to_bytes(), fresh.map().to_bytes());
    assert!(found.mesh(&MeshOptions::default()).area() > 1.0);
    // Control: another order gives another result.
    let mut other = Fuser::new(&config(), room.camera(), Simd::detect()).unwrap();
    for frame in taken.iter().rev() {
        let i = frame.0 as usize;
        other.add(&room.frame_with_colour(i), &[], &at_depth(&desk().poses, i));
    }
    assert_ne!(found.digest(), other.map().digest());
}

/// In a live run the events of other stages may arrive in any order.
#[test]
fn order_of_independent_events_does_not_matter() {
    let whole = fed(&config());
    // All map versions as early as possible.
    let mut early = dense(desk(), &config());
    let (views, frames): (Vec<&Event>, Vec<&Event>) =
        desk().events.iter().partition(|e| e.view().is_some());
    assert!(views.len() >= 2);
    views
        .into_iter()
        .chain(frames)
        .for_each(|e| early.receive(e));
    assert_eq!(early.map().digest(), whole.map().digest());
    assert_eq!(early.counts(), whole.counts());
}

#[test]
fn only_named_frames_are_taken() {
    let only = [2, 9, 30].map(FrameId);
    let mut dense = dense(desk(), &config()).with_frames(only);
    dense.receive_all(&desk().events);
    assert_eq!(dense.taken(), only);
}

#[test]
fn missing_images_are_counted() {
    let mut dense = dense(desk(), &config());
    for event in &desk().events {
        let bare = event.as_frame().map(|f| {
            Event::Frame(Arc::new(FrameEvent {
                frame: f.frame.clone().filter(|_| f.report.frame.0 % 8 == 0),
                ..f.clone()
            }))
        });
        dense.receive(bare.as_ref().unwrap_or(event));
    }
    let counts = dense.counts();
    assert!(
        counts.integrated < FRAMES / 4 && counts.without_image > 10,
        "{counts:?}"
    );
}

/// The map of a run, shifted, with a version newer than all those of the run.
fn shifted(by: f64, later: u64) -> Arc<MapView> {
    let views = desk().events.iter().filter_map(Event::view);
    let last = views.max_by_key(|v| v.version()).unwrap();
    let mut map = Map::new(5, 1.45);
    for k in last.keyframes() {
        let mut pose = k.world_from_camera;
        pose.translation.x += by;
        map.insert_keyframe(k.id, Arc::clone(&k.data), pose, k.parent);
    }
    let mut view = map.publish();
    while view.version() < last.version() + later {
        view = map.publish();
    }
    view
}

/// Applies a correction, with as many frames without an image as it takes.
fn correct(dense: &mut Dense, view: &Arc<MapView>) -> usize {
    let report = CorrectionReport {
        map_version: view.version(),
        base_version: 0,
        keyframes: 1,
        composed: 0,
        propagated: 0,
        merged: 0,
        moved: MapShift::default(),
    };
    let view = Arc::clone(view);
    let version = view.version();
    dense.receive(&Event::Corrected { report, view });
    let mut frames = desk().events.iter().filter_map(Event::as_frame);
    let mut last = frames.next_back().unwrap().clone();
    last.frame = None;
    last.report.map_version = version;
    last.report.is_keyframe = false;
    let before = dense.counts().rebuilt;
    let mut events = 0;
    while dense.counts().rebuilt == before && events < 100 {
        dense.receive(&Event::Frame(Arc::new(last.clone())));
        events += 1;
    }
    events
}

fn centre(map: &DenseMap) -> Vec3 {
    let mesh = map.mesh(&MeshOptions::default());
    let all = (0..mesh.positions.len() as u32).map(|i| mesh.position(i));
    all.sum::<Vec3>() / mesh.positions.len() as f64
}

#[test]
fn correction_is_applied_a_few_frames_per_event() {
    let mut dense = fed(&config());
    let before = centre(dense.map());
    // Less than half a voxel: no rebuild.
    assert_eq!(correct(&mut dense, &shifted(0.015, 1)), 100);
    assert_eq!(centre(dense.map()), before);
    // Twelve voxels: the mesh is the same, moved.
    let events = correct(&mut dense, &shifted(0.48, 2));
    let kept = dense.counts().kept;
    assert_eq!(events, kept.div_ceil(config().rebuild_per_event));
    let moved = centre(dense.map()) - before;
    assert!((moved.x - 0.48).abs() < 0.02, "{moved:?}");
    // Equal to fusing there from the beginning.
    let again = correct(&mut dense, &shifted(0.48, 3));
    assert_eq!(again, 100);
    let digest = dense.map().digest();
    correct(&mut dense, &shifted(0.0, 4));
    assert_ne!(dense.map().digest(), digest);
    correct(&mut dense, &shifted(0.48, 5));
    assert_eq!(dense.map().digest(), digest);
}

#[test]
fn frames_beyond_the_memory_budget_are_not_moved() {
    let one = fed(&config()).counts().kept_bytes / fed(&config()).counts().kept;
    let small = DenseConfig {
        depth_budget: 6 * one,
        ..config()
    };
    let mut dense = fed(&small);
    let counts = dense.counts();
    assert!(counts.given_up > 5 && counts.kept + counts.given_up == counts.integrated);
    assert!(counts.kept_bytes <= small.depth_budget, "{counts:?}");
    let whole = fed(&config());
    assert!(dense.bytes() - dense.map().bytes() < whole.bytes());
    // Frames without depth are in the final map too, and did not move.
    correct(&mut dense, &shifted(0.5, 6));
    let (both, all) = (dense.map().blocks(), whole.map().blocks());
    assert!(
        both > all + all / 4,
        "{both} blocks where one surface has {all}"
    );
    let end = fed(&small).finish(&desk().poses);
    let whole = whole.finish(&desk().poses);
    assert!((centre(&end) - centre(&whole)).norm() < 0.02);
    assert_ne!(end.digest(), whole.digest());
    let again = fed(&small).finish(&desk().poses);
    assert_eq!(end.digest(), again.digest());
}

#[test]
fn frames_without_a_final_pose_are_dropped() {
    let some: Vec<FinalPose> = desk()
        .poses
        .iter()
        .filter(|p| p.frame.0 < 9)
        .copied()
        .collect();
    let few = fed(&config()).finish(&some);
    let all = fed(&config()).finish(&desk().poses);
    assert!(few.blocks() > 20 && few.digest() != all.digest());
    assert_eq!(fed(&config()).finish(&[]).blocks(), 0);
}

#[test]
fn run_continues_an_existing_surface() {
    let first = fed(&config()).finish(&desk().poses);
    let blocks = first.blocks();
    let again = dense(desk(), &config()).starting_with(first);
    assert_eq!(again.finish(&[]).blocks(), blocks);
}

#[test]
fn space_before_a_surface_is_free_and_behind_unknown() {
    let map = fed(&config()).finish(&desk().poses);
    let mesh = map.mesh(&MeshOptions::default());
    let eye = desk().poses[0].world_from_camera.translation;
    let mut counts = [0; 4];
    for i in 0..mesh.positions.len() as u32 {
        let p = mesh.position(i);
        // Where the surface is extrapolated, the grid is unknown.
        if map.distance(&p).is_none() {
            continue;
        }
        let ray = (p - eye).normalize();
        counts[0] += 1;
        counts[1] += usize::from(map.occupancy(&p) == Occupancy::Occupied);
        counts[2] += usize::from(map.occupancy(&(eye + ray * 0.5)) == Occupancy::Free);
        counts[3] += usize::from(map.occupancy(&(p + ray * 0.6)) == Occupancy::Free);
    }
    let [all, on, before, behind] = counts;
    assert!(
        all > 100 && 20 * on >= 19 * all && 10 * before >= 8 * all,
        "{counts:?}"
    );
    assert!(4 * behind < all, "{counts:?}");
    assert_eq!(
        map.occupancy(&Vec3::new(f64::NAN, 0.0, 0.0)),
        Occupancy::Unknown
    );
    assert_eq!(map.occupancy(&Vec3::repeat(500.0)), Occupancy::Unknown);
}
