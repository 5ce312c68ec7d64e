//! `bench --document`: measures everything that docs/benchmarks.md shows, on one machine, in one go.
//!
//! Simulated scenes are always among the sequences, so that there is a document without any data.

mod origin;
mod peers;
mod report;
mod unit;

use crate::args::BenchArgs;
use crate::bench::ablation::{self, Cell, Variant, seeds};
use crate::bench::document::origin::Origin;
use crate::bench::document::unit::Unit;
use crate::bench::figures::Figures;
use crate::bench::runner::Plan;
use crate::bench::source::{self, Prepared, Source};
use crate::bench::{command_line, unique_names};
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::machine::Machine;
use crate::run::summary::Summary;
use crate::{config, console, output};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Scenes that are measured where none is named: those named after recordings that figures are published on, and what else the filter is for.
const SCENES: [&str; 6] = [
    "sim:walking_xyz",
    "sim:walking_static",
    "sim:walking_rpy",
    "sim:walking_halfsphere",
    "sim:sitting_xyz",
    "sim:box_carried",
];
/// The scene that is run live where no recording with movement is given.
const LIVE_SCENE: &str = "sim:walking_xyz";
/// Movement matters in a sequence when without the filter the error is this many times as large: there it is worth knowing what each part of the
/// filter does, and how a live run fares.
const MATTERS: f64 = 2.0;

/// The file `benchmarks.json`.
#[derive(Debug, Serialize)]
struct Document {
    origin: Origin,
    machine: Machine,
    command: String,
    /// What detectors were asked for, in words.
    detector: String,
    /// The unit of time before and after all runs: median, ms.
    unit_ms: [f64; 2],
    /// OpenCV's ORB on this machine at that time, ms, where the user measured it.
    opencv_ms: Option<f64>,
    /// Seeds of the runs of every configuration.
    seeds: Vec<u64>,
    sequences: Vec<Measured>,
}

/// All runs of one sequence.
#[derive(Debug, Serialize)]
struct Measured {
    /// The configurations of the ablation: filter off (without a detector) and, where there is a detector, the default one with it; all of them
    /// where movement matters.
    row: ablation::Row,
    /// The default filter without a detector.
    alone: Option<Cell>,
    /// Live runs with the detector, or without where there is none.
    live: Vec<Summary>,
}

/// Measures, and writes `benchmarks.md` and `benchmarks.json`.
///
/// # Errors
/// Paths that cannot be run, a name of no detector, an output folder that cannot be written. What fails later is a line of the document.
pub(crate) fn bench(args: &BenchArgs, interrupt: &Interrupt) -> Result<Status, Failure> {
    let origin = Origin::here();
    let paths = paths(args);
    let sources: Result<Vec<Source>, Failure> = paths.iter().map(|p| Source::of(p)).collect();
    let sources = sources?;
    let settled = source::settle(&sources, &args.input)?;
    let seeds = seeds(config::resolve(&args.config)?.seed, args.runs);
    args.plan().prepare()?;
    let mut unit = Unit::new(config::simd()?)?;
    let before = unit.measure().median;
    let mut sequences: Vec<Measured> = Vec::new();
    for ((source, path), name) in sources.iter().zip(&paths).zip(unique_names(&paths)) {
        if interrupt.requested() {
            break;
        }
        // A scene has its own detections, whatever the recordings are looked at with.
        let mut input = args.input.clone();
        if matches!(source, Source::Scene(_)) {
            input.detector.detector = None;
        }
        let row = ablation::row(args, name, path);
        match source.prepare(&input, &settled, &args.out, seeds[0]) {
            Ok(prepared) => {
                let some_live = sequences.iter().any(|s| !s.live.is_empty());
                let mut measured = measure(args, row, (&prepared, &seeds), interrupt);
                let recording = matches!(source, Source::Folder(_)) && measured.movement_matters();
                if recording || (measured.row.name == LIVE_SCENE && !some_live) {
                    measured.live = live_runs(args, (&measured.row.name, &prepared), interrupt);
                }
                sequences.push(measured);
            }
            // Ctrl-C reaches the simulation too.
            Err(_) if interrupt.requested() => break,
            Err(e) => {
                console::warn(&format!("{}: {e}", row.name));
                sequences.push(Measured {
                    row: ablation::Row {
                        error: Some(e.to_string()),
                        ..row
                    },
                    alone: None,
                    live: Vec::new(),
                });
            }
        }
    }
    let document = Document {
        origin,
        machine: Machine::here(),
        command: command(),
        detector: settled.words(),
        unit_ms: [before, unit.measure().median],
        opencv_ms: args.opencv_ms,
        seeds,
        sequences,
    };
    write(&document, &args.out)?;
    if interrupt.requested() {
        console::line("interrupted: the document holds the runs that ended");
        return Ok(Status::Failed);
    }
    Ok(status(&document.sequences))
}

