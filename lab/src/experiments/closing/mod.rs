//! Time and memory of closing one loop at the end of a long path: the loop closer alone, on a synthetic map of so many keyframes.
//!
//! `cargo run --release -p stillpoint-slam --example closing -- [KEYFRAMES] [FEATURES]`; 2000 keyframes of 1000 features by default. Keyframes are
//! 0.2 m apart on one circle and see 400 of the points along it, which is twice what real ones see, and the rest of their features once; the
//! last ones see what the first ones saw. Time of each part of closing by its span, parts inside others too: `recognise` and `verify` (finding the place),
//! `drift` and `straighten` (pose graph), `merge` (fusing), `adjust` (bundle adjustment of all). One run per process, so that its peak memory is its own. Times
//! are of the processor, which a loaded machine does not stretch; of the clock where the system does not tell.
#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs)]
// The library reads no clock and no file; what measures it has to.
#![allow(clippy::disallowed_types, clippy::disallowed_methods)]

mod memory;
mod stages;
mod world;

use stages::{Stages, computed};
use stillpoint_slam::{Config, LoopCloser, LoopCloserMsg, LoopOutcome};
use world::{STEP_M, Walk, World};

/// Features of an image, at most.
const FEATURES: usize = 1000;

/// What the map takes, by kind, and the process.
fn tell_memory(walk: &Walk, places: usize, resident: f64) {
    let view = walk.map.view();
    let per_keyframe = 1.0 / view.keyframe_count() as f64;
    println!(
        "{} keyframes, {} landmarks",
        view.keyframe_count(),
        view.landmark_count()
    );
    let mut kinds = memory::of_map(&walk.map);
    kinds.push(("places", places));
    kinds.push(("all of these", kinds.iter().map(|k| k.1).sum()));
    for (kind, bytes) in kinds {
        let bytes = bytes as f64;
        println!(
            "{kind:>22} {:8.1} MB {:8.1} kB per keyframe",
            bytes * 1e-6,
            bytes * per_keyframe * 1e-3,
        );
    }
    println!(
        "the process {resident:.0} MB, with the world of {:.0} MB",
        walk.world_bytes() as f64 * 1e-6
    );
}

fn main() {
    let mut words = std::env::args().skip(1);
    let mut next = |default: usize| words.next().map_or(default, |a| a.parse().unwrap());
    let (count, features) = (next(2000) as u32, next(FEATURES));
    // A second subscriber would be the caller's mistake, and there is none.
    let _ = tracing::subscriber::set_global_default(Stages);
    // The last thirty keyframes see the beginning again.
    let world = World::new(STEP_M * f64::from(count - 30));
    let mut walk = Walk::new(world.with_clutter(features.saturating_sub(world::SEEN)));
    let mut loop_closer = LoopCloser::new(&Config::default());
    let mut slowest = 0.0f64;
    for k in 0..count {
        let (id, view) = walk.step();
        let before = memory::of_process("VmRSS");
        let start = computed();
        let out = loop_closer.step(LoopCloserMsg::Keyframe { id, view });
        let seconds = computed() - start;
        let parts = stages::take();
        let Some(report) = out.report.filter(|r| r.outcome == LoopOutcome::Closed) else {
            slowest = slowest.max(seconds);
            continue;
        };
        println!("{report:?}");
        let places = out.places.keys().filter_map(|k| out.places.get(k));
        tell_memory(&walk, places.map(|v| v.bytes()).sum(), before);
        println!("closed at keyframe {k} in {seconds:.2} s, of which");
        for (stage, seconds) in parts {
            println!("{stage:>22} {seconds:8.3} s");
        }
        println!(
            "steps that close nothing take {:.1} ms at most; memory while closing {:.0} MB at most",
            slowest * 1e3,
            memory::of_process("VmHWM"),
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
