//! The loop closer on small maps.
#![allow(clippy::unwrap_used)] // A failed helper is a failed test.

use super::*;
use crate::config::Config;
use stillpoint_estimation::{Purpose, rng};
use stillpoint_features::{Descriptor, Edge, FeatureGrid, Keypoint};
use stillpoint_geometry::{Camera, Mat6, Se3, Vec3, Vec6};
use stillpoint_map::{KeyframeData, Map, NewLandmark};

/// A map of keyframes that share no landmarks.
pub(super) fn map(keyframes: u32) -> Map {
    let mut map = Map::new(5, 1.45);
    for k in 0..keyframes {
        let data = crate::synthetic::blank_keyframe(f64::from(k));
        let parent = k.checked_sub(1).map(KeyframeId);
        map.insert_keyframe(KeyframeId(k), Arc::new(data), Se3::identity(), parent);
    }
    map
}

fn camera() -> Camera {
    Camera::pinhole(640, 480, [500.0, 500.0, 320.0, 240.0])
}

/// 96 points some 2 m ahead.
pub(super) fn things() -> Vec<Vec3> {
    let thing = |i: usize| {
        let (x, y) = ((i % 12) as f64, (i / 12) as f64);
        Vec3::new(0.13 * x - 0.7, 0.13 * y - 0.45, 1.8 + 0.1 * ((x * y) % 5.0))
    };
    (0..96).map(thing).collect()
}

/// Keyframe data of a camera observing numbered points; each number has its own descriptor.
pub(super) fn sight(world_from_camera: &Se3, seen: &[(u64, Vec3)]) -> KeyframeData {
    let camera = camera();
    let pixel = |p: &Vec3| [500.0 * p.x / p.z + 320.0, 500.0 * p.y / p.z + 240.0];
    let points: Vec<Vec3> = seen
        .iter()
        .map(|(_, p)| world_from_camera.inverse().transform(p))
        .collect();
    let positions: Vec<[f32; 2]> = points.iter().map(|p| pixel(p).map(|v| v as f32)).collect();
    let descriptor = |number: u64| {
        let mut random = rng(3, number, Purpose(1002));
        let mut word = || (random.unit() * 4_294_967_296.0) as u64;
        Descriptor(std::array::from_fn(|_| (word() << 32) | word()))
    };
    let bounds = KeyframeData::grid_bounds(&camera);
    let keypoint = |p: &[f32; 2]| Keypoint {
        x: p[0],
        y: p[1],
        level: 2,
        angle: 0.0,
        response: 50.0,
        edge: Edge::default(),
    };
    KeyframeData {
        stamp: 0.0,
        camera,
        keypoints: positions.iter().map(keypoint).collect(),
        sigma_px: vec![1.44; seen.len()],
        depths: points.iter().map(|p| p.z as f32).collect(),
        depth_sigmas: vec![0.01; seen.len()],
        descriptors: Arc::new(seen.iter().map(|(n, _)| descriptor(*n)).collect()),
        mappable: vec![true; seen.len()],
        grid: FeatureGrid::build(&positions, &vec![2; seen.len()], bounds),
        positions,
    }
}

/// Adds a keyframe at its estimated pose, with a landmark for each observed point.
pub(super) fn add(
    map: &mut Map,
    (id, parent): (u32, Option<u32>),
    believed: Se3,
    data: KeyframeData,
) {
    let (data, id) = (Arc::new(data), KeyframeId(id));
    map.insert_keyframe(id, Arc::clone(&data), believed, parent.map(KeyframeId));
    for feature in 0..data.len() {
        map.insert_landmark(&NewLandmark {
            position: believed.transform(&data.point_in_camera(feature).unwrap()),
            observation: (id, feature as u32),
        });
    }
    map.refresh_covisibility(id, 15);
}

/// Final camera pose of [`come_back`]: (true, estimated).
pub(super) fn ends() -> (Se3, Se3) {
    let truth = Se3::exp(&Vec6::new(0.15, -0.05, 0.1, 0.02, -0.04, 0.01));
    let drift = Se3::exp(&Vec6::new(0.06, 0.02, -0.03, 0.0, 0.01, 0.0));
    (truth, drift * truth)
}

/// A map whose first keyframe sees all points, whose next ones see others, and whose last one, 20, sees `again` of the
/// first and others. It shares no landmarks with them; it is a child of `parent` or starts a submap.
pub(super) fn come_back(again: usize, parent: Option<u32>) -> Map {
    let mut map = Map::new(5, 1.45);
    let all: Vec<(u64, Vec3)> = (0..).zip(things()).collect();
    add(
        &mut map,
        (0, None),
        Se3::identity(),
        sight(&Se3::identity(), &all),
    );
    let other =
        |k: u64| -> Vec<(u64, Vec3)> { all.iter().map(|(n, p)| (n + 1000 * k, *p)).collect() };
    for k in 1..20 {
        let seen = sight(&Se3::identity(), &other(u64::from(k)));
        add(&mut map, (k, Some(k - 1)), Se3::identity(), seen);
    }
    let (truth, believed) = ends();
    let mut seen = other(20);
    for i in 0..again {
        let at = i * seen.len() / again.max(1);
        seen[at] = all[at];
    }
    add(&mut map, (20, parent), believed, sight(&truth, &seen));
    map
}

/// A loop closer that knows the keyframes of a map.
pub(super) fn knowing(map: &Map) -> LoopCloser {
    let mut loop_closer = LoopCloser::new(&Config::default());
    loop_closer.step(LoopCloserMsg::Known {
        view: Arc::new(map.view().clone()),
    });
    loop_closer
}

