//! Wheel odometry in whole simulated runs, with controls without it.
use crate::inertial::lost;
use crate::rendered::Rendered;
use stillpoint::geometry::{Camera, Se3, Vec3};
use stillpoint::imaging::{FrameSource, Simd};
use stillpoint::simulator::{SimulatedOdometry, Simulator, SimulatorConfig, WheelSlip};
use stillpoint::slam::{
    Config, Event, FrameReport, LogEntry, OdometryFault, OdometryState, Outcome, Replay, RunLog,
    Stages, System,
};
use stillpoint_testdata::ate::{self, Figures};

fn stages(camera: Camera, wheels: Option<&SimulatedOdometry>) -> Stages {
    let stages = Stages::new(Config::default(), camera, Simd::detect()).unwrap();
    match wheels {
        Some(wheels) => stages.with_odometry(wheels.model).unwrap(),
        None => stages,
    }
}

/// Reports of all frames, and the log of the run.
fn run(stages: Stages, scene: &Rendered, wheels: &SimulatedOdometry) -> (Vec<FrameReport>, RunLog) {
    let mut system = System::from(stages).with_log();
    let mut source = scene.with_odometry(wheels);
    let mut reports = Vec::new();
    while let Some(frame) = source.next_frame() {
        system.receive_odometry(source.take_odometry());
        for event in system.step(frame.unwrap()) {
            if let Event::Frame(done) = event {
                reports.push(done.report.clone());
            }
        }
    }
    system.finish();
    (reports, system.log().unwrap())
}

/// Error of a frame's pose relative to the first, m and deg; `None` if either has no pose, or they are in different
/// submaps.
fn off(reports: &[FrameReport], truth: &[(f64, Se3)], frame: usize) -> Option<[f64; 2]> {
    let (first, last) = (reports.first()?, reports.get(frame)?);
    if first.submap != last.submap {
        return None;
    }
    let found = first.world_from_camera?.inverse() * last.world_from_camera?;
    let exact = truth.first()?.1.inverse() * truth.get(frame)?.1;
    let off = found.inverse() * exact;
    Some([off.translation.norm(), off.rotation.angle().to_degrees()])
}

fn state(reports: &[FrameReport]) -> Option<OdometryState> {
    reports.last().and_then(|r| r.odometry).map(|o| o.state)
}

/// Two people fill nine tenths of the view for three seconds while the camera moves sideways by 0.8 m, or turns by 60
/// degrees.
#[test]
fn blocked_view_loses_neither_frames_nor_accuracy() {
    for name in ["blocked_walk", "blocked_turn"] {
        let scene = Rendered::with_seed(name, 140, 20.0, 1);
        let wheels = SimulatedOdometry::default();
        let truth = scene.truth();
        let (with, _) = run(stages(scene.camera(), Some(&wheels)), &scene, &wheels);
        assert_eq!(lost(&with), 0);
        let is_carried = |r: &FrameReport| matches!(r.outcome, Outcome::Carried { .. });
        assert!(with.iter().any(is_carried));
        // Including the blocked frames: the wheels' error is 3 % of a turn.
        let mut worst: f64 = 0.0;
        for frame in (0..140).step_by(5) {
            let [m, degrees] = off(&with, &truth, frame).unwrap();
            worst = worst.max(m);
            assert!(m <= 0.06 && degrees <= 2.5, "{frame}: {m} m, {degrees}");
        }
        let sequence = format!("sim:{name} with seed 1 140 frames with wheels: largest error");
        let found = Figures::all_posed(1e3 * worst, 140);
        ate::hold(&sequence, "none", "default", found);
        assert_eq!(state(&with), Some(OdometryState::Confirmed));
        // Control.
        let (without, _) = run(stages(scene.camera(), None), &scene, &wheels);
        let off = off(&without, &truth, 139);
        let far = off.is_none_or(|[m, deg]| m > 0.2 || deg > 5.0);
        assert!(lost(&without) > 5 || far, "{off:?}");
        assert!(without.iter().all(|r| r.odometry.is_none()));
    }
}

/// Maximum error of the final poses of the first half second, seen from the last frame, m, with wheels and without.
/// Both runs share the frames, since rendering is slower than tracking.
fn beginning_off(simulator: Simulator, wheels: &SimulatedOdometry) -> [f64; 2] {
    let truth = simulator.ground_truth();
    let mut with = System::from(stages(*simulator.camera(), Some(wheels)));
    let mut without = System::from(stages(*simulator.camera(), None));
    let mut source = simulator.source().with_odometry(wheels);
    while let Some(frame) = source.next_frame() {
        let frame = frame.unwrap();
        with.receive_odometry(source.take_odometry());
        with.step(frame.clone());
        without.step(frame);
    }
    [with, without].map(|mut system| {
        system.finish();
        first_half_second_off(&system, &truth)
    })
}

