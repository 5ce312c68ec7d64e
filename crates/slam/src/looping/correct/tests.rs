//! Effects of an accepted loop on a map.
#![allow(clippy::unwrap_used)] // A failed helper is a failed test.

use super::super::tests::{come_back, ends, knowing};
use crate::messages::LoopCloserMsg;
use crate::report::{LoopOutcome, LoopReport};
use stillpoint_geometry::Se3;
use stillpoint_map::{KeyframeId, Map};

/// A map before and after the loop of its last keyframe is closed.
fn closed(parent: Option<u32>) -> (Map, LoopReport) {
    let mut map = come_back(60, parent);
    let view = map.publish();
    let id = KeyframeId(20);
    let out = knowing(&map).step(LoopCloserMsg::Keyframe { id, view });
    let report = out.report.unwrap();
    assert_eq!(report.outcome, LoopOutcome::Closed, "{report:?}");
    map.apply(&out.correction.unwrap());
    assert_eq!(map.check(), Ok(()));
    (map, report)
}

/// Pose error of the last keyframe, m and rad combined.
fn error(map: &Map) -> f64 {
    let pose = |id| -> Se3 {
        map.view()
            .keyframe(KeyframeId(id))
            .unwrap()
            .world_from_camera
    };
    let (truth, _) = ends();
    (truth.inverse() * pose(0).inverse() * pose(20))
        .log()
        .norm()
}

#[test]
fn loop_correction_aligns_its_ends_and_merges_landmarks() {
    let before = error(&come_back(60, Some(19)));
    let (mut map, report) = closed(Some(19));
    assert!(
        before > 0.05 && error(&map) < 0.005,
        "{before}, {}",
        error(&map)
    );
    assert!(report.merges >= 50 && report.merges <= 60, "{report:?}");
    // Landmarks seen by both are merged.
    map.refresh_covisibility(KeyframeId(20), 15);
    let keyframe = map.view().keyframe(KeyframeId(20)).unwrap();
    let shared = keyframe.covisible.iter().find(|c| c.0 == KeyframeId(0));
    assert!(shared.unwrap().1 >= 50, "{:?}", keyframe.covisible);
}

#[test]
fn joined_submap_adopts_the_older_reference_frame() {
    let (map, report) = closed(None);
    let join = report.joined.unwrap();
    assert_eq!((join.submap.0, join.into.0), (20, 0));
    assert!(error(&map) < 0.005, "{}", error(&map));
    let submaps = map.view().submaps();
    assert_eq!(submaps.len(), 1, "{submaps:?}");
}
