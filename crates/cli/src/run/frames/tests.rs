use super::*;
use stillpoint::slam::{FrameCounts, LostReason, Segments, TrajectoryEntry};

fn report(frame: u32, outcome: Outcome, submap: Option<u32>, inliers: u32) -> FrameReport {
    FrameReport {
        frame: FrameId(frame),
        stamp: f64::from(frame) / 10.0,
        outcome,
        world_from_camera: None,
        verdicts: [].into(),
        segments: Segments::default(),
        objects: [].into(),
        counts: FrameCounts {
            inliers,
            ..FrameCounts::default()
        },
        still: None,
        is_keyframe: frame == 0,
        undecided: None,
        inertial: None,
        odometry: None,
        submap: submap.map(SubmapId),
        map_version: 0,
    }
}

fn frames() -> Frames {
    let lost = |since: u32, reason| Outcome::Lost {
        since: FrameId(since),
        reason,
    };
    let found = Outcome::Relocalised {
        since: FrameId(2),
        with: stillpoint::map::KeyframeId(0),
    };
    let mut frames = Frames::default();
    let dark = LostReason::FewFeatures;
    for r in [
        report(0, Outcome::Initialised, Some(0), 200),
        report(1, Outcome::Tracked, Some(0), 150),
        report(2, lost(2, dark), None, 0),
        report(3, lost(2, dark), None, 0),
        report(4, found, Some(0), 80),
        report(5, Outcome::Tracked, Some(0), 12),
        report(6, Outcome::Initialised, Some(6), 180),
        report(7, lost(7, LostReason::FewMatches), None, 0),
    ] {
        frames.take(&r);
    }
    frames
}

#[test]
fn losses_have_reason_duration_and_end() {
    let lost = frames().lost();
    let listed: Vec<_> = lost
        .iter()
        .map(|l| (l.first, l.last, l.then.as_str()))
        .collect();
    assert_eq!(
        listed,
        [
            (2, 3, "found again"),
            (5, 5, "a map began"),
            (7, 7, "the end")
        ]
    );
    assert!((lost[0].seconds - 0.2).abs() < 1e-9, "{}", lost[0].seconds);
    assert_eq!(lost[0].reason, "too few keypoints in the image");
    assert_eq!(lost[1].reason, "fewer than 30 inliers");
}

/// Images, pages and `frames.csv` share their wording.
#[test]
fn frame_states_use_the_report_wording() {
    let carried = Outcome::Carried { since: FrameId(8) };
    let mut reports = [
        report(0, Outcome::Initialised, Some(0), 200),
        report(1, Outcome::Tracked, Some(0), 150),
        // Many moving keypoints, few inliers.
        report(2, Outcome::Tracked, Some(0), 40),
        report(3, Outcome::Tracked, Some(0), 29),
        report(4, carried, Some(0), 3),
    ];
    (reports[2].counts.keypoints, reports[2].counts.dynamic) = (100, 50);
    let mut frames = Frames::default();
    reports.iter().for_each(|r| frames.take(r));
    let csv = frames.to_csv(&Trajectory::default(), &MapView::default());
    let written = csv.lines().skip(1).filter_map(|l| l.split(',').nth(2));
    let expected: Vec<&str> = reports.iter().map(|r| r.state().name()).collect();
    assert_eq!(written.collect::<Vec<_>>(), expected);
    let words = ["initialised", "tracked", "undecided", "lost", "carried"];
    assert_eq!(expected, words);
    for state in FrameState::ALL {
        assert_eq!(FrameState::from_name(state.name()), Some(state));
        assert_eq!(FrameState::ALL[state as usize], state);
    }
}

#[test]
fn frame_states_follow_later_corrections() {
    let mut frames = Frames::default();
    for i in 0..4 {
        let outcome = match i {
            2 => Outcome::Lost {
                since: FrameId(2),
                reason: LostReason::FewMatches,
            },
            _ => Outcome::Tracked,
        };
        let mut report = report(i, outcome, Some(0), 100);
        report.undecided = (i < 3).then_some(0.1);
        frames.take(&report);
    }
    // Frame 1 was revoked, and frame 2 has a pose instead.
    let entry = |i: u32, inliers| TrajectoryEntry {
        carried: false,
        frame: FrameId(i),
        stamp: f64::from(i) / 10.0,
        pose: stillpoint::slam::AnchoredPose {
            keyframe: None,
            reference: stillpoint::map::KeyframeId(0),
            reference_from_camera: Default::default(),
            online_world_from_camera: Default::default(),
        },
        inliers,
    };
    let mut trajectory = Trajectory::default();
    trajectory.extend([entry(0, 100), entry(2, 80), entry(3, 100)]);
    frames.settle(&trajectory);
    let csv = frames.to_csv(&trajectory, &MapView::default());
    let states: Vec<&str> = csv
        .lines()
        .skip(1)
        .filter_map(|l| l.split(',').nth(2))
        .collect();
    assert_eq!(states, ["undecided", "lost", "undecided", "tracked"]);
    assert_eq!(frames.undecided(), 2);
    let lost = frames.lost();
    assert_eq!((lost.len(), lost[0].first, lost[0].last), (1, 1, 1));
    assert!(lost[0].reason.contains("withdrawn"), "{}", lost[0].reason);
}

#[test]
fn standstill_stretches_are_counted_and_reported() {
    let mut frames = Frames::default();
    for i in 0..9 {
        let mut report = report(i, Outcome::Tracked, Some(0), 100);
        let since = if i < 6 { 1 } else { 7 };
        report.still = [2, 3, 4, 8].contains(&i).then(|| Standstill {
            what: Still::Depth,
            since: FrameId(since),
            frames: i - since,
            seconds: f64::from(i - since) / 10.0,
        });
        frames.take(&report);
    }
    let found = frames.still();
    let listed: Vec<_> = found.iter().map(|s| (s.first, s.last, s.frames)).collect();
    assert_eq!(listed, [(2, 4, 3), (8, 8, 1)]);
    assert!((found[0].seconds - 0.3).abs() < 1e-9);
    assert!(
        found[0]
            .to_string()
            .contains("frames 2 to 4 (3 frames, 0.30 s)"),
        "{}",
        found[0]
    );
    let csv = frames.to_csv(&Trajectory::default(), &MapView::default());
    let lines: Vec<&str> = csv.lines().collect();
    assert!(
        lines[3].ends_with("the depth image stands still"),
        "{}",
        lines[3]
    );
    assert!(lines[2].ends_with(','), "{}", lines[2]);
}

#[test]
fn frame_table_has_a_line_per_frame() {
    let csv = frames().to_csv(&Trajectory::default(), &MapView::default());
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines.len(), 9);
    assert_eq!(lines[1], "0,0.000000,initialised,0,0,200,1,");
    assert_eq!(
        lines[3],
        "2,0.200000,lost,,,0,0,too few keypoints in the image"
    );
    assert_eq!(lines[5], "4,0.400000,relocalised,0,0,80,0,");
    assert_eq!(lines[7], "6,0.600000,initialised,6,6,180,0,");
}
