//! A long run: a simulated camera walks through the same two rooms again and again, in a map with a limit on its keyframes. Tells, for
//! every minute of camera time, memory, time per frame and error, and whether the last minute is worse than the second.
//!
//! `cargo run --release -p stillpoint --example soak -- [MINUTES] [HZ] [MAX_KEYFRAMES] [DENSE_MB] [SEED]`; 10 minutes at 15 Hz with at most 200
//! keyframes by default, 320x240 px. With DENSE_MB a surface is fused beside it, whose kept frames may take so much; what it
//! takes is told, and is part of the memory that is judged.
//! The driver is the inline one, so that poses and map are the same on every machine. Time per frame is the time that the thread
//! was on a processor, where the system tells that, without rendering. Who else uses the machine slows it all the same; so it is compared by
//! the time that the features of one and the same image take in between.
#![allow(clippy::print_stdout)]

use std::process::ExitCode;
use std::time::Instant;
use stillpoint::dense::{Dense, DenseConfig};
use stillpoint::evaluation::{EvalOptions, TimedPose, evaluate};
use stillpoint::features::{Features, OrbConfig, OrbExtractor};
use stillpoint::geometry::Camera;
use stillpoint::imaging::{FrameId, GrayImage, Simd};
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Event, Outcome, Subscriber, System};

type Failure = Box<dyn std::error::Error>;

/// How much worse than the second minute the last one may be.
const TOLERANCE: f64 = 1.1;

/// Frames per second of the simulator.
const RATE: f64 = 30.0;

/// What was measured in one minute of camera time.
struct Minute {
    memory_mb: f64,
    median_ms: f64,
    p95_ms: f64,
    /// Time for the features of always the same image, median.
    unit_ms: f64,
    ate_mm: f64,
    keyframes: usize,
    landmarks: usize,
    landmark_ids: usize,
    lost: usize,
    /// Of the surface.
    dense_mb: f64,
}

fn main() -> Result<ExitCode, Failure> {
    let mut arguments = std::env::args().skip(1);
    let mut next = |default: f64| arguments.next().map_or(Ok(default), |a| a.parse::<f64>());
    let (minutes, hertz, max_keyframes) = (next(10.0)?, next(15.0)?, next(200.0)?);
    let (dense_mb, seed) = (next(0.0)?, next(0.0)?);
    let stride = (RATE / hertz).round().max(1.0) as usize;
    let mut config = Config {
        seed: seed as u64,
        ..Config::default()
    };
    config.mapping.max_keyframes = max_keyframes as usize;
    let simulator = Simulator::new(&SimulatorConfig {
        scene: "loop_two_rooms".to_owned(),
        camera: Camera::pinhole(320, 240, [267.5, 267.5, 159.5, 119.5]),
        ..SimulatorConfig::default()
    })?;
    let mut system = System::new(config, *simulator.camera(), Simd::detect())?;
    let dense = DenseConfig {
        depth_budget: (1e6 * dense_mb) as usize,
        ..DenseConfig::default()
    };
    let mut dense = match dense_mb > 0.0 {
        true => Some(Dense::new(&dense, simulator.camera(), Simd::detect())?),
        false => None,
    };
    println!(
        "two rooms, one round in {:.0} s, 320x240 px at {:.0} Hz, at most {max_keyframes} keyframes",
        simulator.len() as f64 / RATE,
        RATE / stride as f64
    );
    println!(
        "minute | memory MB | median ms | p95 ms | unit ms | ATE mm | keyframes | landmarks | of ever made | lost | dense MB"
    );
    let per_minute = 60 * RATE as usize / stride;
    let mut all = Vec::new();
    let mut unit = Unit::new(simulator.frame(0).gray);
    for m in 0..minutes as usize {
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
            "{:6} | {:9.1} | {:9.2} | {:6.2} | {:7.2} | {:6.1} | {:9} | {:9} | {:12} | {:4} | {:.1}",
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

/// Walks for a minute.
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
        let stopwatch = Stopwatch::start();
        let events = system.step(frame);
        times.push(1e3 * stopwatch.seconds());
        if let Some(dense) = dense {
            dense.receive_all(&events);
        }
        if i % 10 == 0 {
            units.push(1e3 * unit.seconds());
        }
        lost += events.iter().filter(|e| is_lost(e)).count();
    }
    times.sort_by(f64::total_cmp);
    units.sort_by(f64::total_cmp);
    let view = system.view();
    let begin = truth.first().map_or(0.0, |p| p.stamp - 1e-6);
    let poses: Vec<TimedPose> = system
        .trajectory()
        .resolve(&view)
        .filter(|(entry, _)| entry.stamp > begin)
        .map(|(entry, world_from_camera)| TimedPose {
            stamp: entry.stamp,
            world_from_camera,
        })
        .collect();
    let score = evaluate(&truth, &poses, &EvalOptions::default())?;
    Ok(Minute {
        memory_mb: memory_mb().unwrap_or(f64::NAN),
        median_ms: times[times.len() / 2],
        p95_ms: times[times.len() * 95 / 100],
        unit_ms: units[units.len() / 2],
        ate_mm: score.ate.statistics.rmse * 1e3,
        keyframes: view.keyframe_count(),
        landmarks: view.landmark_count(),
        landmark_ids: view.landmark_bound(),
        lost,
        dense_mb: dense.as_ref().map_or(0.0, |d| d.bytes() as f64 / 1e6),
    })
}

fn is_lost(event: &Event) -> bool {
    matches!(event, Event::Frame(f) if matches!(f.report.outcome, Outcome::Lost { .. }))
}

/// Compares the last minute with the second.
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
    if holds {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// Work that is always the same.
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
        let stopwatch = Stopwatch::start();
        self.extractor.extract(&self.image, &mut self.features);
        stopwatch.seconds()
    }
}

/// Time of this thread on a processor, or time by the clock where the system does not give that.
struct Stopwatch(Option<f64>, Instant);

impl Stopwatch {
    fn start() -> Self {
        Self(processor_seconds(), Instant::now())
    }

    fn seconds(&self) -> f64 {
        let on_processor = processor_seconds()
            .zip(self.0)
            .map(|(now, then)| now - then);
        on_processor.unwrap_or_else(|| self.1.elapsed().as_secs_f64())
    }
}

fn processor_seconds() -> Option<f64> {
    // The kernel counts a running thread's time at its ticks, some milliseconds apart, and whenever it makes way for another.
    std::thread::yield_now();
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let nanoseconds: f64 = text.split_ascii_whitespace().next()?.parse().ok()?;
    Some(1e-9 * nanoseconds)
}

/// Resident memory of this process.
fn memory_mb() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages: f64 = text.split_ascii_whitespace().nth(1)?.parse().ok()?;
    // Linux has pages of 4 KiB on all machines that this is likely to run on.
    Some(pages * 4096.0 / 1e6)
}
