//! What tracking asks the allocator for, per frame that becomes no keyframe, by the parts of a frame.
//!
//! `cargo run --release -p stillpoint --example allocations -- [SCENE] [FRAMES]`; 170 frames of `walking_xyz` by default, of which the first 110
//! are left out: until then the filter's history of 3.2 s fills. Every part is without the parts within it.
#![allow(clippy::print_stdout)]

#[path = "../tests/counting.rs"]
mod counting;

use std::collections::BTreeMap;
use stillpoint::imaging::Simd;
use stillpoint::simulator::{Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Event, System};

/// Frames that are left out.
const STEADY: usize = 110;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().unwrap_or_else(|| "walking_xyz".to_owned());
    let count = arguments.next().map_or(Ok(170), |a| a.parse::<usize>())?;
    let simulator = Simulator::new(&SimulatorConfig {
        scene: scene.clone(),
        ..SimulatorConfig::default()
    })?;
    let mut system = System::new(Config::default(), *simulator.camera(), Simd::detect())?;
    let mut sums: BTreeMap<&str, [u64; 2]> = BTreeMap::new();
    let mut frames = 0;
    for i in 0..count.min(simulator.len()) {
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
    println!("{scene}: {frames} frames that became no keyframe, per frame");
    println!("part         |   calls |      kB");
    for (part, [calls, bytes]) in sums {
        let per = |sum: u64| sum as f64 / frames.max(1) as f64;
        println!("{part:12} | {:7.1} | {:7.1}", per(calls), per(bytes) / 1e3);
    }
    Ok(())
}
