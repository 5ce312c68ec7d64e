//! Effect of a setting on accuracy: the same simulated frames with different configurations.
//!
//! `cargo run --release -p stillpoint --example 03_score_and_configure`

use std::error::Error;
use std::io::Write;
use stillpoint::evaluation::{EvalOptions, TimedPose, evaluate};
use stillpoint::imaging::Simd;
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint::slam::{Config, System};

const FRAMES: usize = 60;

fn main() -> Result<(), Box<dyn Error>> {
    let room = Simulator::new(&SimulatorConfig {
        scene: "halfsphere".to_owned(),
        frames: Some(FRAMES),
        ..SimulatorConfig::default()
    })?;
    let timed = |(stamp, world_from_camera)| TimedPose {
        stamp,
        world_from_camera,
    };
    let truth: Vec<TimedPose> = room.ground_truth().into_iter().map(timed).collect();

    let mut out = std::io::stdout().lock();
    for features in [300, 1000, 2000] {
        let mut config = Config::default();
        config.features.features = features;
        let mut system = System::new(config, *room.camera(), Simd::detect())?;
        for i in 0..room.len() {
            system.step(room.frame(i));
        }
        system.finish();
        let view = system.view();
        let estimate: Vec<TimedPose> = system
            .trajectory()
            .resolve(&view)
            .map(|(entry, pose)| timed((entry.stamp, pose)))
            .collect();
        let score = evaluate(&truth, &estimate, &EvalOptions::default())?;
        writeln!(
            out,
            "{features} features: ATE {:.2} mm over {} of {FRAMES} frames, {} keyframes",
            score.ate.statistics.rmse * 1e3,
            score.pairs,
            view.keyframe_count()
        )?;
    }
    Ok(())
}