fn first_half_second_off(system: &System, truth: &[(f64, Se3)]) -> f64 {
    let view = system.view();
    let found: Vec<Se3> = system.trajectory().resolve(&view).map(|f| f.1).collect();
    assert_eq!(found.len(), truth.len());
    let from_last = |poses: &dyn Fn(usize) -> Se3, k| poses(truth.len() - 1).inverse() * poses(k);
    let off = |k: usize| {
        let exact = from_last(&|k| truth[k].1, k);
        (from_last(&|k| found[k], k).inverse() * exact).translation
    };
    (0..15).map(|k| off(k).norm()).fold(0.0, f64::max)
}

/// Two walking people fill the view from the first frame on. Tracking backwards over the first second the same happens,
/// but then the odometry is confirmed.
#[test]
fn wheels_correct_a_start_that_followed_people() {
    let config = SimulatorConfig {
        scene: "crowd_pitch".into(),
        frames: Some(90),
        seed: 7,
        ..SimulatorConfig::default()
    };
    let simulator = Simulator::new(&config).unwrap();
    let [with, without] = beginning_off(simulator, &SimulatedOdometry::default());
    let sequence =
        "sim:crowd_pitch with seed 7 90 frames with wheels: largest error of the beginning";
    let found = Figures::all_posed(1e3 * with, 90);
    ate::hold(sequence, "none", "default", found);
    assert!(without > 0.04, "{without} m, {with} m with wheels");
}

#[test]
fn odometry_run_replays_exactly_and_needs_its_samples() {
    let scene = Rendered::new("walking_rpy", 30, 30.0);
    let wheels = SimulatedOdometry::default();
    let (_, log) = run(stages(scene.camera(), Some(&wheels)), &scene, &wheels);
    let text = log.to_text();
    assert!(text.contains("\nodometry ") && text.contains("\n  base "));
    let read = RunLog::from_bytes(text.as_bytes()).unwrap();
    // The replay's source has no samples: they are in the log.
    let replayed = |log: RunLog| {
        let mut replay = Replay::new(stages(scene.camera(), Some(&wheels)), log).unwrap();
        let mut source = scene.source();
        while replay.step(&mut source).unwrap().is_some() {}
        replay.trajectory().digest(&replay.view())
    };
    assert_eq!(replayed(read.clone()), log.trajectory);
    let is_odometry = |e: &LogEntry| matches!(e, LogEntry::TrackOdometry { .. });
    let entries = read.entries.iter().filter(|e| !is_odometry(e)).cloned();
    let silent = RunLog {
        entries: entries.collect(),
        ..read.clone()
    };
    assert_ne!(replayed(silent), log.trajectory);
    // Without a configured base, samples have no effect and are not logged.
    let (_, plain) = run(stages(scene.camera(), None), &scene, &wheels);
    assert!(!plain.entries.iter().any(is_odometry));
    assert!(Replay::new(stages(scene.camera(), None), log).is_err());
}

/// Stuck wheels, or a wrong mounting, cost neither frames nor accuracy; wheels that slip for half a second are trusted
/// again afterwards.
#[test]
fn wrong_odometry_is_ignored_and_slip_is_tolerated() {
    let scene = Rendered::new("xyz", 120, 30.0);
    let truth = scene.truth();
    let right = SimulatedOdometry::default();
    let stuck = SimulatedOdometry {
        stuck: true,
        ..right.clone()
    };
    let quarter = Vec3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2);
    let turned = SimulatedOdometry {
        model: right.model.turned(quarter),
        ..right.clone()
    };
    let slip = WheelSlip {
        from: 2.0,
        to: 2.5,
        speed: 0.5,
    };
    let slipping = SimulatedOdometry {
        slips: vec![slip],
        ..right.clone()
    };
    let ignored = OdometryState::Ignored;
    for (what, stated, moved, expected) in [
        ("slipping", &right, &slipping, OdometryState::Confirmed),
        ("stuck", &right, &stuck, ignored(OdometryFault::Stuck)),
        (
            "turned",
            &turned,
            &right,
            ignored(OdometryFault::Contradicts),
        ),
    ] {
        let (reports, _) = run(stages(scene.camera(), Some(stated)), &scene, moved);
        assert_eq!(lost(&reports), 0);
        assert_eq!(state(&reports), Some(expected));
        let [m, degrees] = off(&reports, &truth, 119).unwrap();
        assert!(degrees < 0.3, "{degrees}");
        let sequence = format!("sim:xyz 120 frames with {what} wheels: error at the end");
        let found = Figures::all_posed(1e3 * m, 120);
        ate::hold(&sequence, "none", "default", found);
        let slips = reports.last().and_then(|r| r.odometry).map(|o| o.slips);
        if expected == OdometryState::Confirmed {
            assert!(slips.is_some_and(|n| (1..=2).contains(&n)), "{slips:?}");
        }
    }
}
