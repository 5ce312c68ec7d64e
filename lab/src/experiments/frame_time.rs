//! How long tracking takes per frame, and its parts, without reading images and without a detector.
//!
//! All passes do the same, to the bit. Of every frame and part the least time of the passes counts, so that who else uses the machine is left out as far
//! as possible; said are the median, the 99 % quantile and the mean over the frames. The part `frame` holds the parts `extract` to `keyframe`; what is left
//! of it is said as `rest`. Mapping takes place once per keyframe and is not in it.

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

/// The parts of a frame.
const PARTS: [&str; 9] = [
    "extract", "depth", "flow", "motion", "filter", "match", "pose", "keyframe", "rest",
];

/// How long tracking takes per frame, and its parts, without reading images.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Data set folder or recording
    path: PathBuf,
    /// Passes, of which the least times count
    #[arg(long, default_value_t = 5)]
    passes: usize,
    /// Frames, from the beginning
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

/// Takes the lesser time of every part, with what is in none. What is not in a frame, or is a part of a part, is left out.
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
