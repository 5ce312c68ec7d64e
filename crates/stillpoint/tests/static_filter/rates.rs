//! The same seconds at several frame rates: a walking person before a simulated camera at 15, 30 and 60 Hz, recordings
//! at 15 Hz.

use super::world::{Recording, with};
use stillpoint_simulator::SimulatorConfig;
use stillpoint_slam::Preset;

/// Rendered once at the highest rate; lower rates skip frames.
#[test]
fn walking_people_do_not_disturb_any_frame_rate() {
    let config = SimulatorConfig {
        scene: "walking_xyz".to_owned(),
        rate: 60.0,
        ..SimulatorConfig::default()
    };
    let fastest = Recording::made(config, 0..120, 0.3);
    for (step, rate) in [(1, 60), (2, 30), (4, 15)] {
        let recording = fastest.every(step);
        let sequence = format!("sim:walking_xyz 2 s at {rate} Hz");
        for (name, run) in [
            ("none", recording.run(with(Preset::Default))),
            (
                "scripted with 30 % missed",
                recording.run_detected(with(Preset::Default)),
            ),
        ] {
            let shares = recording.shares(&run);
            println!("{rate} Hz, {name}: {shares:?}");
            recording.hold(&sequence, name, Preset::Default, &run);
            assert_eq!(run.lost(), 0, "{rate} Hz, {name}");
            assert!(shares.kept > 0.93, "{rate} Hz, {name}: {shares:?}");
        }
    }
}

/// Every second frame of a Kinect at 30 Hz.
#[test]
fn recordings_are_tracked_at_half_their_frame_rate() {
    for name in ["fr1_xyz", "fr1_xyz_walkers"] {
        let Some(recording) = Recording::real(name) else {
            return;
        };
        let half = recording.every(2);
        let run = half.run(with(Preset::Default));
        half.hold(&format!("{name} at 15 Hz"), "none", Preset::Default, &run);
        assert_eq!(run.lost(), 0, "{name}");
    }
}
