//! Allocations of tracking by stage, without nested stages, per frame that becomes no keyframe.

// A global allocator, which costs other experiments a thousandth of a frame's time.
#[path = "../../../crates/stillpoint/tests/counting.rs"]
mod counting;

use crate::Failure;
use crate::experiments::shared::scene;
use crate::table::{self, Table, figure};
use std::collections::BTreeMap;
use std::process::ExitCode;
use stillpoint::imaging::Simd;
use stillpoint::slam::{Config, Event, System};

/// Skipped frames: until then the filter's history of 3.2 s fills.
const STEADY: usize = 110;

/// Counts allocations of tracking, per frame that becomes no keyframe
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Simulated scene
    #[arg(default_value = "walking_xyz")]
    scene: String,
    /// Frames, of which the first 110 are skipped
    #[arg(long, default_value_t = 170)]
    frames: usize,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let simulator = scene(&arguments.scene, 0, None)?;
    let mut system = System::new(Config::default(), *simulator.camera(), Simd::detect())?;
    let mut sums: BTreeMap<&str, [u64; 2]> = BTreeMap::new();
    let mut frames = 0;
    for i in 0..arguments.frames.min(simulator.len()) {
        let frame = simulator.frame(i);
        let events = tracing::subscriber::with_default(counting::Spans, || system.step(frame));
        let parts = counting::take();
        let keyframe = events.iter().any(|e| matches!(e, Event::Mapped { .. }));
        if i < STEADY || keyframe {
            continue;
        }
        frames += 1;
        for (part, asked) in parts {
            let [calls, bytes] = sums.entry(part).or_default();
            *calls += asked.calls;
            *bytes += asked.bytes;
        }
    }
    println!(
        "{}: {frames} frames that became no keyframe, per frame\n",
        arguments.scene
    );
    let mut table = Table::new(["part", "calls", "kB"]);
    for (part, [calls, bytes]) in sums {
        let per = |sum: u64| sum as f64 / f64::from(frames);
        table.row([
            part.to_owned(),
            figure(per(calls), 1),
            figure(per(bytes) / 1e3, 1),
        ]);
    }
    table::print(&table);
    Ok(ExitCode::SUCCESS)
}
