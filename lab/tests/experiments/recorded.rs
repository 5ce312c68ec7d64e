//! Experiments on recordings, here a few frames of a simulated room as a data set folder.

use super::{lab, number, scratch};
use std::path::PathBuf;
use stillpoint::datasets::{ColourFormat, Recorder};
use stillpoint::simulator::{Simulator, SimulatorConfig};

fn recording(name: &str) -> PathBuf {
    let simulator = Simulator::new(&SimulatorConfig {
        frames: Some(10),
        ..SimulatorConfig::default()
    })
    .unwrap();
    let folder = scratch(name);
    let mut recorder =
        Recorder::create(&folder, simulator.camera(), "simulated", ColourFormat::Png).unwrap();
    for i in 0..simulator.len() {
        let pose = simulator.world_from_camera(simulator.stamp(i));
        recorder
            .add(&simulator.frame_with_colour(i), Some(&pose))
            .unwrap();
    }
    recorder.finish().unwrap();
    folder
}

#[test]
fn stage_times_stay_below_the_frame_time() {
    let folder = recording("times");
    let folder = folder.to_str().unwrap();
    let done = lab(&["frame_time", folder, "--passes", "2", "--frames", "8"]).with_code(0);
    assert!(
        done.out.contains("8 frames, 2 passes, 1 threads"),
        "{}",
        done.out
    );
    let mean = |part: &str| {
        let rows = done.rows();
        number(rows.iter().find(|row| row[0] == part).unwrap()[3])
    };
    let parts = mean("extract") + mean("flow");
    assert!(
        mean("extract") > 0.0 && parts < mean("frame"),
        "{}",
        done.out
    );
}

#[test]
fn epipolar_distances_have_a_row_per_input() {
    let folder = recording("epipolar");
    let folder = folder.to_str().unwrap();
    let done = lab(&["epipolar", folder, folder]).with_code(0);
    let rows = done.rows();
    assert_eq!(rows.len(), 2);
    assert_eq!(rows[0], rows[1]);
    assert!(number(rows[0][1]) > 100.0, "{}", done.out);
}

#[test]
fn recorded_run_is_deterministic() {
    let folder = recording("loops");
    let done = lab(&["loops", "recording", folder.to_str().unwrap()]).with_code(0);
    assert!(
        done.out.contains("the same bytes twice: true"),
        "{}",
        done.out
    );
}

#[test]
fn recording_is_fused_and_exported_at_true_poses() {
    let folder = recording("dense");
    let (folder, out) = (folder.to_str().unwrap(), scratch("dense-out"));
    let ply = out.join("surface.ply");
    let fused = lab(&["dense", "fuse", folder, ply.to_str().unwrap()]).with_code(0);
    assert!(fused.out.contains("triangles"), "{}", fused.out);
    assert!(std::fs::read(&ply).unwrap().starts_with(b"ply"));
    lab(&["dense", "dump-tum", folder, out.to_str().unwrap()]).with_code(0);
    let poses = std::fs::read_to_string(out.join("poses.txt")).unwrap();
    assert!(poses.lines().count() >= 3, "{poses}");
}
