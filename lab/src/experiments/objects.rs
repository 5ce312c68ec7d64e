//! Tracked people compared with ground truth: scenes with a detector that misses 30 %.
//!
//! A row per scene, with the median over the seeds and, in brackets, the worst.

use crate::Failure;
use crate::experiments::shared::{each_seed, scene, script, scripted};
use crate::table::{self, Table, spread};
use std::process::ExitCode;
use stillpoint::detection::{ClassId, ObjectState};
use stillpoint::evaluation::objects::{
    PointMotion, TrackFrame, TrackOptions, TrackScore, TrackedBox, track_score,
};
use stillpoint::imaging::Simd;
use stillpoint::simulator::{DetectionNoise, FrameTruth};
use stillpoint::slam::{Config, Event, FrameReport, System};

const SCENES: [&str; 7] = [
    "walking_xyz",
    "walking_static",
    "walking_halfsphere",
    "walking_rpy",
    "sitting_xyz",
    "crowd_xyz",
    "crowd_static",
];
/// Minimum visible area of a person who must be found, px; the value of `eval --objects`.
const LEAST_VISIBLE: usize = 1500;

/// With `--alarms`: probability of a false alarm per frame.
const FALSE_ALARM: f64 = 0.1;
/// With `--bursts`: probability per person and frame that a burst of misses begins, one in 7 s at 30 Hz.
const BURST: f64 = 0.005;

/// Evaluates tracks of simulated people, who are missed in 30 % of the frames
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Seeds per scene
    #[arg(long, default_value_t = 5)]
    seeds: u64,
    /// Frames per run
    #[arg(long, default_value_t = 300)]
    frames: usize,
    /// Add false alarms of the detector
    #[arg(long)]
    alarms: bool,
    /// Add bursts of misses of the detector
    #[arg(long)]
    bursts: bool,
    /// Simulated scenes
    #[arg(default_values = SCENES)]
    scenes: Vec<String>,
}

fn compared(truth: &FrameTruth, report: &FrameReport) -> TrackFrame {
    let mut frame = TrackFrame {
        stamp: report.stamp,
        ..TrackFrame::default()
    };
    for b in truth.boxes.iter().filter(|b| b.class == "person") {
        let bounds = [b.x0, b.y0, b.x1, b.y1];
        if b.visible_px < LEAST_VISIBLE {
            frame.ignored.push(bounds);
            continue;
        }
        frame.truth.push(TrackedBox {
            id: b.mover,
            bounds,
            motion: b.motion.map(|m| PointMotion {
                position: m.position.into(),
                velocity: m.velocity.into(),
            }),
        });
    }
    for o in report.objects.iter() {
        let said = matches!(o.state, ObjectState::Confirmed | ObjectState::Coasting);
        if o.class == ClassId::PERSON && said && o.bounds.area() > 0.0 {
            let motion = o.position.zip(o.velocity);
            frame.found.push(TrackedBox {
                id: o.id.0,
                bounds: [o.bounds.x0, o.bounds.y0, o.bounds.x1, o.bounds.y1],
                motion: motion.map(|(position, velocity)| PointMotion { position, velocity }),
            });
        }
    }
    frame
}

fn measure(
    name: &str,
    seed: u64,
    frames: usize,
    noise: &DetectionNoise,
) -> Result<TrackScore, Failure> {
    let simulator = scene(name, seed, Some(frames))?;
    let detector = scripted(&script(&simulator, noise)?)?;
    let system = System::new(Config::default(), *simulator.camera(), Simd::detect())?;
    let mut system = system.with_detector(detector);
    let mut pairs = Vec::new();
    for i in 0..simulator.len() {
        let events = system.step(simulator.frame(i));
        let done = events.iter().filter_map(Event::as_frame);
        pairs.extend(done.map(|done| compared(&simulator.truth(i), &done.report)));
    }
    Ok(track_score(&pairs, &TrackOptions::default()))
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (seeds, frames) = (arguments.seeds, arguments.frames);
    let mut noise = DetectionNoise::default();
    if arguments.alarms {
        noise.false_alarm = FALSE_ALARM;
    }
    if arguments.bursts {
        noise.burst = BURST;
    }
    println!("{seeds} seeds, {frames} frames; median (worst)\n");
    let mut table = Table::new("scene | MOTA | IDF1 | HOTA | switches | ids of 2 people | ghosts per frame | speed error, m/s".split(" | "));
    for scene in &arguments.scenes {
        let scores = each_seed(seeds, |seed| measure(scene, seed, frames, &noise))?;
        // The worst is the minimum of figures that should be large, else the maximum.
        let cell = |digits: usize, worst: usize, f: &dyn Fn(&TrackScore) -> f64| {
            let spread = spread(scores.iter().map(f));
            format!("{:.digits$} ({:.digits$})", spread[0], spread[worst])
        };
        let (least, greatest) = (1, 2);
        table.row([
            format!("`{scene}`"),
            cell(3, least, &|s| s.clear.mota),
            cell(3, least, &|s| s.identity.f1),
            cell(3, least, &|s| s.hota.hota),
            cell(0, greatest, &|s| s.clear.id_switches as f64),
            cell(0, greatest, &|s| s.found_ids as f64),
            cell(3, greatest, &|s| s.ghosts_per_frame),
            cell(3, greatest, &|s| {
                s.motion.speed.map_or(f64::NAN, |v| v.median)
            }),
        ]);
    }
    table::print(&table);
    Ok(ExitCode::SUCCESS)
}
