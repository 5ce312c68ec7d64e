//! The inertial sensor in whole simulated runs, with controls without it.
use crate::rendered::Rendered;
use stillpoint::geometry::{Se3, Vec3};
use stillpoint::imaging::{FrameSource, Simd};
use stillpoint::simulator::SimulatedImu;
use stillpoint::slam::{
    Config, Event, FrameReport, InertialState, Outcome, Replay, RunLog, SensorFault, Stages, System,
};

fn stages(scene: &Rendered, imu: Option<&SimulatedImu>) -> Stages {
    let stages = Stages::new(Config::default(), scene.camera(), Simd::detect()).unwrap();
    match imu {
        Some(imu) => stages.with_imu(imu.model).unwrap(),
        None => stages,
    }
}

/// Reports of all frames, and the log of the run.
fn run(stages: Stages, scene: &Rendered, imu: &SimulatedImu) -> (Vec<FrameReport>, RunLog) {
    let mut system = System::from(stages).with_log();
    let mut source = scene.with_imu(imu);
    let mut reports = Vec::new();
    while let Some(frame) = source.next_frame() {
        system.receive_inertial(source.take_inertial());
        for event in system.step(frame.unwrap()) {
            if let Event::Frame(done) = event {
                reports.push(done.report.clone());
            }
        }
    }
    system.finish();
    (reports, system.log().unwrap())
}

pub(crate) fn lost(reports: &[FrameReport]) -> usize {
    let is_lost = |r: &&FrameReport| matches!(r.outcome, Outcome::Lost { .. });
    reports.iter().filter(is_lost).count()
}

/// Rotation error of the last frame relative to the first, deg; `None` if either has no pose, or they are in different
/// submaps.
fn turn_error(reports: &[FrameReport], truth: &[(f64, Se3)]) -> Option<f64> {
    let (first, last) = (reports.first()?, reports.last()?);
    if first.submap != last.submap {
        return None;
    }
    let found = first.world_from_camera?.inverse() * last.world_from_camera?;
    let exact = truth.first()?.1.inverse() * truth.last()?.1;
    Some(found.rotation.angle_to(&exact.rotation).to_degrees())
}

/// Two people fill nine tenths of the view for three seconds while the camera turns by 60 degrees.
#[test]
fn blocked_view_loses_no_frame() {
    let scene = Rendered::new("blocked_turn", 140, 20.0);
    let imu = SimulatedImu::default();
    let truth = scene.truth();
    let (with, _) = run(stages(&scene, Some(&imu)), &scene, &imu);
    let off = turn_error(&with, &truth);
    assert_eq!(lost(&with), 0);
    assert!(off.is_some_and(|deg| deg <= 0.5), "{off:?}");
    let state = with.last().and_then(|r| r.inertial).map(|i| i.state);
    assert_eq!(state, Some(InertialState::Confirmed));
    // Control.
    let (without, _) = run(stages(&scene, None), &scene, &imu);
    let off = turn_error(&without, &truth);
    assert!(
        lost(&without) > 5 || off.is_none_or(|deg| deg > 5.0),
        "{off:?}"
    );
    assert!(without.iter().all(|r| r.inertial.is_none()));
}

#[test]
fn inertial_run_replays_exactly_and_needs_its_samples() {
    let scene = Rendered::new("walking_rpy", 30, 30.0);
    let imu = SimulatedImu::default();
    let (_, log) = run(stages(&scene, Some(&imu)), &scene, &imu);
    let text = log.to_text();
    assert!(text.contains("\ninertial ") && text.contains("\n  imu "));
    let read = RunLog::from_bytes(text.as_bytes()).unwrap();
    // The replay's source has no samples: they are in the log.
    let replayed = |log: RunLog| {
        let mut replay = Replay::new(stages(&scene, Some(&imu)), log).unwrap();
        let mut source = scene.source();
        while replay.step(&mut source).unwrap().is_some() {}
        replay.trajectory().digest(&replay.view())
    };
    assert_eq!(replayed(read.clone()), log.trajectory);
    let silent = RunLog {
        entries: read
            .entries
            .iter()
            .filter(|e| !is_inertial(e))
            .cloned()
            .collect(),
        ..read
    };
    assert_ne!(replayed(silent), log.trajectory);
    // Without a configured sensor, samples have no effect and are not logged.
    let (_, plain) = run(stages(&scene, None), &scene, &imu);
    assert!(!plain.entries.iter().any(is_inertial));
    assert!(Replay::new(stages(&scene, None), log).is_err());
}

