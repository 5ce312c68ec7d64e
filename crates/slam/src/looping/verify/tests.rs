//! Motions between keyframes with and without common points.
#![allow(clippy::unwrap_used)] // A failed helper is a failed test.

use super::super::begun;
use super::super::recognise::Candidate;
use super::super::tests::{come_back, ends, knowing};
use super::*;

/// Verifies the last keyframe of a map that sees `again` points of the first.
fn verified(again: usize, by: By) -> (Result<Verified, LoopOutcome>, LoopReport) {
    let map = come_back(again, Some(19));
    let keyframe = |id| map.view().keyframe(KeyframeId(id)).unwrap();
    let candidate = Candidate {
        with: KeyframeId(0),
        score: 0.0,
        rival: 0.0,
        by,
    };
    let mut report = begun(KeyframeId(20), &candidate);
    let loop_closer = knowing(&map);
    let found = loop_closer.verify(map.view(), keyframe(20), keyframe(0), by, &mut report);
    (found, report)
}

#[test]
fn verification_recovers_the_relative_pose() {
    let (truth, _) = ends();
    for by in [By::Words, By::Pose] {
        let (found, report) = verified(60, by);
        let off = found.unwrap().new_from_old * truth;
        assert!(off.log().norm() < 0.01, "{by:?}: {off:?}");
        assert!(report.inliers >= 50 && report.inliers <= 60, "{report:?}");
        // All points of the older keyframe are expected in view.
        assert!(report.expected >= 90 && report.expected <= 96, "{report:?}");
        let edge = report.edge.unwrap();
        assert!((truth.inverse() * edge).log().norm() < 0.01, "{edge:?}");
    }
}

#[test]
fn too_few_common_points_give_no_rigid_motion() {
    let (found, report) = verified(14, By::Words);
    assert!(
        found.is_ok() && report.inliers >= MIN_INLIERS as u32,
        "{report:?}"
    );
    let (found, report) = verified(8, By::Words);
    assert_eq!(found.err(), Some(LoopOutcome::NoRigidMotion), "{report:?}");
    assert!(report.edge.is_none());
    let (found, _) = verified(0, By::Pose);
    assert_eq!(found.err(), Some(LoopOutcome::NoRigidMotion));
}
