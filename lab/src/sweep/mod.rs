//! `lab sweep`: input x variant x seed, a process and a line of a result file per run. Existing runs are skipped, so a sweep can be
//! resumed.

pub(crate) mod prepared;
pub(crate) mod program;

use crate::inputs::{self, Input};
use crate::origin::{self, Machine};
use crate::results::{Appended, Figures, Key, Line, Made, Run, runs};
use crate::{Failure, score, table, views};
use prepared::Prepared;
use program::Program;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::{Duration, Instant};

/// Stands for the input's folder in the options of a variant.
const PLACE: &str = "{}";
/// Option of a variant: the input is replayed as a live camera, in real time.
const LIVE: &str = "--live";

/// Runs the program over input x variant x seed and writes a line per run
///
/// Exit code 1 if a run crashed or timed out.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// sim:SCENE (rendered with the run's seed), sim:SCENE@SEED, names below the data folder, or paths; `sim:` and `data:` alone are all of
    /// a kind
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<String>,
    /// Options of `stillpoint run`, separated by spaces; {} stands for the input's folder, --live replays it as a camera. No detector
    /// without --detector [default: default=]
    #[arg(
        long = "variant",
        value_name = "NAME=OPTIONS",
        allow_hyphen_values = true
    )]
    variants: Vec<String>,
    /// Seeds per input and variant
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    /// The first seed
    #[arg(long, default_value_t = 0)]
    first_seed: u64,
    /// Only the first N frames
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
    /// The measured program `stillpoint` [default: target/release/stillpoint of this checkout]
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
    /// The program that renders scenes, for comparing two versions on the same images [default: the measured program]
    #[arg(long, value_name = "FILE")]
    renderer: Option<PathBuf>,
    /// Commit of the program [default: that of the checkout it lies in]
    #[arg(long)]
    commit: Option<String>,
    /// Parallel runs; 1 to measure times [default: number of cores]
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
    /// Maximum duration of a run, s
    #[arg(long, value_name = "S", default_value_t = 1800)]
    timeout: u64,
    /// Repeat failed runs
    #[arg(long)]
    retry: bool,
    /// Result file, which is continued if it exists
    #[arg(long, value_name = "FILE.jsonl", default_value = "out/lab/runs.jsonl")]
    out: PathBuf,
    /// Folder for scratch files [default: target/lab of this checkout]
    #[arg(long, value_name = "DIR")]
    work: Option<PathBuf>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Variant {
    name: String,
    options: Vec<String>,
}

impl Variant {
    fn parse(text: &str) -> Result<Self, Failure> {
        let (name, options) = text.split_once('=').unwrap_or((text, ""));
        if name.is_empty() || name.starts_with('-') {
            return Err(format!(
                "--variant: expected NAME=OPTIONS as in 'off=--set static_filter.preset=off', found {text:?}"
            )
            .into());
        }
        Ok(Self {
            name: name.to_owned(),
            options: options.split_whitespace().map(str::to_owned).collect(),
        })
    }

    fn all(texts: &[String]) -> Result<Vec<Self>, Failure> {
        if texts.is_empty() {
            return Ok(vec![Self::parse("default=")?]);
        }
        let all: Result<Vec<Self>, Failure> = texts.iter().map(|t| Self::parse(t)).collect();
        let all = all?;
        let names: BTreeSet<&str> = all.iter().map(|v| v.name.as_str()).collect();
        if names.len() < all.len() {
            return Err("--variant: expected names that differ, found one twice".into());
        }
        Ok(all)
    }
}

/// Configuration of runs of `stillpoint`, independent of their input.
#[derive(Clone, Debug)]
pub(crate) struct Bench {
    pub(crate) program: Program,
    pub(crate) renderer: Program,
    /// Hash of the program; of the renderer below.
    pub(crate) hash: String,
    pub(crate) renderer_hash: String,
    pub(crate) commit: String,
    pub(crate) machine: Machine,
    pub(crate) jobs: usize,
    pub(crate) work: PathBuf,
}

