//! Simulated streams: nothing is wrong with them, and each fault that is put into one is named.

use crate::common::{SECONDS, Stream, assert_well};
use stillpoint_datasets::Fault;
use stillpoint_doctor::{Setup, Symptom};
use stillpoint_geometry::Camera;
use stillpoint_simulator::{Simulator, SimulatorConfig};

fn simulated(scene: &str) -> Stream {
    let simulator = Simulator::new(&SimulatorConfig {
        scene: scene.to_owned(),
        ..SimulatorConfig::default()
    })
    .unwrap();
    let count = (SECONDS * 30.0) as usize + 1;
    Stream {
        name: scene.to_owned(),
        frames: (0..count.min(simulator.len()))
            .map(|i| simulator.frame_with_colour(i))
            .collect(),
        setup: Setup {
            camera: *simulator.camera(),
            depth_scale: 5000.0,
        },
    }
}

/// The four scenes on which nothing may be wrong: translations, an orbit with turns, people, fast turns with blur and a rolling shutter.
#[test]
fn nothing_is_wrong_with_simulated_streams() {
    for scene in ["halfsphere", "walking_xyz", "crowd_rpy_60", "static"] {
        let stream = simulated(scene);
        assert_well(scene, &stream.report());
    }
}

#[test]
fn faults_of_a_simulated_stream_are_named() {
    let stream = simulated("xyz");
    assert_well("xyz", &stream.report());
    stream.check_faults();
    // Of both focal lengths nothing but the motion tells.
    let camera = stream.setup.camera;
    let wrong = Camera {
        fx: 1.1 * camera.fx,
        fy: 1.1 * camera.fy,
        ..camera
    };
    stream.check(&stream.taken_for(wrong), Symptom::FocalLength);
    let mirrored = stream.with(Fault::MirroredDepth);
    stream.check(&mirrored, Symptom::Mirrored);
}
