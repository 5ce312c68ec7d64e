//! `bench`: every data set several times, each run in a fresh process, so that memory and timing are honest.

use crate::args::BenchArgs;
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::machine::Machine;
use crate::summary::{ScoreJson, StageTiming, Summary};
use crate::{config, console, output};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use stillpoint::evaluation::Table;

/// All runs of one data set.
#[derive(Debug, Serialize)]
struct Sequence {
    name: String,
    path: String,
    /// True when all runs gave the same trajectory, byte for byte.
    identical: bool,
    runs: Vec<Summary>,
}

/// The file `bench.json`.
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
    /// Share of frames with a pose: median and worst.
    tracked: Spread,
    /// ATE RMSE (drift RMSE for a camera that stands still), m.
    ate_rmse: Option<Spread>,
    /// RPE RMSE over 1 s, m.
    rpe_rmse: Option<Spread>,
    peak_memory_bytes: Option<Spread>,
    /// Milliseconds per stage, median over the runs.
    timing_ms: Vec<StageTiming>,
}

/// Median and worst of several runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Spread {
    median: f64,
    worst: f64,
}

impl Spread {
    /// `None` without values. The worst is the largest.
    fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let values: Vec<f64> = values.into_iter().collect();
        let worst = values.iter().copied().reduce(f64::max)?;
        let median = median(values);
        Some(Self { median, worst })
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    match n {
        0 => f64::NAN,
        _ if n % 2 == 1 => values[n / 2],
        _ => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
}

/// `bench`.
pub(crate) fn bench(args: &BenchArgs) -> Result<Status, Failure> {
    // Mistakes in the configuration show here, once, instead of in every run.
    config::resolve(&args.config)?;
    config::simd()?;
    let runs_folder = args.out.join("runs");
    std::fs::create_dir_all(&runs_folder).map_err(|e| Failure::write(&runs_folder, &e))?;
    let interrupt = Interrupt::listen();
    let mut sequences = Vec::new();
    for (path, name) in args.paths.iter().zip(unique_names(&args.paths)) {
        if interrupt.requested() {
            break;
        }
        let sequence = run_sequence(args, path, name, &interrupt)?;
        if !sequence.runs.is_empty() {
            sequences.push(sequence);
        }
    }
    let machine = Machine::here();
    let command: Vec<String> = std::env::args().collect();
    let command = command.join(" ");
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

/// The last parts of the paths, with a number where two are the same.
fn unique_names(paths: &[PathBuf]) -> Vec<String> {
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

fn run_sequence(
    args: &BenchArgs,
    path: &Path,
    name: String,
    interrupt: &Interrupt,
) -> Result<Sequence, Failure> {
    let mut runs = Vec::new();
    let mut first_trajectory = None;
    let mut identical = true;
    for k in 1..=args.runs {
        let out = args.out.join("runs").join(format!("{name}-{k}"));
        console::info(&format!("{name}: run {k} of {}", args.runs));
        let summary = run_once(args, path, &out)?;
        if interrupt.requested() {
            break;
        }
        let trajectory = std::fs::read(out.join("trajectory.txt")).unwrap_or_default();
        identical &= *first_trajectory.get_or_insert_with(|| trajectory.clone()) == trajectory;
        runs.push(summary);
    }
    Ok(Sequence {
        name,
        path: path.display().to_string(),
        identical,
        runs,
    })
}

/// One run in a process of its own.
fn run_once(args: &BenchArgs, path: &Path, out: &Path) -> Result<Summary, Failure> {
    let program = std::env::current_exe()
        .map_err(|e| Failure::input(format!("expected to find this program, found: {e}")))?;
    let mut command = Command::new(&program);
    command
        .arg("--quiet")
        .arg("run")
        .arg(path)
        .arg("--out")
        .arg(out);
    pass_on(args, &mut command);
    let output = command.stdin(Stdio::null()).output().map_err(|e| {
        Failure::input(format!(
            "{}: expected to run it, found: {e}",
            program.display()
        ))
    })?;
    let said = String::from_utf8_lossy(&output.stderr);
    // 1 says that frames were lost: a figure of the report, not a failure of the bench.
    if !matches!(output.status.code(), Some(0 | 1)) {
        let said = said.trim().trim_start_matches("error: ");
        return Err(Failure::input(format!(
            "run failed ({}): {said}",
            output.status
        )));
    }
    let file = out.join("summary.json");
    let text = std::fs::read_to_string(&file).map_err(|e| {
        Failure::input(format!(
            "{}: expected the summary of a run, found: {e}",
            file.display()
        ))
    })?;
    serde_json::from_str(&text).map_err(|e| {
        Failure::input(format!(
            "{}: expected the summary of a run, found: {e}",
            file.display()
        ))
    })
}

/// The arguments that a run shares with the bench.
fn pass_on(args: &BenchArgs, command: &mut Command) {
    let input = &args.input;
    if let Some(camera) = &input.camera {
        command.args(["--camera", camera]);
    }
    command.args(["--start", &input.start.to_string()]);
    if let Some(n) = input.max_frames {
        command.args(["--max-frames", &n.to_string()]);
    }
    command.args(["--detector", &input.detector]);
    if input.strict {
        command.arg("--strict");
    }
    if let Some(file) = &args.config.config {
        command.arg("--config").arg(file);
    }
    for set in &args.config.set {
        command.args(["--set", set]);
    }
    if let Some(seed) = args.config.seed {
        command.args(["--seed", &seed.to_string()]);
    }
}

fn figures(sequence: &Sequence) -> SequenceFigures<'_> {
    let runs = &sequence.runs;
    let shares: Vec<f64> = runs
        .iter()
        .map(|r| r.tracked as f64 / r.frames.max(1) as f64)
        .collect();
    let score = |r: &Summary| r.accuracy.as_ref().map(|a| a.final_poses.clone());
    SequenceFigures {
        sequence,
        tracked: Spread {
            median: median(shares.clone()),
            worst: shares.iter().copied().fold(f64::INFINITY, f64::min),
        },
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
                .filter_map(|r| r.peak_memory_bytes.map(|b| b as f64)),
        ),
        timing_ms: stages(runs),
    }
}

/// Per stage, each statistic's median over the runs.
fn stages(runs: &[Summary]) -> Vec<StageTiming> {
    let Some(first) = runs.first() else {
        return Vec::new();
    };
    first
        .timing_ms
        .iter()
        .map(|stage| {
            let of = |field: fn(&StageTiming) -> f64| {
                median(
                    runs.iter()
                        .filter_map(|r| r.timing_ms.iter().find(|s| s.stage == stage.stage))
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
    text += "Figures are median / worst over the runs. ATE and RPE are RMSE of the final poses (ATE: drift where the camera stands still; RPE over 1 s). Frames go through tracking and mapping one after the other, with nothing dropped: these are not real-time figures.\n\n";
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
            f.sequence.runs.first().map_or(0, |r| r.frames).to_string(),
            f.sequence.runs.len().to_string(),
            spread(Some(f.tracked), 100.0, 1),
            spread(f.ate_rmse, 1e3, 2),
            spread(f.rpe_rmse, 1e3, 2),
            spread(f.peak_memory_bytes, 1e-6, 0),
            if f.sequence.identical { "yes" } else { "no" }.to_owned(),
        ]);
    }
    text += &table.to_markdown();
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
    fn median_and_worst() {
        let s = Spread::of([3.0, 1.0, 2.0, 10.0]).unwrap();
        assert_eq!((s.median, s.worst), (2.5, 10.0));
        assert_eq!(Spread::of([]), None);
        assert_eq!(median(vec![5.0, 1.0, 3.0]), 3.0);
    }

    #[test]
    fn equal_names_get_numbers() {
        let paths: Vec<PathBuf> = ["a/x", "b/x", "c/y", "d/x"]
            .iter()
            .map(Into::into)
            .collect();
        assert_eq!(unique_names(&paths), ["x", "x#2", "y", "x#3"]);
    }
}
