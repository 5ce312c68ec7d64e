//! `bench`: runs every data set several times, each run in a fresh process, so that memory and timing are not affected by earlier runs.

pub(crate) mod ablation;
pub(crate) mod figures;
pub(crate) mod runner;
pub(crate) mod source;
pub(crate) mod suite;

use crate::args::BenchArgs;
use crate::bench::runner::{Plan, Sequence, Spread, median};
use crate::bench::source::Source;
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::machine::Machine;
use crate::run::summary::{ScoreJson, StageTiming, Summary};
use crate::{config, console, output};
use serde::Serialize;
use std::path::PathBuf;
use stillpoint::evaluation::Table;

#[derive(Debug, Serialize)]
struct Bench<'a> {
    machine: &'a Machine,
    command: &'a str,
    sequences: Vec<SequenceFigures<'a>>,
}

/// One data set: the figures of the table, then the runs.
#[derive(Debug, Serialize)]
struct SequenceFigures<'a> {
    #[serde(flatten)]
    sequence: &'a Sequence,
    tracked: Spread,
    /// ATE RMSE (drift RMSE for a camera that stands still), m.
    ate_rmse: Option<Spread>,
    /// RPE RMSE over 1 s, m.
    rpe_rmse: Option<Spread>,
    peak_memory_bytes: Option<Spread>,
    /// Milliseconds per stage, median over the runs.
    timing_ms: Vec<StageTiming>,
}

pub(crate) fn bench(args: &BenchArgs) -> Result<Status, Failure> {
    // Checked here, so that an error in the configuration is reported once instead of in every run.
    let seed = config::resolve(&args.config)?.seed;
    config::simd()?;
    let interrupt = Interrupt::listen();
    if let Some(suite) = args.suite {
        return suite::bench(suite, args, &interrupt);
    }
    if args.ablation {
        return ablation::bench(args, &interrupt);
    }
    let sequences = sequences(args, seed, &interrupt)?;
    let machine = Machine::here();
    let command = command_line();
    let figures: Vec<SequenceFigures<'_>> = sequences.iter().map(figures).collect();
    let markdown = markdown(&figures, &machine, &command);
    let all_tracked = figures.iter().all(|f| f.tracked.worst >= 1.0);
    let bench = Bench {
        machine: &machine,
        command: &command,
        sequences: figures,
    };
    let json = serde_json::to_string_pretty(&bench).map_err(Failure::input)?;
    output::write_file(&args.out.join("bench.json"), format!("{json}\n").as_bytes())?;
    output::write_file(&args.out.join("bench.md"), markdown.as_bytes())?;
    console::report(&format!("{markdown}\nwritten to {}\n", args.out.display()));
    if interrupt.requested() {
        console::line("interrupted: the report holds the runs that ended");
    }
    Ok(if all_tracked && !interrupt.requested() {
        Status::Ok
    } else {
        Status::Failed
    })
}

fn sequences(args: &BenchArgs, seed: u64, interrupt: &Interrupt) -> Result<Vec<Sequence>, Failure> {
    let sources: Result<Vec<Source>, Failure> = args.paths.iter().map(|p| Source::of(p)).collect();
    let sources = sources?;
    let settled = source::settle(&sources, &args.input)?;
    args.plan().prepare()?;
    let mut sequences = Vec::new();
    let names = unique_names(&args.paths);
    for ((source, path), name) in sources.iter().zip(&args.paths).zip(names) {
        if interrupt.requested() {
            break;
        }
        let prepared = match source.prepare(&args.input, &settled, &args.out, seed) {
            // Ctrl-C reaches the simulation process too.
            Err(_) if interrupt.requested() => break,
            prepared => prepared?,
        };
        let plan = Plan {
            input: &prepared.input,
            ..args.plan()
        };
        let mut sequence = plan.run(&prepared.path, name, interrupt)?;
        // A scene is reported by name: its folder is temporary.
        sequence.path = path.display().to_string();
        sequence.detector.clone_from(&prepared.words);
        if !sequence.runs.is_empty() {
            sequences.push(sequence);
        }
    }
    Ok(sequences)
}

impl BenchArgs {
    /// How the arguments ask for data sets to be run.
    pub(crate) fn plan(&self) -> Plan<'_> {
        Plan {
            runs: self.runs,
            out: &self.out,
            input: &self.input,
            config: &self.config,
        }
    }
}

pub(crate) fn command_line() -> String {
    let typed = crate::TYPED.get().into_iter().flatten();
    let words: Vec<_> = typed.map(|w| w.to_string_lossy()).collect();
    words.join(" ")
}

/// The last parts of the paths, numbered where two are equal.
pub(crate) fn unique_names(paths: &[PathBuf]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for path in paths {
        let full = path.canonicalize().unwrap_or_else(|_| path.clone());
        let name = path
            .file_name()
            .or(full.file_name())
            .unwrap_or("run".as_ref());
        let name = name.to_string_lossy().into_owned();
        let taken = names
            .iter()
            .filter(|n| **n == name || n.starts_with(&format!("{name}#")))
            .count();
        names.push(if taken == 0 {
            name
        } else {
            format!("{name}#{}", taken + 1)
        });
    }
    names
}

