//! Strength of each kind of evidence.

use super::*;
use crate::loop_evidence::LoopEvidence;
use stillpoint_geometry::Vec6;

/// Covariance of a path with these standard deviations per axis, m and rad.
fn drift(metres: f64, radians: f64) -> Mat6 {
    let (t, r) = (metres * metres, radians * radians);
    Mat6::from_diagonal(&Vec6::new(t, t, t, r, r, r))
}

fn of(landmarks: f64, witnesses: f64, place: f64) -> LoopEvidence {
    LoopEvidence {
        prior: prior(By::Words),
        looks: 0.0,
        landmarks,
        witnesses,
        place,
    }
}

/// Odds of twenty.
const LEAST: f64 = 2.995_732;

#[test]
fn landmark_evidence_accepts_places_and_rejects_posters() {
    // A quarter of the expected landmarks, and the same share of fewer.
    assert!(landmarks(100, 400) > 6.0);
    assert!(landmarks(15, 60) > 1.0 && landmarks(15, 60) < landmarks(100, 400));
    // A poster that hangs in another place.
    assert!(landmarks(20, 400) < -1.0);
    assert!(landmarks(30, 700) < -1.0);
    // Landmarks that fit any motion are no evidence, nor are none at all.
    assert!(landmarks(3, 12) < 0.0);
    assert!(landmarks(0, 0).abs() < 1e-12);
    let mut before = f64::NEG_INFINITY;
    for found in (20..400).step_by(20) {
        let now = landmarks(found, 400);
        assert!(now > before, "{found}: {now}");
        before = now;
    }
}

#[test]
fn position_evidence_supports_near_and_rejects_far_places() {
    let place = |cost, metres| super::place(cost, &drift(metres, 0.02), 3.0, By::Words);
    // The smaller the drift, the stronger the evidence of an expected position.
    assert!(place(1.0, 0.05) > place(1.0, 0.2) + 2.0 && place(1.0, 0.2) > 3.0);
    // Drift of the size of the map is no evidence.
    assert!(place(1.0, 30.0).abs() < 1.0);
    // Three times the expected drift is tolerated, an equal room elsewhere is not.
    assert!(place(60.0, 0.1) > -3.0);
    assert!(place(2000.0, 0.1) < -10.0);
    // A candidate from the map is near by construction: only drift smaller than the search reach adds evidence.
    let named = |metres, radians| super::place(1.0, &drift(metres, radians), 3.0, By::Pose);
    assert!(named(0.05, 0.02) > 1.0 && named(0.05, 0.02) < place(1.0, 0.05));
    assert!(named(0.5, 0.3).abs() < 1.5);
    assert!(super::place(f64::INFINITY, &drift(0.1, 0.1), 3.0, By::Words) < -1e9);
}

#[test]
fn witness_and_appearance_evidence_is_bounded() {
    assert_eq!(witnesses(1), 0.0);
    assert!(witnesses(3) > 1.0 && witnesses(20) < 3.0);
    assert!(looks(0.1, 0.02, By::Words) > 1.5);
    assert_eq!(looks(0.5, 0.01, By::Words), looks(0.9, 0.0, By::Words));
    assert_eq!(looks(0.05, 0.05, By::Words), 0.0);
    assert!(looks(0.05, 0.1, By::Words) < 0.0);
    assert_eq!(looks(0.0, 0.5, By::Pose), 0.0);
}

#[test]
fn strong_evidence_compensates_for_weak_evidence() {
    // Neither an intermediate share of landmarks nor an expected position suffices alone.
    assert!(of(1.0, 0.0, 0.0).log_odds() < LEAST);
    assert!(of(-1.0, 0.0, 5.0).log_odds() < LEAST);
    assert!(of(2.0, 0.0, 6.0).log_odds() > LEAST);
    assert!(of(8.0, 0.0, 0.0).log_odds() > LEAST);
    assert!(of(1.5, 2.0, 4.0).log_odds() > LEAST);
}

#[test]
fn position_evidence_outweighs_landmarks_and_witnesses() {
    let equal = of(20.0, 3.0, -9.0);
    assert!(equal.log_odds() < 0.0 && equal.is_elsewhere(LEAST));
    // Without an expected position, an equal place has odds of one in a thousand.
    let unknown = of(20.0, 3.0, 0.0);
    assert!((unknown.log_odds() - log(1000.0)).abs() < 1e-3);
    assert!(!unknown.is_elsewhere(LEAST));
    assert!(!of(-9.0, 0.0, 3.0).is_elsewhere(LEAST));
}
