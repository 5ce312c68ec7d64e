//! Drift of paths.
#![allow(clippy::unwrap_used)] // A failed helper is a failed test.

use super::super::tests::map;
use super::*;
use stillpoint_geometry::Vec6;
use stillpoint_map::{KeyframeId, SubmapId};

/// An identity loop edge with these standard deviations, m and rad.
fn edge(old: u32, new: u32, [metres, radians]: [f64; 2]) -> LoopEdge {
    let (t, r) = (1.0 / (metres * metres), 1.0 / (radians * radians));
    LoopEdge {
        old: KeyframeId(old),
        new: KeyframeId(new),
        old_from_new: Se3::identity(),
        information: Mat6::from_diagonal(&Vec6::new(t, t, t, r, r, r)),
        inliers: 40,
    }
}

#[test]
fn drift_covariance_grows_with_the_number_of_ties() {
    let map = map(12);
    let nodes = || Nodes::new(map.view(), SubmapId(0), SubmapId(0));
    let drift = Drift::new(map.view(), nodes(), &[]);
    let one = drift.between(3, 4).unwrap();
    // Nothing is shared, as after bridged frames.
    assert!((one[(0, 0)].sqrt() - 0.05).abs() < 1e-9, "{one}");
    let six = drift.between(2, 8).unwrap();
    assert!((six - one * 6.0).amax() < 1e-12, "{six}");
    assert_eq!(drift.between(8, 2).unwrap(), six);
    assert_eq!(drift.between(5, 5), Some(Mat6::zeros()));
    let closed = Drift::new(map.view(), nodes(), &[edge(2, 8, [1e-4, 1e-4])]);
    assert!(closed.between(2, 8).unwrap()[(0, 0)] < 1e-4);
}

/// Rotation errors count by their displacement far away: of two loops between the same keyframes the path takes the one
/// with the worse position and the better rotation.
#[test]
fn path_weights_rotation_by_the_extent_of_the_map() {
    let loops = [edge(0, 9, [0.01, 0.05]), edge(0, 9, [0.05, 0.002])];
    let variance = |reach: f64| {
        let mut map = map(12);
        for k in 0..12 {
            // Only the keyframes between are spread out; those of the loops stay.
            let x = if k % 9 == 0 {
                0.0
            } else {
                reach * f64::from(k % 2)
            };
            let pose = Se3::new(Default::default(), Vec3::new(x, 0.0, 0.0));
            map.set_pose(KeyframeId(k), pose);
        }
        let nodes = Nodes::new(map.view(), SubmapId(0), SubmapId(0));
        let drift = Drift::new(map.view(), nodes, &loops);
        drift.between(0, 9).unwrap()
    };
    let wide = variance(8.0);
    assert!(
        wide[(0, 0)] > 0.04 * 0.04 && wide[(4, 4)] < 0.01 * 0.01,
        "{wide}"
    );
    // Control: in a map of a few centimetres the loop with the better position is taken.
    let narrow = variance(0.1);
    assert!(
        narrow[(0, 0)] < 0.02 * 0.02 && narrow[(4, 4)] > 0.04 * 0.04,
        "{narrow}"
    );
}

#[test]
fn loop_cost_is_the_mahalanobis_distance_of_its_path() {
    let map = map(12);
    let drift = Drift::new(
        map.view(),
        Nodes::new(map.view(), SubmapId(0), SubmapId(0)),
        &[],
    );
    let off = |metres: f64| LoopEdge {
        old_from_new: Se3::new(Default::default(), Vec3::new(metres, 0.0, 0.0)),
        ..edge(1, 10, [1e-3, 1e-3])
    };
    let (none, covariance) = drift.cost(map.view(), &off(0.0)).unwrap();
    assert!(none < 1e-9);
    // Nine ties of 5 cm.
    let deviation = covariance[(0, 0)].sqrt();
    assert!((deviation - 0.15).abs() < 0.01, "{deviation}");
    let (three, _) = drift.cost(map.view(), &off(0.45)).unwrap();
    assert!((three - 9.0).abs() < 0.5, "{three}");
}