fn figures(sequence: &Sequence) -> SequenceFigures<'_> {
    let runs = &sequence.runs;
    let score = |r: &Summary| r.accuracy.as_ref().map(|a| a.final_poses.clone());
    SequenceFigures {
        sequence,
        tracked: Spread::of_tracked(runs),
        ate_rmse: Spread::of(runs.iter().filter_map(|r| match score(r)? {
            ScoreJson::Moving(m) => Some(m.ate.rmse),
            ScoreJson::Fixed(f) => Some(f.drift.rmse),
        })),
        rpe_rmse: Spread::of(runs.iter().filter_map(|r| match score(r)? {
            ScoreJson::Moving(m) => m.rpe.map(|r| r.translation.rmse),
            ScoreJson::Fixed(_) => None,
        })),
        peak_memory_bytes: Spread::of(
            runs.iter()
                .filter_map(|r| r.pace.peak_memory_bytes.map(|b| b as f64)),
        ),
        timing_ms: stages(runs),
    }
}

/// Median over the runs of each statistic of each stage.
fn stages(runs: &[Summary]) -> Vec<StageTiming> {
    let Some(first) = runs.first() else {
        return Vec::new();
    };
    first
        .pace
        .timing_ms
        .iter()
        .map(|stage| {
            let of = |field: fn(&StageTiming) -> f64| {
                median(
                    runs.iter()
                        .filter_map(|r| r.pace.timing_ms.iter().find(|s| s.stage == stage.stage))
                        .map(field)
                        .collect(),
                )
            };
            StageTiming {
                stage: stage.stage.clone(),
                n: stage.n,
                median: of(|s| s.median),
                p95: of(|s| s.p95),
                p99: of(|s| s.p99),
                max: of(|s| s.max),
                mean: of(|s| s.mean),
            }
        })
        .collect()
}

fn markdown(figures: &[SequenceFigures<'_>], machine: &Machine, command: &str) -> String {
    let mut text = format!(
        "# Benchmark\n\nMade by `{command}`.\n\n{}, {} cores, {}; {}; Stillpoint {}.\n\n",
        machine.cpu, machine.cores, machine.system, machine.rustc, machine.stillpoint
    );
    text += "Figures are median / worst over the runs. ATE and RPE are RMSE of the final poses (ATE: drift where the camera stands still; RPE over 1 s). Frames go through tracking and mapping one after the other, with nothing dropped: these are not real-time figures. \"same bytes\": all runs gave the same trajectory file, which one run alone cannot say.\n\n";
    let mut table = Table::new([
        "sequence",
        "frames",
        "runs",
        "tracked %",
        "ATE mm",
        "RPE mm",
        "peak MB",
        "same bytes",
    ]);
    for f in figures {
        let spread = |s: Option<Spread>, factor: f64, digits: usize| {
            s.map_or_else(
                || "-".to_owned(),
                |s| {
                    format!(
                        "{:.digits$} / {:.digits$}",
                        s.median * factor,
                        s.worst * factor
                    )
                },
            )
        };
        table.row([
            f.sequence.name.clone(),
            f.sequence
                .runs
                .first()
                .map_or(0, |r| r.tracking.frames)
                .to_string(),
            f.sequence.runs.len().to_string(),
            spread(Some(f.tracked), 100.0, 1),
            spread(f.ate_rmse, 1e3, 2),
            spread(f.rpe_rmse, 1e3, 2),
            spread(f.peak_memory_bytes, 1e-6, 0),
            match f.sequence.identical {
                Some(true) => "yes",
                Some(false) => "no",
                None => "-",
            }
            .to_owned(),
        ]);
    }
    text += &table.to_markdown();
    text.push('\n');
    for f in figures {
        text += &format!("- {}: detector {}", f.sequence.name, f.sequence.detector);
        let network = f
            .sequence
            .runs
            .first()
            .and_then(|r| r.stages.detector.network());
        text += &network.map_or_else(String::new, |n| format!("; {n}"));
        text.push('\n');
    }
    text += "\nMilliseconds per frame in which the stage ran; median over the runs of each statistic. `frame` is tracking (grey image in, pose out), `map` mapping, `total` both, `wait` what the images were waited for.\n\n";
    let mut table = Table::new(["sequence", "stage", "n", "median", "p95", "p99", "max"])
        .align(1, stillpoint::evaluation::Align::Left);
    for f in figures {
        for s in &f.timing_ms {
            let ms = |x: f64| format!("{x:.2}");
            table.row([
                f.sequence.name.clone(),
                s.stage.clone(),
                s.n.to_string(),
                ms(s.median),
                ms(s.p95),
                ms(s.p99),
                ms(s.max),
            ]);
        }
    }
    text + &table.to_markdown()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn duplicate_names_are_numbered() {
        let paths: Vec<PathBuf> = ["a/x", "b/x", "c/y", "d/x"]
            .iter()
            .map(Into::into)
            .collect();
        assert_eq!(unique_names(&paths), ["x", "x#2", "y", "x#3"]);
    }
}