impl Bench {
    /// `program` defaults to that of this checkout.
    pub(crate) fn new(
        program: Option<&Path>,
        commit: Option<&str>,
        timeout: u64,
        work: Option<&Path>,
    ) -> Result<Self, Failure> {
        let own = || origin::root().join("target/release/stillpoint");
        let path = program.map_or_else(own, Path::to_owned);
        let hash = origin::hash(&path)?;
        // A name without a folder would be searched in PATH.
        let path = path.canonicalize()?;
        let folder = path.parent().unwrap_or(&path);
        let program = Program {
            path: path.clone(),
            timeout: Duration::from_secs(timeout),
        };
        let work = work.map_or_else(|| origin::root().join("target/lab"), Path::to_owned);
        std::fs::create_dir_all(&work)?;
        Ok(Self {
            renderer: program.clone(),
            program,
            renderer_hash: hash.clone(),
            hash,
            commit: commit.map_or_else(|| origin::commit(folder), str::to_owned),
            machine: Machine::here(),
            jobs: 1,
            work,
        })
    }

    /// Any failure is stored as the run's error.
    pub(crate) fn once(&self, key: Key, prepared: &Prepared) -> Run {
        let mut seconds = 0.0;
        let result = self.measure(&key, prepared, &mut seconds);
        let (figures, error) = match result {
            Ok(figures) => (Some(figures), None),
            Err(e) => (None, Some(e.to_string())),
        };
        Run {
            key,
            commit: self.commit.clone(),
            machine: self.machine.clone(),
            renderer: prepared.is_scene().then(|| self.renderer_hash.clone()),
            jobs: self.jobs,
            seconds,
            error,
            figures,
        }
    }

    /// Sets `seconds` to the duration of the process, even on failure.
    fn measure(
        &self,
        key: &Key,
        prepared: &Prepared,
        seconds: &mut f64,
    ) -> Result<Figures, Failure> {
        let ready = prepared.ready(&self.renderer)?;
        let scratch = tempfile::Builder::new()
            .prefix("run-")
            .tempdir_in(&self.work)?;
        let out = scratch.path().join("result");
        let live = key.options.iter().any(|o| o == LIVE);
        let command: &[&str] = if live { &["live", "file"] } else { &["run"] };
        let mut words: Vec<OsString> = vec!["-q".into()];
        words.extend(command.iter().map(OsString::from));
        words.push(ready.path.clone().into());
        words.extend(["--no-report".into(), "--out".into(), out.clone().into()]);
        words.extend(["--seed".into(), key.seed.to_string().into()]);
        if let Some(n) = prepared.limit() {
            words.extend(["--max-frames".into(), n.to_string().into()]);
        }
        if !key.options.iter().any(|o| o.starts_with("--detector")) {
            words.extend(["--detector".into(), "none".into()]);
        }
        let place = ready.path.display().to_string();
        let options = key.options.iter().filter(|o| *o != LIVE);
        words.extend(options.map(|o| o.replace(PLACE, &place).into()));
        let begun = Instant::now();
        let called = self.program.call(words, scratch.path());
        *seconds = begun.elapsed().as_secs_f64();
        called?;
        score::result_folder(&out, &ready.truth)
    }
}

struct Task {
    key: Key,
    prepared: Arc<Prepared>,
}

/// All runs, grouped by rendered scene.
fn tasks(a: &Arguments, bench: &Bench) -> Result<Vec<Task>, Failure> {
    let (inputs, variants) = (inputs::parse(&a.inputs)?, Variant::all(&a.variants)?);
    let mut tasks = Vec::new();
    for input in &inputs {
        let seeds = a.first_seed..a.first_seed + a.seeds;
        // All seeds share a folder, or a scene with a fixed seed.
        let fixed = !matches!(input, Input::Scene { seed: None, .. });
        let mut shared: Option<Arc<Prepared>> = None;
        for seed in seeds {
            let fresh = || {
                let scratch = (bench.work.as_path(), false);
                Arc::new(Prepared::new(input.clone(), seed, a.frames, scratch))
            };
            let prepared = shared.take().unwrap_or_else(fresh);
            for v in &variants {
                let key = Key {
                    input: input.to_string(),
                    variant: v.name.clone(),
                    seed,
                    options: v.options.clone(),
                    frames_at_most: a.frames,
                    program: bench.hash.clone(),
                };
                let prepared = prepared.clone();
                tasks.push(Task { key, prepared });
            }
            shared = fixed.then_some(prepared);
        }
    }
    Ok(tasks)
}

