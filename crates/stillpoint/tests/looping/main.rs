//! Loop closing in the whole system: what it gains, that no loop is false, and that a run gives the same bytes twice.

#![allow(clippy::unwrap_used)] // A failed helper is a failed test.

use stillpoint_evaluation::{EvalOptions, TimedPose, evaluate};
use stillpoint_geometry::Se3;
use stillpoint_imaging::Simd;
use stillpoint_simulator::{Simulator, SimulatorConfig};
use stillpoint_slam::{Config, LoopOutcome, LoopReport, System};

fn simulator(scene: &str, seed: u64, frames: Option<usize>) -> Simulator {
    Simulator::new(&SimulatorConfig {
        scene: scene.into(),
        seed,
        frames,
        ..SimulatorConfig::default()
    })
    .unwrap()
}

/// What a run left behind.
struct Run {
    poses: Vec<TimedPose>,
    /// Greatest distance between what two frames in a row said of their own poses, m.
    largest_step: f64,
    loops: Vec<LoopReport>,
    landmarks: usize,
}

impl Run {
    fn closed(&self) -> Vec<&LoopReport> {
        let closed = |l: &&LoopReport| l.outcome == LoopOutcome::Closed;
        self.loops.iter().filter(closed).collect()
    }
}

fn run(simulator: &Simulator, looping: bool, change: impl Fn(&mut Config)) -> Run {
    let mut config = Config::default();
    config.looping.enabled = looping;
    change(&mut config);
    let mut system = System::new(config, *simulator.camera(), Simd::detect()).unwrap();
    for i in 0..simulator.len() {
        system.step(simulator.frame(i));
    }
    system.finish();
    let view = system.view();
    let resolved = system.trajectory().resolve(&view);
    let poses: Vec<TimedPose> = resolved
        .map(|(entry, world_from_camera)| TimedPose {
            stamp: entry.stamp,
            world_from_camera,
        })
        .collect();
    assert_eq!(poses.len(), simulator.len(), "every frame has a pose");
    let steps = poses.windows(2).map(|w| {
        let [a, b] = [&w[0], &w[1]].map(|p| p.world_from_camera.translation);
        (a - b).norm()
    });
    Run {
        largest_step: steps.fold(0.0, f64::max),
        poses,
        loops: system.loops().to_vec(),
        landmarks: view.landmark_count(),
    }
}

fn truth(simulator: &Simulator) -> Vec<TimedPose> {
    let poses = simulator.ground_truth().into_iter();
    poses
        .map(|(stamp, world_from_camera)| TimedPose {
            stamp,
            world_from_camera,
        })
        .collect()
}

fn ate_mm(simulator: &Simulator, run: &Run) -> f64 {
    let score = evaluate(&truth(simulator), &run.poses, &EvalOptions::default()).unwrap();
    score.ate.statistics.rmse * 1e3
}

/// How far (m, degrees) an edge is from the truth.
fn edge_error(simulator: &Simulator, report: &LoopReport) -> (f64, f64) {
    let truth = simulator.ground_truth();
    let pose = |id: u32| truth[id as usize].1;
    let with_from_keyframe = pose(report.with.0).inverse() * pose(report.keyframe.0);
    let error: Se3 = with_from_keyframe.inverse() * report.edge.unwrap();
    (
        error.translation.norm(),
        error.rotation.angle().to_degrees(),
    )
}

fn tell(simulator: &Simulator, name: &str, run: &Run) {
    println!(
        "{name}: ATE {:.1} mm, {} landmarks, largest step {:.3} m",
        ate_mm(simulator, run),
        run.landmarks,
        run.largest_step
    );
    for l in &run.loops {
        let error = l.edge.map(|_| edge_error(simulator, l));
        println!(
            "  {} with {}: {}, score {:.3}, {} + {} inliers, cost {:.1}, {} merged, moved {:.3} m, edge off by {error:?} (m, deg), {:?}",
            l.keyframe,
            l.with,
            l.outcome,
            l.score,
            l.rigid_inliers,
            l.inliers,
            l.cost,
            l.merges,
            l.moved_m,
            l.applied,
        );
    }
}

/// One walk through two rooms: the control without looping, then with it, twice.
#[test]
fn a_walk_through_two_rooms_closes() {
    let simulator = simulator("loop_two_rooms", 0, None);
    let open = run(&simulator, false, |_| ());
    tell(&simulator, "open", &open);
    let closed = run(&simulator, true, |_| ());
    tell(&simulator, "closed", &closed);
    assert!(open.loops.is_empty());
    assert!(!closed.closed().is_empty(), "no loop was closed");
    for l in closed.closed() {
        let (m, degrees) = edge_error(&simulator, l);
        assert!(m < 0.1 && degrees < 5.0, "{l:?}: {m} m, {degrees} degrees");
    }
    let (before, after) = (ate_mm(&simulator, &open), ate_mm(&simulator, &closed));
    assert!(after < 30.0, "{after} mm");
    assert!(after < before, "{after} mm, without looping {before} mm");
    // 0.9 m/s at 30 Hz: a frame that jumped with the correction would show.
    assert!(closed.largest_step < 0.06, "{} m", closed.largest_step);
    let again = run(&simulator, true, |_| ());
    let bits = |run: &Run| format!("{:?} {:?}", run.poses, run.loops);
    assert!(bits(&closed) == bits(&again), "two runs differ");
}

/// A correction that comes a second late meets a map that has grown since.
#[test]
fn a_late_correction_loses_nothing() {
    let simulator = simulator("loop_two_rooms", 1, None);
    let late = run(&simulator, true, |c| {
        c.schedule.looper = 30;
        c.schedule.mapper = 3;
    });
    tell(&simulator, "late", &late);
    assert!(!late.closed().is_empty(), "no loop was closed");
    for l in late.closed() {
        let (m, degrees) = edge_error(&simulator, l);
        assert!(m < 0.1 && degrees < 5.0, "{l:?}: {m} m, {degrees} degrees");
    }
    let error = ate_mm(&simulator, &late);
    assert!(error < 30.0, "{error} mm");
}

/// Where nothing is visited twice there is nothing to close, however alike things look.
#[test]
fn no_loop_without_a_revisit() {
    for (scene, frames) in [("xyz", 150), ("loop_two_rooms", 600)] {
        let simulator = simulator(scene, 0, Some(frames));
        let run = run(&simulator, true, |_| ());
        tell(&simulator, scene, &run);
        assert!(run.closed().is_empty(), "{scene}: {:?}", run.closed());
    }
}
