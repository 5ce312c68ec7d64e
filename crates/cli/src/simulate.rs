//! `simulate`: a data set of a simulated room, with exact ground truth.

use crate::args::SimulateArgs;
use crate::console::{self, Progress};
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use stillpoint::datasets::{ColourFormat, ReadAhead, Recorder};
use stillpoint::imaging::FrameSource;
use stillpoint::simulator::{Simulator, SimulatorConfig};

/// `simulate`.
pub(crate) fn simulate(args: &SimulateArgs) -> Result<Status, Failure> {
    let simulator = Simulator::new(&SimulatorConfig {
        scene: args.scene.clone(),
        seed: args.seed,
        frames: args.frames.map(|n| n as usize),
        noise: !args.ideal,
        ..SimulatorConfig::default()
    })
    .map_err(Failure::input)?;
    let format = if args.jpeg {
        ColourFormat::Jpeg
    } else {
        ColourFormat::Png
    };
    let poses = simulator.ground_truth();
    let name = format!("simulated {}", args.scene);
    let mut recorder = Recorder::create(&args.out, simulator.camera(), &name, format)?;
    let interrupt = Interrupt::listen();
    let mut progress = Progress::new(Some(simulator.len()));
    let mut frames = ReadAhead::new(simulator.source().with_colour());
    let mut written = 0;
    while let Some(frame) = frames.next_frame() {
        let frame = frame.map_err(Failure::input)?;
        recorder.add(&frame, poses.get(written).map(|(_, p)| p))?;
        written += 1;
        progress.show(written, "");
        if interrupt.requested() {
            break;
        }
    }
    progress.finish();
    recorder.finish()?;
    if interrupt.requested() {
        console::line(&format!(
            "interrupted: {written} of {} frames were written",
            poses.len()
        ));
        return Ok(Status::Failed);
    }
    console::report(&format!("{written} frames in {}\n", args.out.display()));
    Ok(Status::Ok)
}
