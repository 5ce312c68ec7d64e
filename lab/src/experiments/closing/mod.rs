//! Time and memory of closing one loop at the end of a long path: only the loop closer, on a synthetic map.
//!
//! Keyframes are 0.2 m apart on a circle. Each observes 400 of the points along it, twice as many as real ones, and further features that
//! no other keyframe observes; the last keyframes observe the points of the first. Times per span include nested spans: `recognise` and
//! `verify` (place recognition), `drift` and `straighten` (pose graph), `merge` (fusion), `adjust` (global bundle adjustment). One run per
//! process, to measure its peak memory.

mod memory;
#[path = "../../../../crates/slam/tests/closing/world.rs"]
mod world;

use crate::Failure;
use crate::experiments::shared::process::{computed, memory_mb};
use crate::experiments::shared::spans::{self, Spans};
use crate::table::{self, Table, figure};
use std::collections::BTreeMap;
use std::process::ExitCode;
use stillpoint::slam::{Config, LoopCloser, LoopCloserMsg};
use stillpoint::{estimation, features, geometry, map};
use world::{STEP_M, Walk, World};

const BACK: u32 = 30;

/// Measures time and memory of one loop closure after a long path
#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[arg(default_value_t = 2000, value_parser = clap::value_parser!(u32).range(100..))]
    keyframes: u32,
    /// Features of a keyframe
    #[arg(default_value_t = 1000)]
    features: usize,
}

fn tell_memory(walk: &Walk, places: usize, resident: f64) {
    let view = walk.map.view();
    let per_keyframe = 1.0 / view.keyframe_count() as f64;
    println!(
        "{} keyframes, {} landmarks\n",
        view.keyframe_count(),
        view.landmark_count()
    );
    let mut kinds = memory::of_map(&walk.map);
    kinds.push(("places", places));
    kinds.push(("all of these", kinds.iter().map(|k| k.1).sum()));
    let mut table = Table::new(["memory", "MB", "kB per keyframe"]);
    for (kind, bytes) in kinds {
        let (mb, kb) = (1e-6 * bytes as f64, 1e-3 * bytes as f64 * per_keyframe);
        table.row([kind.to_owned(), figure(mb, 1), figure(kb, 1)]);
    }
    table::print(&table);
    println!(
        "\nthe process {resident:.0} MB, with the world of {:.0} MB",
        walk.world_bytes() as f64 * 1e-6
    );
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (count, features) = (arguments.keyframes, arguments.features);
    Spans::Computed.start()?;
    let world = World::new(STEP_M * f64::from(count - BACK));
    let mut walk = Walk::new(world.with_clutter(features.saturating_sub(world::SEEN)));
    let mut loop_closer = LoopCloser::new(&Config::default());
    let mut slowest = 0.0f64;
    for k in 0..count {
        let (id, view) = walk.step();
        let before = memory_mb("VmRSS");
        let start = computed();
        let out = loop_closer.step(LoopCloserMsg::Keyframe { id, view });
        let seconds = computed() - start;
        let parts = spans::take();
        let (Some(report), Some(correction)) = (&out.report, &out.correction) else {
            slowest = slowest.max(seconds);
            continue;
        };
        println!("{report:?}");
        let places = out.places.keys().filter_map(|k| out.places.get(k));
        tell_memory(&walk, places.map(|v| v.bytes()).sum(), before);
        let most = memory_mb("VmHWM");
        let start = computed();
        let applied = walk.map.apply(correction);
        let apply = computed() - start;
        println!(
            "closed at keyframe {k} with {most:.0} MB at most, {} landmarks merged\n",
            applied.merged
        );
        let mut stages: BTreeMap<&str, f64> = BTreeMap::new();
        for ((_, stage), seconds) in parts {
            *stages.entry(stage).or_default() += seconds;
        }
        let others = [
            ("in all", seconds),
            ("applying it, in the mapper", apply),
            ("a step that closes nothing, at most", slowest),
        ];
        let mut table = Table::new(["part", "s"]);
        for (part, seconds) in stages.into_iter().chain(others) {
            table.row([part.to_owned(), figure(seconds, 3)]);
        }
        table::print(&table);
        return Ok(ExitCode::SUCCESS);
    }
    println!("no loop was closed in {count} keyframes");
    Ok(ExitCode::FAILURE)
}
