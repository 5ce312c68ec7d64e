//! Time and memory of closing one loop at the end of a long path: the loop closer alone, on a synthetic map of so many keyframes.
//!
//! `cargo run --release -p stillpoint-slam --example closing -- 2000`. Keyframes are 0.2 m apart on one circle and see 400 of the
//! points along it; the last ones see what the first ones saw. One run per process, so that its peak memory is its own. Times
//! are of the processor, which a loaded machine does not stretch; not a number where the system does not tell.
#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs)]
// The library reads no clock and no file; what measures it has to.
#![allow(clippy::disallowed_types, clippy::disallowed_methods)]

mod stages;
mod world;

use stages::{Stages, computed};
use stillpoint_slam::{Config, LoopCloser, LoopCloserMsg, LoopOutcome};
use world::{STEP_M, Walk, World};

/// A figure of this process in MB, where the system tells.
fn memory(which: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with(which));
    let kb = line.and_then(|l| l.split_whitespace().nth(1)?.parse::<f64>().ok());
    kb.map_or(f64::NAN, |kb| kb * 1024e-6)
}

fn main() {
    let count: u32 = std::env::args().nth(1).map_or(2000, |a| a.parse().unwrap());
    // A second subscriber would be the caller's mistake, and there is none.
    let _ = tracing::subscriber::set_global_default(Stages);
    // The last thirty keyframes see the beginning again.
    let mut walk = Walk::new(World::new(STEP_M * f64::from(count - 30)));
    let mut loop_closer = LoopCloser::new(&Config::default());
    let mut slowest = 0.0f64;
    for k in 0..count {
        let (id, view) = walk.step();
        let before = memory("VmRSS");
        let start = computed();
        let out = loop_closer.step(LoopCloserMsg::Keyframe { id, view });
        let seconds = computed() - start;
        let parts = stages::take();
        let Some(report) = out.report.filter(|r| r.outcome == LoopOutcome::Closed) else {
            slowest = slowest.max(seconds);
            continue;
        };
        println!("{report:?}");
        for (stage, seconds) in parts {
            println!("{stage:>12} {seconds:6.3} s");
        }
        println!(
            "closed at keyframe {k} in {seconds:.2} s; steps that close nothing take {:.1} ms at most; memory {before:.0} MB before, {:.0} MB at most",
            slowest * 1e3,
            memory("VmHWM"),
        );
        let start = computed();
        let applied = walk.map.apply(&out.correction.unwrap());
        let seconds = computed() - start;
        println!(
            "applied in {seconds:.3} s, {} landmarks merged",
            applied.merged
        );
        return;
    }
    println!("no loop was closed in {count} keyframes");
}
