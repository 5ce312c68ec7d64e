//! A long run: a simulated camera walks repeatedly through the same two rooms, in a map with limited keyframes. Prints memory, time per
//! frame and error per minute of camera time. The exit code is 1 if the last minute is worse than the second.
//!
//! Images have 320x240 px. The memory of a surface fused in the same run is also judged. The driver is inline, so poses and map are
//! reproducible. Time per frame is CPU time without rendering, relative to interleaved feature extractions from one fixed image, because
//! other load still slows it.

use crate::Failure;
use crate::experiments::shared::process::{computed, memory_mb};
use crate::experiments::shared::{self, ate_mm, code, map_poses};
use std::process::ExitCode;
use stillpoint::dense::{Dense, DenseConfig};
use stillpoint::evaluation::TimedPose;
use stillpoint::evaluation::timing::Stats;
use stillpoint::features::{Features, OrbConfig, OrbExtractor};
use stillpoint::geometry::Camera;
use stillpoint::imaging::{FrameId, GrayImage, Simd};
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Subscriber, System};

/// Tests whether memory, time or error grow on a long walk through the same two rooms
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Minutes of camera time
    #[arg(long, default_value_t = 10)]
    minutes: usize,
    /// Frames per second, of the 30 that are simulated
    #[arg(long, default_value_t = 15.0)]
    rate: f64,
    /// Maximum number of keyframes in the map
    #[arg(long, default_value_t = 200)]
    max_keyframes: usize,
    /// Also fuse a surface, with this limit on the memory of its stored frames, MB
    #[arg(long)]
    dense_mb: Option<f64>,
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

/// Maximum ratio between the last minute and the second.
const TOLERANCE: f64 = 1.1;

const RATE: f64 = 30.0;

struct Minute {
    memory_mb: f64,
    median_ms: f64,
    p95_ms: f64,
    /// Median time to extract the features of the fixed image.
    unit_ms: f64,
    ate_mm: f64,
    keyframes: usize,
    landmarks: usize,
    landmark_ids: usize,
    lost: usize,
    /// Memory of the surface.
    dense_mb: f64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let stride = (RATE / arguments.rate).round().max(1.0) as usize;
    let max_keyframes = arguments.max_keyframes;
    let mut config = Config {
        seed: arguments.seed,
        ..Config::default()
    };
    config.mapping.max_keyframes = max_keyframes;
    let simulator = Simulator::new(&SimulatorConfig {
        scene: "loop_two_rooms".to_owned(),
        camera: Camera::pinhole(320, 240, [267.5, 267.5, 159.5, 119.5]),
        ..SimulatorConfig::default()
    })?;
    let mut system = System::new(config, *simulator.camera(), Simd::detect())?;
    let surface = |mb: f64| {
        let config = DenseConfig {
            depth_budget: (1e6 * mb) as usize,
            ..DenseConfig::default()
        };
        Dense::new(&config, simulator.camera(), Simd::detect())
    };
    let mut dense = arguments.dense_mb.map(surface).transpose()?;
    println!(
        "two rooms, one round in {:.0} s, 320x240 px at {:.0} Hz, at most {max_keyframes} keyframes\n",
        simulator.len() as f64 / RATE,
        RATE / stride as f64
    );
    // Rows are printed immediately: a run takes hours.
    println!(
        "| minute | memory, MB | median, ms | p95, ms | unit, ms | ATE, mm | keyframes | landmarks | of ever made | lost | dense, MB |"
    );
    println!("|{}", "---:|".repeat(11));
    let per_minute = 60 * RATE as usize / stride;
    let mut all = Vec::new();
    let mut unit = Unit::new(simulator.frame(0).gray);
    for m in 0..arguments.minutes {
        let first = m * per_minute;
        let minute = walk(
            (&mut system, &mut dense),
            &simulator,
            first,
            per_minute,
            stride,
            &mut unit,
        )?;
        println!(
            "| {} | {:.1} | {:.2} | {:.2} | {:.2} | {:.1} | {} | {} | {} | {} | {:.1} |",
            m + 1,
            minute.memory_mb,
            minute.median_ms,
            minute.p95_ms,
            minute.unit_ms,
            minute.ate_mm,
            minute.keyframes,
            minute.landmarks,
            minute.landmark_ids,
            minute.lost,
            minute.dense_mb
        );
        all.push(minute);
    }
    Ok(verdict(&all))
}

