//! A simulated room, and a run of the system through it.

use stillpoint_dense::{Dense, DenseConfig, FinalPose};
use stillpoint_geometry::Camera;
use stillpoint_imaging::Simd;
use stillpoint_simulator::{Simulator, SimulatorConfig};
use stillpoint_slam::{Config, Event, Stages, System};

/// Small images, so that a test takes a second.
pub(crate) fn simulator(scene: &str, frames: usize) -> Simulator {
    Simulator::new(&SimulatorConfig {
        scene: scene.to_owned(),
        frames: Some(frames),
        camera: Camera::pinhole(240, 180, [200.0, 200.0, 119.5, 89.5]),
        ..SimulatorConfig::default()
    })
    .unwrap()
}

/// The events of a run over a recording, and its final poses.
pub(crate) struct Run {
    pub(crate) simulator: Simulator,
    pub(crate) events: Vec<Event>,
    pub(crate) poses: Vec<FinalPose>,
}

pub(crate) fn run(scene: &str, frames: usize) -> Run {
    let simulator = simulator(scene, frames);
    let stages = Stages::new(Config::default(), *simulator.camera(), Simd::detect()).unwrap();
    let mut system = System::from(stages);
    let mut events = Vec::new();
    for i in 0..frames {
        events.extend(system.step(simulator.frame_with_colour(i)));
    }
    events.extend(system.finish());
    let entries = system.corrected_trajectory().into_iter();
    let poses = entries
        .map(|(entry, world_from_camera)| FinalPose {
            frame: entry.frame,
            stamp: entry.stamp,
            world_from_camera,
        })
        .collect();
    Run {
        simulator,
        events,
        poses,
    }
}

pub(crate) fn config() -> DenseConfig {
    DenseConfig {
        voxel: 0.04,
        ..DenseConfig::default()
    }
}

pub(crate) fn dense(run: &Run, config: &DenseConfig) -> Dense {
    Dense::new(config, run.simulator.camera(), Simd::detect()).unwrap()
}
