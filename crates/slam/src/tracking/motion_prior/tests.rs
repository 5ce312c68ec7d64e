use super::*;
use crate::config::Config;
use stillpoint_geometry::Camera;
use stillpoint_imaging::Simd;

/// Control: a tracker that has just started, and does not track backwards.
#[test]
fn backward_tracking_starts_with_momentum_and_calm_factor() {
    let camera = Camera::pinhole(64, 48, [50.0, 50.0, 31.5, 23.5]);
    let mut tracker = Tracker::new(Config::default(), camera, Simd::Scalar);
    tracker.moving_share = 0.5;
    let calm = COMMON_FACTOR * COMMON_FACTOR;
    assert!(!tracker.knows_momentum());
    assert!(tracker.pose_factor(0.0) > 3.0 * calm);
    tracker.goes_back = true;
    assert!(tracker.knows_momentum());
    assert!((tracker.pose_factor(0.0) - calm).abs() < 1e-12);
}
