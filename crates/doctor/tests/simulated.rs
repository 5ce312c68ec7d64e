//! Simulated streams: they have no faults, and each injected fault is found.

use crate::common::{SECONDS, Stream, assert_well};
use stillpoint_datasets::{Disturbance, Fault};
use stillpoint_doctor::{Setup, Symptom};
use stillpoint_geometry::{BrownConrady, Camera};
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

/// With `xyz` and `rpy` of the tests below four scenes without findings: translations, rotations, people, fast rotations among people with
/// blur and a rolling shutter. Long, since three seconds of each are rendered: fewer would not test the promised duration.
#[test]
fn simulated_streams_have_no_findings() {
    for scene in ["walking_xyz", "crowd_rpy_60"] {
        let stream = simulated(scene);
        assert_well(scene, &stream.report());
    }
}

/// Long, since three seconds are rendered, and examined fifteen times.
#[test]
fn injected_faults_of_a_simulated_stream_are_found() {
    let stream = simulated("xyz");
    assert_well("xyz", &stream.report());
    stream.check_faults();
    let mirrored = stream.with(Fault::MirroredDepth);
    stream.check(&mirrored, Symptom::Mirrored);
    cameras(&stream);
    disturbances(&stream);
}

/// Focal lengths and lens models that belong to another camera.
fn cameras(stream: &Stream) {
    let camera = stream.setup.camera;
    // A lens model that folds within the image: its k3 was omitted.
    let fold = Camera {
        distortion: BrownConrady {
            k1: 0.262_383,
            k2: -0.953_104,
            ..BrownConrady::default()
        },
        ..camera
    };
    stream.check(&stream.taken_for(fold), Symptom::Lens);
}

/// Disturbances of a hand-held camera, over the whole examined time.
fn disturbances(stream: &Stream) {
    for (what, symptom) in [
        (Disturbance::Covered, Symptom::Exposure),
        (Disturbance::Saturated, Symptom::Exposure),
        (Disturbance::Blurred(6), Symptom::Blur),
        (Disturbance::NoDepth, Symptom::DepthHoles),
    ] {
        let report = stream.disturbed(what);
        assert!(report.names(symptom), "{what:?}\n{report}");
    }
}

/// Rotation reveals a focal length that is wrong along both axes, which the intrinsics do not.
#[test]
fn rotation_reveals_a_focal_length_wrong_on_both_axes() {
    let stream = simulated("rpy");
    assert_well("rpy", &stream.report());
    let camera = stream.setup.camera;
    for factor in [0.87, 1.15] {
        let wrong = Camera {
            fx: factor * camera.fx,
            fy: factor * camera.fy,
            ..camera
        };
        stream.check(&stream.taken_for(wrong), Symptom::FocalLength);
    }
}
