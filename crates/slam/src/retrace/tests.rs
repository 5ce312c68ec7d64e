#![allow(clippy::unwrap_used)] // A failed helper is a failed test.
use super::*;
use crate::config::Config;
use crate::system::System;
use stillpoint_geometry::Camera;
use stillpoint_imaging::{DepthImage, FrameId, GrayImage, Simd};

fn frame(id: u32, stamp: f64) -> RgbdFrame {
    RgbdFrame {
        id: FrameId(id),
        stamp,
        depth_stamp: stamp,
        gray: GrayImage::new(64, 48),
        colour: None,
        depth: DepthImage::from_vec(64, 48, vec![0.0; 64 * 48]).unwrap(),
    }
}

/// The tracker's reply for a black frame, with these counts.
fn tracked(id: u32, keypoints: u32, dynamic: u32) -> Tracked {
    let camera = Camera::pinhole(64, 48, [50.0, 50.0, 31.5, 23.5]);
    let mut tracker = Tracker::new(Config::default(), camera, Simd::Scalar);
    let mut tracked = tracker.track(&Arc::new(frame(id, 0.0)));
    tracked.report.counts.keypoints = keypoints;
    tracked.report.counts.dynamic = dynamic;
    tracked
}

#[test]
fn start_is_quiet_after_0_8_s_without_motion() {
    for (dynamic, quiet) in [(0, true), (9, true), (11, false)] {
        let still = tracked(0, 100, 0);
        let said = tracked(0, 100, dynamic);
        let mut beginning = Beginning::at(5.0);
        for i in 0..30_u32 {
            let stamp = 5.0 + f64::from(i) / 30.0;
            let said = if i == 12 { &said } else { &still };
            let since = beginning.take(&frame(i, stamp), said).unwrap();
            assert!((since - f64::from(i) / 30.0).abs() < 1e-9);
            let expected = quiet && since >= 0.8;
            assert_eq!(beginning.is_quiet(since), expected, "{dynamic} {since}");
        }
    }
}

#[test]
fn motion_before_depth_comparison_is_ignored() {
    let mut beginning = Beginning::at(0.0);
    let said = tracked(0, 100, 90);
    beginning.take(&frame(0, 0.0), &said);
    beginning.take(&frame(1, 0.2), &said);
    assert!(!beginning.is_quiet(0.7) && beginning.is_quiet(0.8));
}

#[test]
fn high_frame_rate_reduces_the_retracing_steps() {
    for (hz, expected) in [(15.0, 2), (30.0, 2), (60.0, 1), (90.0, 1)] {
        assert_eq!(steps([5.0 + 1.0 / hz, 5.0]), expected, "{hz} Hz");
    }
    assert_eq!(steps([5.0, f64::NEG_INFINITY]), 2);
}

#[test]
fn clock_set_back_ends_the_start_phase() {
    let mut beginning = Beginning::at(0.0);
    let said = tracked(0, 100, 0);
    assert!(beginning.take(&frame(0, 0.0), &said).is_some());
    assert!(beginning.take(&frame(1, 0.1), &said).is_some());
    assert!(beginning.take(&frame(2, 0.1), &said).is_none());
    assert!(beginning.take(&frame(3, -7.0), &said).is_none());
}

#[test]
fn without_a_map_no_frame_is_undecided() {
    let camera = Camera::pinhole(64, 48, [50.0, 50.0, 31.5, 23.5]);
    let mut system = System::new(Config::default(), camera, Simd::Scalar).unwrap();
    for i in 0..40 {
        for event in system.step(frame(i, f64::from(i) / 30.0)) {
            if let Some(f) = event.as_frame() {
                assert!(f.report.undecided.is_none() && !f.health.undecided);
            }
        }
    }
}

#[test]
fn start_phase_ends_after_three_seconds() {
    let camera = Camera::pinhole(64, 48, [50.0, 50.0, 31.5, 23.5]);
    let mut tracker = Tracker::new(Config::default(), camera, Simd::Scalar);
    let mut retracer = Retracer::new(&Config::default());
    let mut said = tracked(0, 100, 90);
    said.report.outcome = Outcome::Initialised;
    let mut undecided = Vec::new();
    for i in 0..150_u32 {
        let stamp = f64::from(i) / 30.0;
        said.report.undecided = None;
        let frame = Arc::new(frame(i, stamp));
        retracer.follow(&mut tracker, &frame, &mut said);
        assert!(retracer.work(&mut tracker).is_none());
        undecided.extend(said.report.undecided);
        // The camera is lost from the second frame on.
        said.report.outcome = Outcome::Lost {
            since: FrameId(1),
            reason: crate::report::LostReason::FewFeatures,
        };
    }
    let last = undecided.last().copied().unwrap();
    assert!((last - 3.0).abs() < 0.05, "{last}");
    assert!(matches!(retracer.stage, Stage::Decided));
}
