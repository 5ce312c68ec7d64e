use super::*;
use crate::evidence::Evidence;
use crate::report::{FrameCounts, FrameReport, LostReason};
use crate::static_filter::Segments;
use proptest::prelude::*;
use std::sync::Arc;
use stillpoint_geometry::Vec6;
use stillpoint_imaging::{DepthImage, GrayImage};

fn frame(id: u32, stamp: f64, gray: u8, depth: f32) -> RgbdFrame {
    RgbdFrame {
        id: FrameId(id),
        stamp,
        depth_stamp: stamp,
        gray: GrayImage::from_vec(64, 48, vec![gray; 64 * 48]).unwrap(),
        colour: None,
        depth: DepthImage::from_vec(64, 48, vec![depth; 64 * 48]).unwrap(),
    }
}

fn report(frame: &RgbdFrame, outcome: Outcome, map_version: u64) -> FrameReport {
    FrameReport {
        inertial: None,
        odometry: None,
        frame: frame.id,
        stamp: frame.stamp,
        outcome,
        world_from_camera: None,
        undecided: None,
        verdicts: Arc::from([]),
        segments: Segments::default(),
        objects: Arc::from([]),
        counts: FrameCounts {
            keypoints: 100,
            dynamic: 20,
            released: 5,
            ..FrameCounts::default()
        },
        still: None,
        is_keyframe: false,
        submap: None,
        map_version,
    }
}

fn monitor() -> HealthMonitor {
    HealthMonitor::new(&Config::default())
}

fn judge(
    monitor: &mut HealthMonitor,
    id: u32,
    outcome: Outcome,
    version: u64,
    evidence: &Evidence,
) -> Health {
    judge_at(
        monitor,
        (id, f64::from(id)),
        (outcome, version),
        &Evidence {
            has_map: true,
            ..*evidence
        },
    )
}

fn judge_at(
    monitor: &mut HealthMonitor,
    (id, stamp): (u32, f64),
    (outcome, version): (Outcome, u64),
    evidence: &Evidence,
) -> Health {
    let frame = frame(id, stamp, 120, 1.5);
    let tracked = Tracked {
        report: report(&frame, outcome, version),
        evidence: *evidence,
        keyframe: None,
    };
    monitor.judge(&frame, &tracked, &MapView::default())
}

fn lost(since: u32) -> Outcome {
    Outcome::Lost {
        since: FrameId(since),
        reason: LostReason::FewMatches,
    }
}

#[test]
fn ages_are_measured_by_the_camera_clock() {
    let mut monitor = monitor();
    let evidence = Evidence::default();
    let at =
        |m: &mut HealthMonitor, id, outcome, version| judge(m, id, outcome, version, &evidence);
    let first = at(&mut monitor, 0, Outcome::Tracked, 7);
    assert_eq!((first.map_age, first.detections_age), (None, None));
    let detections = Detections {
        frame: FrameId(1),
        stamp: 1.0,
        items: Vec::new(),
    };
    monitor.receive(&detections);
    let second = at(&mut monitor, 1, Outcome::Tracked, 8);
    assert_eq!(
        (second.map_age, second.detections_age),
        (Some(0.0), Some(0.0))
    );
    let third = at(&mut monitor, 3, lost(3), 8);
    assert_eq!(
        (third.map_age, third.detections_age),
        (Some(2.0), Some(2.0))
    );
    assert!(third.loss.is_some_and(|l| l.seconds == 0.0));
    let fourth = at(&mut monitor, 5, lost(3), 8);
    assert!(fourth.loss.is_some_and(|l| l.seconds == 2.0));
    // The clock is set back by 3 s: durations continue, but the time lost is unknown.
    let in_map = Evidence {
        has_map: true,
        ..evidence
    };
    let fifth = judge_at(&mut monitor, (6, 2.0), (lost(3), 8), &in_map);
    assert!(
        fifth.loss.is_some_and(|l| l.seconds == 2.0),
        "{:?}",
        fifth.loss
    );
    assert_eq!((fifth.map_age, fifth.detections_age), (Some(4.0), None));
    let sixth = judge_at(&mut monitor, (7, 3.0), (lost(7), 9), &in_map);
    assert!(sixth.loss.is_some_and(|l| l.seconds == 0.0));
}

#[test]
fn static_share_is_relative_to_judged_features() {
    let mut monitor = monitor();
    let blind = judge(&mut monitor, 0, lost(0), 0, &Evidence::default());
    assert!(blind.static_share == 0.0);
    let judged = Evidence {
        judged: true,
        ..Evidence::default()
    };
    let seen = judge(&mut monitor, 1, Outcome::Tracked, 0, &judged);
    assert!(seen.static_share == 0.75 && seen.dynamic_share == 0.25);
    assert!(seen.depth_share == 1.0);
}