fn shown(mut map: Map) -> (Map, LoopCloserOut) {
    let view = map.publish();
    let out = knowing(&map).step(LoopCloserMsg::Keyframe {
        id: KeyframeId(20),
        view,
    });
    (map, out)
}

#[test]
fn submaps_join_if_enough_landmarks_are_matched() {
    let (mut map, out) = shown(come_back(40, None));
    let report = out.report.unwrap();
    assert_eq!(report.outcome, LoopOutcome::Closed, "{report:?}");
    assert!(report.joined.is_some() && report.evidence.unwrap().place == 0.0);
    map.apply(&out.correction.unwrap());
    assert_eq!(map.view().submaps().len(), 1);
    // Control: one object that appears in two places, with a twelfth of the expected landmarks.
    let (_, out) = shown(come_back(13, None));
    let report = out.report.unwrap();
    assert!(report.edge.is_some() && report.inliers >= 10, "{report:?}");
    assert_eq!(report.outcome, LoopOutcome::TooLittle, "{report:?}");
    assert!(out.correction.is_none());
}

#[test]
fn expected_position_compensates_for_few_landmarks() {
    // The same thirteen, but the map expects them within 7 cm.
    let (_, out) = shown(come_back(13, Some(0)));
    let report = out.report.unwrap();
    assert_eq!(report.outcome, LoopOutcome::Closed, "{report:?}");
    assert!(report.evidence.unwrap().place > 2.0, "{report:?}");
}

#[test]
fn identical_place_at_a_distant_position_is_rejected() {
    let mut map = come_back(96, Some(19));
    // 12 m from the expected position, with a path uncertainty of 40 cm.
    let (_, believed) = ends();
    for k in 1..=20 {
        let gone = Se3::new(Default::default(), Vec3::new(0.6 * f64::from(k), 0.0, 0.0));
        let pose = if k == 20 { gone * believed } else { gone };
        map.set_pose(KeyframeId(k), pose);
    }
    let (_, out) = shown(map);
    let report = out.report.unwrap();
    assert_eq!(report.outcome, LoopOutcome::Elsewhere, "{report:?}");
    let evidence = report.evidence.unwrap();
    assert!(
        evidence.landmarks > 5.0 && report.inliers > 80,
        "{report:?}"
    );
}

/// A precise loop edge.
fn edge(old: u32, new: u32) -> LoopEdge {
    LoopEdge {
        old: KeyframeId(old),
        new: KeyframeId(new),
        old_from_new: Se3::identity(),
        information: Mat6::identity() * 1e8,
        inliers: 40,
    }
}

#[test]
fn closed_loops_reduce_drift_until_revoked() {
    let mut map = map(12);
    let view = map.publish();
    let mut loop_closer = LoopCloser::new(&Config::default());
    let between = |loop_closer: &LoopCloser| {
        let mut look = Look {
            view: &view,
            keyframe: view.keyframe(KeyframeId(11)).unwrap(),
            drifts: BTreeMap::new(),
        };
        loop_closer
            .drift(&mut look, SubmapId(0))
            .between(2, 8)
            .unwrap()[(0, 0)]
    };
    // Six ties of 5 cm each.
    let open = between(&loop_closer);
    assert!((open - 6.0 * 0.0025).abs() < 1e-9, "{open}");
    loop_closer.edges.push(edge(2, 8));
    assert!(between(&loop_closer) < 1e-4);
    loop_closer.step(LoopCloserMsg::Revoked {
        first: KeyframeId(7),
        last: KeyframeId(9),
        view: Arc::clone(&view),
    });
    assert!((between(&loop_closer) - open).abs() < 1e-9);
}

#[test]
fn closed_loop_edge_is_stored() {
    let mut map = come_back(60, Some(19));
    let view = map.publish();
    let mut loop_closer = knowing(&map);
    let keyframe = view.keyframe(KeyframeId(20)).unwrap();
    let out = loop_closer.step(LoopCloserMsg::Keyframe {
        id: keyframe.id,
        view: Arc::clone(&view),
    });
    let report = out.report.unwrap();
    assert_eq!(report.outcome, LoopOutcome::Closed, "{report:?}");
    let ends: Vec<_> = loop_closer.edges.iter().map(|e| (e.old, e.new)).collect();
    assert_eq!(ends, [(KeyframeId(0), KeyframeId(20))]);
}

#[test]
fn view_older_than_the_last_correction_is_outdated() {
    let mut map = map(30);
    let mut loop_closer = LoopCloser::new(&Config::default());
    let view = map.publish();
    assert!(loop_closer.is_up_to_date(&view));
    loop_closer.valid_from = None;
    assert!(!loop_closer.is_up_to_date(&view));
    let map_version = view.version() + 1;
    loop_closer.step(LoopCloserMsg::Corrected { map_version });
    assert!(!loop_closer.is_up_to_date(&view));
    assert!(loop_closer.is_up_to_date(&map.publish()));
}

#[test]
fn loops_are_at_least_ten_keyframes_apart() {
    let mut map = map(30);
    let mut loop_closer = LoopCloser::new(&Config::default());
    let view = map.publish();
    assert!(!loop_closer.is_too_soon(&view, KeyframeId(29)));
    loop_closer.last_closed = Some(KeyframeId(5));
    assert!(loop_closer.is_too_soon(&view, KeyframeId(14)));
    assert!(!loop_closer.is_too_soon(&view, KeyframeId(15)));
}