fn walk(
    (system, dense): (&mut System, &mut Option<Dense>),
    simulator: &Simulator,
    first: usize,
    frames: usize,
    stride: usize,
    unit: &mut Unit,
) -> Result<Minute, Failure> {
    let mut times = Vec::with_capacity(frames);
    let mut units = Vec::new();
    let (mut lost, mut truth) = (0, Vec::with_capacity(frames));
    for i in first..first + frames {
        let mut frame = simulator.frame(i * stride);
        frame.id = FrameId(u32::try_from(i)?);
        truth.push(TimedPose {
            stamp: frame.stamp,
            world_from_camera: simulator.world_from_camera(frame.stamp),
        });
        let start = computed();
        let events = system.step(frame);
        times.push(1e3 * (computed() - start));
        if let Some(dense) = dense {
            dense.receive_all(&events);
        }
        if i % 10 == 0 {
            units.push(1e3 * unit.seconds());
        }
        lost += shared::lost(&events);
    }
    let view = system.view();
    let begin = truth.first().map_or(0.0, |p| p.stamp - 1e-6);
    let mut poses = map_poses(system);
    poses.retain(|p| p.stamp > begin);
    let times = Stats::of(&times);
    Ok(Minute {
        memory_mb: memory_mb("VmRSS"),
        median_ms: times.median,
        p95_ms: times.p95,
        unit_ms: Stats::of(&units).median,
        ate_mm: ate_mm(&truth, &poses)?,
        keyframes: view.keyframe_count(),
        landmarks: view.landmark_count(),
        landmark_ids: view.landmark_bound(),
        lost,
        dense_mb: dense.as_ref().map_or(0.0, |d| d.bytes() as f64 / 1e6),
    })
}

fn verdict(all: &[Minute]) -> ExitCode {
    let [_, second, .., last] = all else {
        println!("no verdict: less than three minutes");
        return ExitCode::SUCCESS;
    };
    let mut holds = true;
    for (name, second, last) in [
        ("memory", second.memory_mb, last.memory_mb),
        (
            "median time in units",
            second.median_ms / second.unit_ms,
            last.median_ms / last.unit_ms,
        ),
        (
            "p95 of time in units",
            second.p95_ms / second.unit_ms,
            last.p95_ms / last.unit_ms,
        ),
        ("ATE", second.ate_mm, last.ate_mm),
    ] {
        let ratio = last / second;
        let fine = ratio <= TOLERANCE;
        holds &= fine;
        let word = if fine { "holds" } else { "GROWS" };
        println!("{name}: {ratio:.3} of the second minute's: {word}");
    }
    code(holds)
}

/// A constant workload.
struct Unit {
    extractor: OrbExtractor,
    image: GrayImage,
    features: Features,
}

impl Unit {
    fn new(image: GrayImage) -> Self {
        Self {
            extractor: OrbExtractor::new(&OrbConfig::default(), Simd::detect()),
            image,
            features: Features::default(),
        }
    }

    fn seconds(&mut self) -> f64 {
        let start = computed();
        self.extractor.extract(&self.image, &mut self.features);
        computed() - start
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_growth_fails_the_soak() {
        let minute = |memory_mb: f64| Minute {
            memory_mb,
            median_ms: 2.0,
            p95_ms: 4.0,
            unit_ms: 1.0,
            ate_mm: 5.0,
            keyframes: 10,
            landmarks: 100,
            landmark_ids: 200,
            lost: 0,
            dense_mb: 0.0,
        };
        let of = |memory: [f64; 3]| verdict(&memory.map(minute));
        assert_eq!(of([50.0, 100.0, 105.0]), ExitCode::SUCCESS);
        assert_eq!(of([50.0, 100.0, 120.0]), ExitCode::FAILURE);
    }
}
