//! Tracking time per frame, by stage, without reading images and without a detector.
//!
//! For every frame and stage the minimum over identical passes counts, to exclude other load; the table has the median, the 99 % quantile
//! and the mean over the frames. `frame` contains the stages `extract` to `keyframe`, and `rest`, its remainder. Mapping, once per
//! keyframe, is not included.

use crate::Failure;
use crate::experiments::shared::next_readable;
use crate::experiments::shared::spans::{self, Spans, Times};
use crate::table::{self, Table, figure};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;
use stillpoint::datasets::FrameOptions;
use stillpoint::imaging::{RgbdFrame, Simd, Workers};
use stillpoint::recordings::{OpenOptions, open};
use stillpoint::slam::{Config, System};

const PARTS: [&str; 9] = [
    "extract", "depth", "flow", "motion", "filter", "match", "pose", "keyframe", "rest",
];

/// Measures the tracking time per frame, by stage, without reading images
#[derive(clap::Args)]
pub(crate) struct Arguments {
    path: PathBuf,
    /// Passes, of which the minimum times count
    #[arg(long, default_value_t = 5)]
    passes: usize,
    /// Number of frames, from the first
    #[arg(long, default_value_t = 300)]
    frames: usize,
    #[arg(long, default_value_t = 1)]
    threads: usize,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let workers = Workers::new(arguments.threads)?;
    let input = open(&arguments.path, &OpenOptions::default())?;
    let camera = input.camera().camera;
    let mut source = input.frames(&FrameOptions::default())?;
    let mut frames: Vec<RgbdFrame> = Vec::new();
    while frames.len() < arguments.frames
        && let Some(frame) = next_readable(&mut source)?
    {
        frames.push(frame);
    }
    Spans::Clock.start()?;
    let mut least: Vec<BTreeMap<&str, f64>> = vec![BTreeMap::new(); frames.len()];
    for _ in 0..arguments.passes {
        let system = System::new(Config::default(), camera, Simd::detect())?;
        let mut system = system.with_workers(workers.clone());
        for (frame, least) in frames.iter().zip(&mut least) {
            spans::take();
            drop(system.step(frame.clone()));
            keep_least(least, &spans::take());
        }
    }
    println!(
        "{}: {} frames, {} passes, {} threads, ms\n",
        arguments.path.display(),
        frames.len(),
        arguments.passes,
        arguments.threads
    );
    let mut table = Table::new(["part", "median", "99 %", "mean"]);
    for part in ["frame"].iter().chain(&PARTS) {
        let mut all: Vec<f64> = least.iter().filter_map(|f| f.get(part).copied()).collect();
        if all.is_empty() {
            continue;
        }
        all.sort_by(f64::total_cmp);
        let at = |share: f64| all[((all.len() - 1) as f64 * share).round() as usize];
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let ms = [at(0.5), at(0.99), mean].map(|s| figure(1e3 * s, 3));
        table.row([vec![(*part).to_owned()], ms.to_vec()].concat());
    }
    table::print(&table);
    Ok(ExitCode::SUCCESS)
}

/// Keeps the minimum time of every stage and of the remainder, without nested spans.
fn keep_least(least: &mut BTreeMap<&'static str, f64>, now: &Times) {
    let Some(frame) = now.get(&("", "frame")) else {
        return;
    };
    let within = now.iter().filter(|((around, _), _)| *around == "frame");
    let mut parts: BTreeMap<&str, f64> = within.map(|((_, name), s)| (*name, *s)).collect();
    let told: f64 = PARTS.iter().filter_map(|part| parts.get(part)).sum();
    parts.extend([("frame", *frame), ("rest", frame - told)]);
    for (part, seconds) in parts {
        let known = least.entry(part).or_insert(f64::INFINITY);
        *known = known.min(seconds);
    }
}
