//! Accuracy over room size, resolution and frame rate: scenes compared with themselves at scale 1, 640x480 and 30 Hz.
//!
//! A row per variant, with the median error relative to the scene's size, and its ratio to the reference.

use crate::Failure;
use crate::experiments::shared::{ate_mm, each_seed, final_poses, lost, truth};
use crate::table::{self, Table, figure, spread};
use std::process::ExitCode;
use stillpoint::geometry::Camera;
use stillpoint::imaging::Simd;
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint::slam::{Config, System};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Seeds per scene
    #[arg(long, default_value_t = 5)]
    seeds: u64,
    /// Duration of every run, s
    #[arg(long, default_value_t = 10.0)]
    seconds: f64,
    /// Simulated scenes, without people and with
    #[arg(default_values = ["xyz", "halfsphere", "walking_xyz"])]
    scenes: Vec<String>,
}

#[derive(Clone, Copy)]
struct Variant {
    scale: f64,
    /// Width of the image, px; the field of view stays the same.
    width: u32,
    height: u32,
    rate: f64,
}

const USUAL: Variant = Variant {
    scale: 1.0,
    width: 640,
    height: 480,
    rate: 30.0,
};

fn variants() -> Vec<Variant> {
    let mut all = vec![USUAL];
    all.extend([0.5, 2.0, 4.0].map(|scale| Variant { scale, ..USUAL }));
    all.extend([(320, 240), (1280, 720)].map(|(width, height)| Variant {
        width,
        height,
        ..USUAL
    }));
    all.extend([10.0, 15.0, 60.0].map(|rate| Variant { rate, ..USUAL }));
    all
}

/// A camera with the horizontal field of view of the simulator's default.
fn camera(variant: &Variant) -> Camera {
    let own = SimulatorConfig::default().camera;
    let zoom = f64::from(variant.width) / f64::from(own.width);
    let middle = |side: u32| 0.5 * f64::from(side) - 0.5;
    Camera::pinhole(
        variant.width,
        variant.height,
        [
            zoom * own.fx,
            zoom * own.fy,
            middle(variant.width),
            middle(variant.height),
        ],
    )
}

/// The ATE of a run, mm, and its number of frames without a pose.
fn measure(
    scene: &str,
    seed: u64,
    seconds: f64,
    variant: &Variant,
) -> Result<(f64, usize), Failure> {
    let simulator = Simulator::new(&SimulatorConfig {
        scene: scene.to_owned(),
        seed,
        frames: Some((seconds * variant.rate) as usize),
        rate: variant.rate,
        scale: variant.scale,
        camera: camera(variant),
        ..SimulatorConfig::default()
    })?;
    let mut system = System::new(Config::default(), *simulator.camera(), Simd::detect())?;
    let frames = (0..simulator.len()).map(|i| simulator.frame(i));
    let lost = frames.map(|frame| lost(&system.step(frame))).sum();
    system.finish();
    let error = ate_mm(&truth(&simulator), &final_poses(&system))?;
    Ok((error, lost))
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (seeds, seconds) = (arguments.seeds, arguments.seconds);
    println!("{seeds} seeds, {seconds} s; medians, errors divided by the scale\n");
    let mut table = Table::new(
        "scene | scale | resolution | rate, Hz | ATE / scale, mm | as to the usual | lost"
            .split(" | "),
    );
    for scene in &arguments.scenes {
        let mut usual = f64::NAN;
        for variant in variants() {
            let runs = each_seed(seeds, |seed| measure(scene, seed, seconds, &variant))?;
            let [error, ..] = spread(runs.iter().map(|r| r.0 / variant.scale));
            let lost: usize = runs.iter().map(|r| r.1).sum();
            if usual.is_nan() {
                usual = error;
            }
            table.row([
                format!("`{scene}`"),
                variant.scale.to_string(),
                format!("{}x{}", variant.width, variant.height),
                variant.rate.to_string(),
                figure(error, 2),
                figure(error / usual, 2),
                lost.to_string(),
            ]);
        }
    }
    table::print(&table);
    Ok(ExitCode::SUCCESS)
}
