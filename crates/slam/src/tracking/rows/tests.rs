#![allow(clippy::unwrap_used)] // A failed helper is a failed test.

use super::super::flow::tests::second_frame;
use super::super::statistics::Sightings;
use super::*;
use crate::anchored_pose::AnchoredPose;
use crate::config::Config;
use crate::messages::Exposure;
use crate::synthetic::{at, blocks, data, see_points, wall};
use std::sync::Arc;
use stillpoint_geometry::Se3;
use stillpoint_map::KeyframeId;

#[test]
fn rows_use_static_features_with_depth() {
    let shown = |id| wall(id, |x, y| blocks(1, x, y));
    let (mut tracker, data) = second_frame(shown(0), shown(1), &Config::default());
    let (pairs, _) = tracker.flow(&data, &Se3::identity());
    let found = pairs.iter().flatten().count();
    let motion = EgoMotion {
        pairs,
        ..EgoMotion::unknown(Arc::clone(&data))
    };
    let mut verdicts: Vec<FeatureVerdict> = data
        .keypoints
        .iter()
        .map(|k| FeatureVerdict::kept([k.x, k.y]))
        .collect();
    let rows = |verdicts: &[FeatureVerdict], motion: &EgoMotion| {
        let mut rows = Vec::new();
        tracker.followed(motion, verdicts, &mut rows);
        rows.len()
    };
    assert_eq!(rows(&verdicts, &motion), found);
    let pairs = motion.pairs.iter().enumerate();
    let first: Vec<usize> = pairs
        .filter(|p| p.1.is_some())
        .map(|p| p.0)
        .take(7)
        .collect();
    for i in &first[..5] {
        verdicts[*i].dynamic = true;
    }
    assert_eq!(rows(&verdicts, &motion), found - 5);
    let mut holes = data.copied();
    for i in &first {
        holes.depths[*i] = 0.0;
    }
    let motion = EgoMotion {
        data: Arc::new(holes),
        ..motion
    };
    assert_eq!(rows(&verdicts, &motion), found - 7);
}

#[test]
fn without_flow_rows_use_common_landmarks() {
    let id = LandmarkId::new;
    let camera = at(0.0, 0.0, 0.0);
    let last = LastFrame {
        stamp: 0.0,
        time: 0.0,
        data: data(&see_points(0..4, &camera)),
        matches: vec![Some(id(5)), None, Some(id(7)), Some(id(8))],
        pose: AnchoredPose::default(),
        world_from_camera: camera,
    };
    let mut now = data(&see_points([2, 9, 0, 3], &camera)).copied();
    now.depths[3] = 0.0;
    let solution = Solution {
        data: Arc::new(now),
        camera_from_world: camera,
        reference: KeyframeId(0),
        matches: vec![Some(id(7)), Some(id(9)), Some(id(5)), Some(id(8))],
        sightings: Sightings::default(),
        exposure: Exposure::default(),
        followed: Vec::new(),
        recognised: None,
    };
    let rows = seen_twice(&last, &solution);
    assert_eq!(rows.len(), 2);
    // The same points from the same pose.
    for (row, number) in rows.iter().zip([2, 0]) {
        let seen = see_points([number], &camera)[0];
        let [x, y] = seen.pixel.map(f64::from);
        assert!((row.now.0 - Vec2::new(x, y)).norm() < 1e-3);
        assert_eq!((row.now, row.z), (row.before, f64::from(seen.depth)));
        assert!((row.now.1 - y).abs() < 1e-9);
    }
}