pub(crate) fn run(a: &Arguments) -> Result<ExitCode, Failure> {
    let mut bench = Bench::new(
        a.program.as_deref(),
        a.commit.as_deref(),
        a.timeout,
        a.work.as_deref(),
    )?;
    bench.jobs = a.jobs.unwrap_or_else(origin::cores).max(1);
    if let Some(renderer) = &a.renderer {
        bench.renderer_hash = origin::hash(renderer)?;
        bench.renderer.path = renderer.canonicalize()?;
    }
    // Simultaneous sweeps must not share rendered scenes.
    let scratch = tempfile::Builder::new()
        .prefix("sweep-")
        .tempdir_in(&bench.work)?;
    bench.work = scratch.path().to_owned();
    let all = tasks(a, &bench)?;
    let planned: Vec<Key> = all.iter().map(|t| t.key.clone()).collect();
    let (mut file, mut lines) = Appended::open(&a.out)?;
    let made = Line::Made(Made {
        command: origin::command(),
        ..Made::default()
    });
    if !lines.contains(&made) {
        file.push(&made)?;
    }
    let done: BTreeSet<Key> = runs(&lines)
        .into_iter()
        .filter(|r| r.error.is_none() || !a.retry)
        .map(|r| r.key)
        .collect();
    let left: Vec<Task> = all.into_iter().filter(|t| !done.contains(&t.key)).collect();
    if left.len() < planned.len() {
        let there = planned.len() - left.len();
        eprintln!(
            "{there} of {} runs are in {}",
            planned.len(),
            a.out.display()
        );
    }
    carry_out(&bench, left, |line| {
        file.push(&line)?;
        lines.push(line);
        Ok(())
    })?;
    let made = runs(&lines);
    let of = |key: &Key| made.iter().find(|r| r.key == *key).cloned();
    let mine: Vec<Run> = planned.iter().filter_map(of).collect();
    table::print(&views::sweep(&mine));
    let failed: Vec<&Run> = mine.iter().filter(|r| r.error.is_some()).collect();
    for r in &failed {
        eprintln!("{}", said(r));
    }
    Ok(if failed.is_empty() {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

/// Makes runs in parallel, and passes each line to `take` as it comes.
fn carry_out(
    bench: &Bench,
    tasks: Vec<Task>,
    mut take: impl FnMut(Line) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let count = tasks.len();
    let queue = Mutex::new(tasks.into_iter());
    let (sender, receiver) = mpsc::channel();
    std::thread::scope(|scope| {
        for _ in 0..bench.jobs.min(count) {
            let (sender, queue) = (sender.clone(), &queue);
            scope.spawn(move || {
                loop {
                    let next = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
                    let Some(Task { key, prepared }) = next else {
                        break;
                    };
                    if sender.send(bench.once(key, &prepared)).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        // If a line cannot be written, the receiver is dropped, and other threads stop after their run.
        for (i, run) in receiver.into_iter().enumerate() {
            if run.error.is_none() {
                eprintln!("{}/{count} {}", i + 1, said(&run));
            }
            take(Line::Run(Box::new(run)))?;
        }
        Ok(())
    })
}

pub(crate) fn said(run: &Run) -> String {
    let key = &run.key;
    let head = format!("{} {} seed {}", key.input, key.variant, key.seed);
    match (&run.figures, &run.error) {
        (Some(f), None) => format!(
            "{head}: ATE {} mm, {} of {} frames lost, {:.1} s",
            table::figure(f.ate_mm.unwrap_or(f64::NAN), 1),
            f.lost,
            f.frames,
            run.seconds
        ),
        (_, error) => format!(
            "{head} FAILED: {}",
            error.as_deref().unwrap_or("no figures")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variants_have_a_name_and_options() {
        let v = Variant::parse("off=--set static_filter.preset=off").unwrap();
        assert_eq!(v.name, "off");
        assert_eq!(v.options, ["--set", "static_filter.preset=off"]);
        assert_eq!(Variant::all(&[]).unwrap()[0].name, "default");
        for wrong in ["=--set", "--set a=b"] {
            assert!(Variant::parse(wrong).is_err(), "{wrong}");
        }
        let twice = ["a=x", "a=y"].map(str::to_owned);
        assert!(Variant::all(&twice).is_err());
    }
}