/// The sequences: what is named, and the scenes where none of them is named.
fn paths(args: &BenchArgs) -> Vec<PathBuf> {
    let mut paths = args.paths.clone();
    let is_scene = |p: &PathBuf| p.to_str().is_some_and(|p| p.starts_with("sim:"));
    if !paths.iter().any(is_scene) {
        paths.extend(SCENES.iter().map(PathBuf::from));
    }
    paths
}

/// What the user typed, without the folder that the program lies in.
fn command() -> String {
    let typed = command_line();
    let arguments = typed.split_once(' ').map_or("", |(_, rest)| rest);
    format!("stillpoint {arguments}")
}

/// All runs of one sequence but the live ones.
fn measure(
    args: &BenchArgs,
    mut row: ablation::Row,
    (prepared, seeds): (&Prepared, &[u64]),
    interrupt: &Interrupt,
) -> Measured {
    let name = row.name.clone();
    let run = |prepared: &Prepared, variant: Variant, label: &str| {
        let name = format!("{name}{label}");
        let wanted = !interrupt.requested();
        wanted.then(|| ablation::cell(args, (&name, prepared), (&variant.into(), seeds), interrupt))
    };
    let without = prepared.without_detector();
    row.detector.clone_from(&prepared.words);
    row.blind = prepared.blind;
    row.variants.extend(run(&without, Variant::None, ""));
    let alone = run(&without, Variant::Default, "-alone");
    if !prepared.blind {
        row.variants.extend(run(prepared, Variant::Default, ""));
    }
    let mut measured = Measured {
        row,
        alone,
        live: Vec::new(),
    };
    let scene = name.starts_with("sim:");
    if !prepared.blind && (scene || measured.movement_matters()) {
        for variant in Variant::ALL {
            if matches!(variant, Variant::None | Variant::Default) {
                continue;
            }
            measured.row.variants.extend(run(prepared, variant, ""));
        }
    }
    measured
}

fn live_runs(
    args: &BenchArgs,
    (name, prepared): (&str, &Prepared),
    interrupt: &Interrupt,
) -> Vec<Summary> {
    let plan = Plan {
        input: &prepared.input,
        ..args.plan()
    };
    let mut runs = Vec::new();
    for k in 1..=plan.runs {
        if interrupt.requested() {
            break;
        }
        console::info(&format!("{name}: live run {k} of {}", plan.runs));
        match plan.live(&prepared.path, &format!("{name}-live-{k}")) {
            Ok(summary) => runs.push(summary),
            Err(e) => console::warn(&format!("{name}: live: {e}")),
        }
    }
    runs
}

impl Measured {
    /// The runs with a configuration of the ablation.
    fn variant(&self, variant: Variant) -> Option<&Cell> {
        let mut all = self.row.variants.iter();
        all.find(|c| c.variant == variant.label())
    }

    /// Filter off; the default filter without a detector; and with one.
    fn cells(&self) -> [Option<&Cell>; 3] {
        [
            self.variant(Variant::None),
            self.alone.as_ref(),
            self.variant(Variant::Default),
        ]
    }

    /// Whether the filter makes a difference: to the error, or to the number of frames with a pose.
    fn movement_matters(&self) -> bool {
        let [off, on, _] = self.cells().map(|c| c?.figures.as_ref());
        let (Some(off), Some(on)) = (off, on) else {
            return false;
        };
        let error = |f: &Figures| f.ate.or(f.drift).map_or(f64::NAN, |e| e.rmse.median);
        off.tracked.median < on.tracked.median || error(off) > MATTERS * error(on)
    }
}

fn write(document: &Document, out: &Path) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(document).map_err(Failure::input)?;
    let markdown = report::markdown(document);
    output::write_file(&out.join("benchmarks.json"), format!("{json}\n").as_bytes())?;
    output::write_file(&out.join("benchmarks.md"), markdown.as_bytes())?;
    console::report(&format!("{markdown}\nwritten to {}\n", out.display()));
    Ok(())
}

/// Well when all runs came to their end and the default filter lost no frame; unusable when there are none.
fn status(sequences: &[Measured]) -> Status {
    let failed = |c: &Cell| c.error.is_some() || c.figures.is_none();
    let whole = |c: Option<&Cell>| {
        let figures = c.and_then(|c| c.figures.as_ref());
        figures.is_none_or(|f| f.tracked.worst >= 1.0)
    };
    let well = |s: &Measured| {
        let [_, alone, detected] = s.cells();
        let mut all = s.row.variants.iter().chain(&s.alone);
        s.row.error.is_none() && whole(alone) && whole(detected) && !all.any(failed)
    };
    let mut cells = sequences.iter().flat_map(Measured::cells).flatten();
    if cells.all(failed) {
        Status::Unusable
    } else if sequences.iter().all(well) {
        Status::Ok
    } else {
        Status::Failed
    }
}