fn is_inertial(entry: &stillpoint::slam::LogEntry) -> bool {
    matches!(entry, stillpoint::slam::LogEntry::TrackInertial { .. })
}

/// Mounting wrong by two degrees, clock by 8 ms.
#[test]
fn mount_and_time_offset_are_calibrated_by_turning() {
    let scene = Rendered::new("rpy", 240, 30.0);
    let right = SimulatedImu::default();
    let mut stated = right.model.turned(Vec3::new(0.02, -0.02, 0.02));
    stated.time_offset += 0.008;
    let imu = SimulatedImu {
        model: stated,
        ..right.clone()
    };
    let (reports, _) = run(stages(&scene, Some(&imu)), &scene, &right);
    let known = reports.last().and_then(|r| r.inertial).unwrap();
    assert_eq!(known.state, InertialState::Confirmed);
    let off = known
        .camera_from_imu
        .angle_to(&right.model.camera_from_imu.rotation);
    let off = off.to_degrees();
    assert!(
        off < 0.7 && known.mount_sigma.to_degrees() < 0.7,
        "{off} {known:?}"
    );
    assert!(
        (known.time_offset - right.model.time_offset).abs() < 0.003,
        "{known:?}"
    );
}

#[test]
fn wrongly_mounted_sensor_is_detected_and_ignored() {
    let scene = Rendered::new("rpy", 120, 30.0);
    let imu = SimulatedImu::default();
    let right = stages(&scene, Some(&imu));
    let quarter = Vec3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2);
    let model = imu.model.turned(quarter);
    let wrong = SimulatedImu {
        model,
        ..imu.clone()
    };
    for (stages, expected) in [
        (right, InertialState::Confirmed),
        (
            stages(&scene, Some(&wrong)),
            InertialState::Ignored(SensorFault::Contradicts),
        ),
    ] {
        let (reports, _) = run(stages, &scene, &imu);
        assert_eq!(lost(&reports), 0);
        let state = reports.last().and_then(|r| r.inertial).map(|i| i.state);
        assert_eq!(state, Some(expected));
        // The scene is static, and an unconfirmed sensor must not cause rejections.
        let sum = |of: fn(&FrameReport) -> u32| reports.iter().map(of).sum::<u32>();
        let [moves, all] = [sum(|r| r.counts.dynamic), sum(|r| r.counts.keypoints)];
        assert!(f64::from(moves) < 0.01 * f64::from(all), "{moves} of {all}");
    }
}

/// In a crowd some person moves consistently with any sensor, with an independent translation: an unconfirmed sensor
/// must not support that motion.
#[test]
fn wrongly_mounted_sensor_does_no_harm_in_a_crowd() {
    let scene = Rendered::new("crowd_halfsphere", 40, 30.0);
    let imu = SimulatedImu::default();
    let quarter = Vec3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2);
    let wrong = SimulatedImu {
        model: imu.model.turned(quarter),
        ..imu.clone()
    };
    let (with, _) = run(stages(&scene, Some(&wrong)), &scene, &imu);
    let (without, _) = run(stages(&scene, None), &scene, &imu);
    let state = with.last().and_then(|r| r.inertial).map(|i| i.state);
    let ignored = InertialState::Ignored(SensorFault::Contradicts);
    assert_eq!((lost(&with), state), (0, Some(ignored)));
    for (a, b) in with.iter().zip(&without) {
        let (a_pose, b_pose) = (a.world_from_camera.unwrap(), b.world_from_camera.unwrap());
        let apart = (a_pose.translation - b_pose.translation).norm();
        assert!(apart < 0.01, "frame {}: {apart} m", a.frame);
    }
}
