//! `demo`: a simulated room through the system, with nothing to download.

use crate::args::DemoArgs;
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::output::ResultFolder;
use crate::run::{Setup, finish};
use crate::session::{Driver, Outputs};
use crate::summary::Input;
use crate::timing::Timing;
use crate::{config, console};
use stillpoint::datasets::{ReadAhead, StampedPose};
use stillpoint::simulator::{Simulator, SimulatorConfig};

/// `demo`.
pub(crate) fn demo(args: &DemoArgs, timing: &Timing) -> Result<Status, Failure> {
    let config = config::resolve(&args.config)?;
    let simd = config::simd()?;
    let simulator = Simulator::new(&SimulatorConfig {
        scene: args.scene.clone(),
        seed: config.seed,
        frames: Some(args.frames as usize),
        ..SimulatorConfig::default()
    })
    .map_err(Failure::input)?;
    let folder = ResultFolder::create(&args.out)?;
    console::info(&format!(
        "simulating scene {}: {} frames at 30 Hz, seed {}",
        args.scene,
        simulator.len(),
        config.seed
    ));
    let truth = ground_truth(&simulator);
    let camera = *simulator.camera();
    let interrupt = Interrupt::listen();
    let driver = Driver {
        config: config.clone(),
        camera,
        simd,
        timing,
        interrupt: &interrupt,
        detector: None,
    };
    let session = driver.drive(
        &mut ReadAhead::new(simulator.source()),
        &mut Outputs::default(),
    )?;
    let setup = Setup {
        input: Input {
            name: args.scene.clone(),
            layout: "simulated".to_owned(),
            camera: "simulator".to_owned(),
        },
        config: &config,
        simd,
        timing,
        truth: Some(&truth),
    };
    finish(&setup, &session, folder, &args.out)
}

/// The exact poses at the colour stamps.
pub(crate) fn ground_truth(simulator: &Simulator) -> Vec<StampedPose> {
    simulator
        .ground_truth()
        .into_iter()
        .map(|(stamp, world_from_camera)| StampedPose {
            stamp,
            world_from_camera,
        })
        .collect()
}