#[test]
fn black_frame_without_depth_is_reported_as_covered() {
    let mut monitor = monitor();
    let black = frame(0, 0.0, 2, 0.0);
    let tracked = Tracked {
        report: report(&black, lost(0), 0),
        evidence: Evidence::default(),
        keyframe: None,
    };
    let health = monitor.judge(&black, &tracked, &MapView::default());
    assert!(health.quality.value() == 0.0 && health.covariance.is_none());
    assert_eq!(
        health.to_string(),
        "quality 0.00 | lost for 0.0 s: the image is black or covered (100 keypoints; 100 needed); uncover the lens or make light"
    );
}

/// Health of a pose with these standard deviations in camera axes.
fn with_covariance(sigmas: [f64; 6]) -> Health {
    let mut monitor = monitor();
    let weights = sigmas.map(|s| 1.0 / (s * s));
    let evidence = Evidence {
        information: Some(Mat6::from_diagonal(&Vec6::from(weights))),
        judged: true,
        matched: 200,
        agreed: 180,
        ..Evidence::default()
    };
    judge(&mut monitor, 0, Outcome::Tracked, 0, &evidence)
}

#[test]
fn health_line_contains_all_figures() {
    let mut health = with_covariance([0.001, 0.002, 0.002, 0.001, 0.001, 0.001]);
    assert!((health.sigma_m().unwrap() - 0.003).abs() < 1e-12);
    assert_eq!(health.quality.weakest().0, "inliers in one place");
    health.detections_age = Some(0.123);
    health.map_age = Some(0.44);
    assert_eq!(
        health.to_string(),
        "quality 0.00 | +-3.0 mm 0.10 deg | static 75 % | detection 0.12 s ago | map 0.4 s ago"
    );
}

proptest! {
    /// A pose error moves a point equally in camera axes and in world axes.
    #[test]
    fn covariance_is_rotated_into_world_axes_consistently(
        sigmas in prop::array::uniform6(0.001..0.1f64),
        pose in prop::array::uniform6(-2.0..2.0f64),
        direction in prop::array::uniform6(-1.0..1.0f64),
    ) {
        let pose = Se3::exp(&Vec6::from(pose));
        let health = with_covariance(sigmas);
        let (camera, world) = (health.covariance.unwrap(), health.covariance_in_world(&pose).unwrap());
        // The variance along a direction is the same in both axes.
        let r = pose.rotation_matrix();
        let inside = Vec6::from(direction);
        let mut outside = inside;
        outside.fixed_rows_mut::<3>(0).copy_from(&(r * inside.fixed_rows::<3>(0)));
        outside.fixed_rows_mut::<3>(3).copy_from(&(r * inside.fixed_rows::<3>(3)));
        let (a, b) = (inside.dot(&(camera * inside)), outside.dot(&(world * outside)));
        prop_assert!((a - b).abs() < 1e-12, "{a} {b}");
        // The position moves by the error's translation, rotated into the world.
        let step = inside * 1e-6;
        let moved = (pose * Se3::exp(&step)).translation - pose.translation;
        prop_assert!((moved - r * step.fixed_rows::<3>(0)).norm() < 1e-11);
    }
}

#[test]
fn undecided_motion_grows_covariance_but_keeps_quality() {
    let decided = with_covariance([0.001; 6]);
    let mut monitor = monitor();
    let frame = frame(0, 0.0, 120, 1.5);
    let mut report = report(&frame, Outcome::Tracked, 0);
    report.undecided = Some(0.5);
    let evidence = Evidence {
        information: Some(Mat6::from_diagonal(&Vec6::from([1e6; 6]))),
        judged: true,
        matched: 200,
        agreed: 180,
        has_map: true,
        ..Evidence::default()
    };
    let tracked = Tracked {
        report,
        evidence,
        keyframe: None,
    };
    let health = monitor.judge(&frame, &tracked, &MapView::default());
    // 0.1 m and 0.05 rad per axis within half a second.
    let expected = [0.1, 0.05].map(|s: f64| (3.0 * (s * s + 1e-6)).sqrt());
    assert!((health.sigma_m().unwrap() - expected[0]).abs() < 1e-9);
    assert!((health.sigma_rad().unwrap() - expected[1]).abs() < 1e-9);
    assert_eq!(health.quality.value(), decided.quality.value());
    assert!(health.undecided && !decided.undecided);
    assert!(health.to_string().contains(" | undecided who moves | "));
    assert!(!decided.to_string().contains("undecided"));
}

#[test]
fn few_inliers_and_many_dynamic_features_are_undecided() {
    let said = |outcome: Outcome, inliers: u32, dynamic: u32| {
        let mut report = report(&frame(0, 0.0, 120, 1.5), outcome, 0);
        (report.counts.inliers, report.counts.dynamic) = (inliers, dynamic);
        report.is_undecided()
    };
    let lost = Outcome::Lost {
        reason: LostReason::FewInliers,
        since: FrameId(0),
    };
    // Of 100 keypoints, 5 more move that are used nevertheless.
    assert!(said(Outcome::Tracked, 40, 30));
    assert!(!said(Outcome::Tracked, 80, 30));
    assert!(!said(Outcome::Tracked, 40, 20));
    assert!(!said(lost, 40, 30));
}
