//! How long tracking takes per frame, and its parts, without reading images and without a detector.
//!
//! `cargo run --release -p stillpoint --example frame_time -- PATH [PASSES] [FRAMES] [THREADS]`; 5 passes over the first 300 frames of a data set
//! folder or recording, by one thread, by default. All passes do the same, to the bit. Of every frame and part the least time of the passes counts, so that
//! who else uses the machine is left out as far as possible; said are the median, the 99 % quantile and the mean over the frames. The part `frame`
//! holds the parts `extract` to `keyframe`; what is left of it is said as `rest`. Mapping takes place once per keyframe and is not in it.
#![allow(clippy::print_stdout)]

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use stillpoint::imaging::{FrameSource, RgbdFrame, Simd, Workers};
use stillpoint::recordings::{OpenOptions, open};
use stillpoint::slam::{Config, System};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Metadata, Subscriber};

type Failure = Box<dyn std::error::Error>;

/// The parts of a frame.
const PARTS: [&str; 9] = [
    "extract", "depth", "flow", "motion", "filter", "match", "pose", "keyframe", "rest",
];

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("expected a folder or a recording")?;
    let mut next = |default: usize| arguments.next().map_or(Ok(default), |a| a.parse::<usize>());
    let (passes, count, threads) = (next(5)?.max(1), next(300)?, next(1)?);
    let workers = Workers::new(threads)?;
    let input = open(Path::new(&path), &OpenOptions::default())?;
    let camera = input.camera().camera;
    let mut source = input.frames(&stillpoint::datasets::FrameOptions::default())?;
    let mut frames: Vec<RgbdFrame> = Vec::new();
    while let Some(frame) = source.next_frame().filter(|_| frames.len() < count) {
        match frame {
            Ok(frame) => frames.push(frame),
            Err(e) if e.recoverable => {}
            Err(e) => return Err(e.into()),
        }
    }
    let times = Arc::new(Spans::default());
    tracing::subscriber::set_global_default(Arc::clone(&times))?;
    let mut least: Vec<BTreeMap<&str, f64>> = vec![BTreeMap::new(); frames.len()];
    for _ in 0..passes {
        let system = System::new(Config::default(), camera, Simd::detect())?;
        let mut system = system.with_workers(workers.clone());
        for (frame, least) in frames.iter().zip(&mut least) {
            times.take();
            drop(system.step(frame.clone()));
            keep_least(least, times.take());
        }
    }
    println!(
        "{path}: {} frames, {passes} passes, {threads} threads, ms",
        frames.len()
    );
    println!("part     | median |   99 % |   mean");
    for part in ["frame"].iter().chain(&PARTS) {
        let mut all: Vec<f64> = least.iter().filter_map(|f| f.get(part).copied()).collect();
        if all.is_empty() {
            continue;
        }
        all.sort_by(f64::total_cmp);
        let at = |share: f64| all[((all.len() - 1) as f64 * share).round() as usize];
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        println!("{part:8} | {:6.3} | {:6.3} | {mean:6.3}", at(0.5), at(0.99));
    }
    Ok(())
}

/// Takes the lesser time of every part, with what is in none.
fn keep_least(least: &mut BTreeMap<&'static str, f64>, mut now: BTreeMap<&'static str, f64>) {
    let parts: f64 = PARTS.iter().filter_map(|p| now.get(p)).sum();
    if let Some(frame) = now.get("frame") {
        let rest = frame - parts;
        now.insert("rest", rest);
    }
    for (part, ms) in now {
        let known = least.entry(part).or_insert(f64::INFINITY);
        *known = known.min(ms);
    }
}

/// Sums the time in spans by their names, ms: only what is within a frame, and not what is within another part.
#[derive(Default)]
struct Spans(Mutex<Running>);

#[derive(Default)]
struct Running {
    names: Vec<&'static str>,
    open: Vec<(u64, Instant)>,
    sums: BTreeMap<&'static str, Duration>,
}

impl Spans {
    fn locked(&self) -> std::sync::MutexGuard<'_, Running> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn take(&self) -> BTreeMap<&'static str, f64> {
        let sums = std::mem::take(&mut self.locked().sums);
        let ms = |(name, d): (_, Duration)| (name, d.as_secs_f64() * 1e3);
        sums.into_iter().map(ms).collect()
    }
}

impl Subscriber for Spans {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.is_span()
    }

    fn new_span(&self, span: &Attributes<'_>) -> Id {
        let mut running = self.locked();
        let name = span.metadata().name();
        // A span is known by its name: parts of one name are summed anyway.
        let known = running.names.iter().position(|n| *n == name);
        let place = known.unwrap_or_else(|| {
            running.names.push(name);
            running.names.len() - 1
        });
        Id::from_u64(place as u64 + 1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, _: &Event<'_>) {}

    fn enter(&self, span: &Id) {
        self.locked()
            .open
            .push((span.into_u64() - 1, Instant::now()));
    }

    fn exit(&self, _: &Id) {
        let now = Instant::now();
        let mut running = self.locked();
        let Some((place, begun)) = running.open.pop() else {
            return;
        };
        let name = running.names[place as usize];
        let within_frame =
            running.open.len() == 1 && running.names[running.open[0].0 as usize] == "frame";
        if within_frame || name == "frame" && running.open.is_empty() {
            *running.sums.entry(name).or_default() += now - begun;
        }
    }
}
