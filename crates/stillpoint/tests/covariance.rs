//! Covariances of poses against the truth, on a trajectory with map drift; control: without the map's uncertainty.
#![allow(clippy::print_stdout)] // Measurements are printed.

use stillpoint_evaluation::{Coverage, TimedPose, coverage, motion_coverage};
use stillpoint_geometry::{Camera, Mat6, Se3};
use stillpoint_imaging::Simd;
use stillpoint_simulator::{Simulator, SimulatorConfig};
use stillpoint_slam::{Config, CovarianceLog, Event, PoseCovariance, System, covariance_of_motion};

/// 20 s from one room to another: many views away from the start.
const FRAMES: usize = 600;

fn timed((stamp, world_from_camera): (f64, Se3)) -> TimedPose {
    TimedPose {
        stamp,
        world_from_camera,
    }
}

/// Coverage of final poses, of final poses without the map's uncertainty, of motions and of poses as reported.
fn measured(seed: u64) -> [Coverage; 4] {
    let camera = Camera::pinhole(320, 240, [262.5, 262.5, 159.5, 119.5]);
    let simulator = Simulator::new(&SimulatorConfig {
        scene: "loop_two_rooms".into(),
        seed,
        frames: Some(FRAMES),
        camera,
        ..SimulatorConfig::default()
    })
    .unwrap();
    let mut system = System::new(Config::default(), camera, Simd::detect()).unwrap();
    let mut log = CovarianceLog::default();
    let (mut online, mut known) = (Vec::new(), Vec::new());
    for i in 0..FRAMES {
        let events = system.step(simulator.frame(i));
        let frame = events.iter().find_map(Event::as_frame).unwrap();
        let health = &frame.health;
        let Some((covariance, in_map)) = health.covariance.zip(health.covariance_in_map) else {
            continue;
        };
        assert!((covariance - in_map).diagonal().min() >= -1e-15);
        log.note(health.frame, &in_map);
        online.push(timed((
            health.stamp,
            frame.report.world_from_camera.unwrap(),
        )));
        known.push(covariance);
    }
    system.finish();
    let truth: Vec<TimedPose> = simulator.ground_truth().into_iter().map(timed).collect();
    let poses = system.corrected_trajectory();
    let covariances = log.of(&poses, &system.view()).unwrap();
    assert!(poses.len() == covariances.len() && poses.len() > FRAMES - 5);
    for c in &covariances {
        assert!(c.in_map.cholesky().is_some() && c.from_origin.cholesky().is_some());
    }
    let found: Vec<TimedPose> = poses.iter().map(|(e, p)| timed((e.stamp, *p))).collect();
    let of = |which: fn(&PoseCovariance) -> Mat6| {
        let all: Vec<Mat6> = covariances.iter().map(which).collect();
        coverage(&truth, &found, &all).unwrap()
    };
    let (whole, control) = (of(|c| c.from_origin), of(|c| c.in_map));
    let motions = motion_coverage(&truth, &found, 1.0, |i, j, by| {
        let (a, b) = (&covariances[i].in_map, &covariances[j].in_map);
        covariance_of_motion(a, b, by, found[j].stamp - found[i].stamp)
    });
    let online = coverage(&truth, &online, &known).unwrap();
    [whole, control, motions.unwrap(), online]
}

/// Shares of three scenes, as a scene is one sample of the drift of a map. Slow, because map drift builds up slowly.
#[test]
fn ninety_percent_intervals_cover_the_truth() {
    let of_scene = [1, 2, 3].map(measured);
    println!("final, without the map's, motions, online: {of_scene:#?}");
    let [whole, control, motions, online] = [0, 1, 2, 3].map(|k| {
        let mean = |share: fn(&Coverage) -> f64| {
            let all = of_scene.iter().map(|scene| share(&scene[k]));
            all.sum::<f64>() / of_scene.len() as f64
        };
        [mean(|c| c.place), mean(|c| c.direction)]
    });
    let honest = 0.85..0.99;
    assert!(
        whole.iter().all(|share| honest.contains(share)),
        "{whole:?}"
    );
    assert!(motions.iter().all(|share| *share > 0.85), "{motions:?}");
    assert!(
        online.iter().all(|share| honest.contains(share)),
        "{online:?}"
    );
    // Positions are still near, but the map has rotated: without its uncertainty the interval is too small.
    assert!(
        control[1] < honest.start && control[0] < whole[0],
        "{control:?}"
    );
}
