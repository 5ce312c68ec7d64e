//! Accuracy over the size of the room, the resolution and the frame rate: simulated scenes, each compared with itself at scale 1, 640x480 and 30 Hz.
//!
//! `cargo run --release -p stillpoint --example scale -- SEEDS SECONDS [SCENE ...]`: a row per variant, with the median of the error over
//! the size of the scene, and how that compares.
#![allow(clippy::print_stdout)]

use stillpoint::evaluation::{EvalOptions, TimedPose, evaluate};
use stillpoint::geometry::Camera;
use stillpoint::imaging::Simd;
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Event, Outcome, System};

type Failure = Box<dyn std::error::Error>;

/// Scenes without people and with.
const SCENES: [&str; 3] = ["xyz", "halfsphere", "walking_xyz"];

/// What differs from the usual.
#[derive(Clone, Copy)]
struct Variant {
    scale: f64,
    /// Width of the image, px; its field of view stays the same.
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

/// A camera with the horizontal field of view of the simulator's own.
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

/// The error of a run, m, and how many of its frames have no pose.
fn run(scene: &str, seed: u64, seconds: f64, variant: &Variant) -> Result<(f64, usize), Failure> {
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
    let mut lost = 0;
    for i in 0..simulator.len() {
        for event in system.step(simulator.frame(i)) {
            if let Event::Frame(done) = event {
                lost += usize::from(matches!(done.report.outcome, Outcome::Lost { .. }));
            }
        }
    }
    system.finish();
    let truth: Vec<TimedPose> = simulator
        .ground_truth()
        .into_iter()
        .map(|(stamp, world_from_camera)| TimedPose {
            stamp,
            world_from_camera,
        })
        .collect();
    let poses: Vec<TimedPose> = system
        .corrected_trajectory()
        .into_iter()
        .map(|(entry, world_from_camera)| TimedPose {
            stamp: entry.stamp,
            world_from_camera,
        })
        .collect();
    let report = evaluate(&truth, &poses, &EvalOptions::default())?;
    Ok((report.ate.statistics.rmse, lost))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn main() -> Result<(), Failure> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let seeds: u64 = words.first().map_or(Ok(5), |w| w.parse())?;
    let seconds: f64 = words.get(1).map_or(Ok(10.0), |w| w.parse())?;
    let named: Vec<&str> = words.iter().skip(2).map(String::as_str).collect();
    let scenes = if named.is_empty() {
        &SCENES[..]
    } else {
        &named
    };
    println!("{seeds} seeds, {seconds} s; medians, errors divided by the scale\n");
    println!(
        "| scene | scale | resolution | rate, Hz | ATE / scale, mm | as to the usual | lost |"
    );
    println!("|---|---:|---|---:|---:|---:|---:|");
    for scene in scenes {
        let mut usual = f64::NAN;
        for variant in variants() {
            let (mut errors, mut lost) = (Vec::new(), 0);
            for seed in 0..seeds {
                let (error, without) = run(scene, seed, seconds, &variant)?;
                errors.push(1e3 * error / variant.scale);
                lost += without;
            }
            let error = median(errors);
            if usual.is_nan() {
                usual = error;
            }
            println!(
                "| `{scene}` | {} | {}x{} | {} | {error:.2} | {:.2} | {lost} |",
                variant.scale,
                variant.width,
                variant.height,
                variant.rate,
                error / usual,
            );
        }
    }
    Ok(())
}
