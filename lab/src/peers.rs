//! `lab peers`: compares Stillpoint with ORB-SLAM3 and RTAB-Map's odometry on the same images, sequentially, with the columns of `lab
//! sweep`.
//!
//! The peers are installed from PyPI into an environment below target/, and run by the scripts in lab/peers; Stillpoint uses no part of
//! them.

use crate::inputs::{self, Input};
use crate::origin::{self, Machine};
use crate::results::{Appended, Figures, Key, Line, Made, Run, Time, runs};
use crate::sweep::Bench;
use crate::sweep::prepared::{Prepared, Ready};
use crate::sweep::program::Program;
use crate::{Failure, document, score, table, views};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

/// Variant name of Stillpoint among the peers.
const OURS: &str = "stillpoint";
/// Further packages that the peers need.
const TOOLS: [&str; 2] = ["numpy", "opencv-python-headless"];
/// Training scenes of ORB-SLAM3's vocabulary; their seed differs from that of measured scenes.
const TRAINED_ON: [(&str, u64); 2] = [("sitting_xyz", 7), ("halfsphere", 7)];
/// Frames of each of them.
const TRAINING_FRAMES: u64 = 90;

struct Peer {
    /// Name of the variant, and of its script.
    name: &'static str,
    title: &'static str,
    licence: &'static str,
    /// Its package on PyPI.
    package: &'static str,
}

const PEERS: [Peer; 2] = [
    Peer {
        name: "orbslam3",
        title: "ORB-SLAM3",
        licence: "GPL-3.0",
        package: "pyorbslam3==0.1.1",
    },
    Peer {
        name: "rtabmap",
        title: "RTAB-Map odometry",
        licence: "BSD-3-Clause",
        package: "depthai==3.12.0",
    },
];

pub(crate) fn titles() -> Vec<(&'static str, &'static str, &'static str)> {
    let ours = (OURS, "**Stillpoint**", "MIT or Apache-2.0");
    let peers = PEERS.iter().map(|p| (p.name, p.title, p.licence));
    std::iter::once(ours).chain(peers).collect()
}

pub(crate) fn is_peer(variant: &str) -> bool {
    PEERS.iter().any(|p| p.name == variant)
}

/// Compares Stillpoint with ORB-SLAM3 and RTAB-Map's odometry on the same images, one after the other
///
/// The first run installs the peers into a Python environment (needs python3, g++ and a network).
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// sim:SCENE, names below the data folder, or paths of inputs of `stillpoint run` with ground truth
    #[arg(value_name = "INPUT", default_value = "sim:walking_xyz")]
    inputs: Vec<String>,
    /// Runs of every program; the seeds of Stillpoint
    #[arg(long, default_value_t = 3)]
    runs: u64,
    /// Only the first N frames
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
    /// The program `stillpoint` [default: target/release/stillpoint of this checkout]
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
    /// Commit of the program [default: that of the checkout it lies in]
    #[arg(long)]
    commit: Option<String>,
    /// Detector of Stillpoint, as for `stillpoint run`; {} stands for the input's folder
    #[arg(long, default_value = "none")]
    detector: String,
    /// Vocabulary of ORB-SLAM3: a file, or `download` for ORBvoc.txt (139 MB) [default: one trained in a minute]
    #[arg(long, value_name = "FILE")]
    vocabulary: Option<String>,
    /// Where the peers are installed [default: target/peers/environment of this checkout]
    #[arg(long, value_name = "DIR")]
    environment: Option<PathBuf>,
    /// Folder of inputs, vocabulary and peers.jsonl; existing runs are not repeated [default: target/peers of this checkout]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Maximum duration of a run, s
    #[arg(long, value_name = "S", default_value_t = 1800)]
    timeout: u64,
    /// Save the runs in lab/results/peers.jsonl, from which `lab document` generates docs/evidence/peers.md and the table of README
    #[arg(long)]
    document: bool,
}

/// Figures written by a peer's script beside the trajectory.
#[derive(Deserialize)]
struct Said {
    frames: usize,
    median_ms: f64,
    p95_ms: f64,
    memory_bytes: u64,
}

struct Environment {
    python: Program,
    vocabulary: Vec<OsString>,
}

fn script(name: &str) -> OsString {
    origin::root()
        .join(format!("lab/peers/{name}.py"))
        .into_os_string()
}

/// Runs a setup command.
fn make(command: &mut Command, what: &str) -> Result<(), Failure> {
    let status = command
        .status()
        .map_err(|e| format!("{what}: expected to run {command:?}, found: {e}"))?;
    if status.success() {
        Ok(())
    } else {
        Err(format!("{what}: expected {command:?} to succeed, found {status}").into())
    }
}

impl Environment {
    fn new(a: &Arguments, bench: &Bench, out: &Path) -> Result<Self, Failure> {
        let own = || origin::root().join("target/peers/environment");
        let folder = a.environment.clone().unwrap_or_else(own);
        let path = folder.join("bin/python");
        if !path.is_file() {
            let packages = PEERS.map(|p| p.package).into_iter().chain(TOOLS);
            let packages: Vec<&str> = packages.collect();
            eprintln!("making {} with {}", folder.display(), packages.join(", "));
            let python = Command::new("python3")
                .args(["-m", "venv"])
                .arg(&folder)
                .status();
            python.map_err(|e| {
                format!("python3: expected to make an environment with it, found: {e}")
            })?;
            let mut pip = Command::new(&path);
            pip.args(["-m", "pip", "install", "-q"]).args(packages);
            make(&mut pip, "the peers' environment")?;
        }
        let timeout = bench.program.timeout;
        let python = Program { path, timeout };
        let vocabulary = match a.vocabulary.as_deref() {
            Some("download") => Vec::new(),
            Some(file) => vec!["--vocabulary".into(), file.into()],
            None => vec!["--vocabulary".into(), trained(&python, bench, out)?.into()],
        };
        Ok(Self { python, vocabulary })
    }

    fn measure(&self, peer: &Peer, ready: &Ready, bench: &Bench) -> Result<Figures, Failure> {
        let scratch = tempfile::tempdir_in(&bench.work)?;
        let out = scratch.path().join("trajectory.txt");
        let mut words: Vec<OsString> = vec!["-B".into(), script(peer.name)];
        words.extend([ready.path.clone().into(), out.clone().into()]);
        if peer.name == "orbslam3" {
            words.extend(self.vocabulary.iter().cloned());
        }
        self.python.call(words, scratch.path())?;
        let file = out.with_extension("json");
        let text = std::fs::read_to_string(&file)
            .map_err(|e| format!("{}: expected its figures, found: {e}", peer.name))?;
        let said: Said = serde_json::from_str(&text)?;
        // Peers do not mark poses as uncertain.
        let poses = score::poses(&out)?;
        let mut figures = score::of_poses(&ready.truth, &poses, &BTreeSet::new(), said.frames);
        let time = Time {
            median: said.median_ms,
            p95: Some(said.p95_ms),
            ..Time::default()
        };
        figures.time_ms = BTreeMap::from([("frame".to_owned(), time)]);
        figures.memory_bytes = Some(said.memory_bytes);
        Ok(figures)
    }
}

/// A vocabulary for ORB-SLAM3, trained once on simulated scenes.
fn trained(python: &Program, bench: &Bench, out: &Path) -> Result<PathBuf, Failure> {
    let file = out.join("vocabulary.txt");
    if file.is_file() {
        return Ok(file);
    }
    eprintln!("training {}", file.display());
    let scratch = tempfile::tempdir_in(&bench.work)?;
    let part = scratch.path().join("vocabulary.txt");
    let mut words: Vec<OsString> = vec!["-B".into(), script("vocabulary"), part.clone().into()];
    for (scene, seed) in TRAINED_ON {
        let folder = scratch.path().join(scene);
        bench
            .renderer
            .simulate(scene, seed, Some(TRAINING_FRAMES), &folder)?;
        words.push(folder.into());
    }
    python.call(words, scratch.path())?;
    std::fs::rename(part, &file)?;
    Ok(file)
}

/// An input as ours takes it, and the same images as a folder in TUM's layout for the peers.
struct Shared {
    name: String,
    ours: Prepared,
    peers: Prepared,
}

impl Shared {
    fn new(input: Input, a: &Arguments, bench: &Bench, out: &Path) -> Result<Self, Failure> {
        let name = input.to_string();
        let work = out.join("inputs");
        std::fs::create_dir_all(&work)?;
        let prepared =
            |input: &Input, frames| Prepared::new(input.clone(), 0, frames, (&work, true));
        let peers = match &input {
            // Rendered once for all programs.
            Input::Scene { .. } => prepared(&input, a.frames),
            Input::Folder { name, path } => {
                let limit = a.frames.map_or_else(String::new, |n| format!("-{n}"));
                let folder = work.join(format!("{}{limit}", name.replace('/', "-")));
                if !folder.is_dir() {
                    convert(bench, path, &folder, a.frames)?;
                }
                let name = name.clone();
                let path = folder;
                prepared(&Input::Folder { name, path }, None)
            }
        };
        let ours = prepared(&input, a.frames);
        Ok(Self { name, ours, peers })
    }
}

/// To TUM's layout, atomically.
fn convert(bench: &Bench, from: &Path, to: &Path, frames: Option<u64>) -> Result<(), Failure> {
    let scratch = tempfile::tempdir_in(&bench.work)?;
    let part = scratch.path().join("folder");
    let mut words: Vec<OsString> = ["-q", "recording", "convert"].map(Into::into).into();
    words.extend([from.into(), part.clone().into()]);
    if let Some(n) = frames {
        words.extend(["--max-frames".into(), n.to_string().into()]);
    }
    bench.program.call(words, scratch.path())?;
    Ok(std::fs::rename(part, to)?)
}

/// All runs: per input, all programs in turn, `a.runs` times.
fn measure(a: &Arguments, bench: &Bench, out: &Path) -> Result<Vec<Run>, Failure> {
    let environment = Environment::new(a, bench, out)?;
    let (mut file, lines) = Appended::open(&out.join("peers.jsonl"))?;
    let known = runs(&lines);
    let mut all = Vec::new();
    for mut input in inputs::parse(&a.inputs)? {
        if let Input::Scene { seed, .. } = &mut input {
            // All runs share one rendering, as they do a recording. The input keeps the scene's name.
            seed.get_or_insert(0);
        }
        let shared = Shared::new(input, a, bench, out)?;
        for seed in 0..a.runs {
            for (program, ..) in titles() {
                let peer = PEERS.iter().find(|p| p.name == program);
                let key = Key {
                    input: shared.name.trim_end_matches("@0").to_owned(),
                    variant: program.to_owned(),
                    seed,
                    options: match peer {
                        Some(_) => Vec::new(),
                        None => vec!["--detector".to_owned(), a.detector.clone()],
                    },
                    frames_at_most: a.frames,
                    program: peer.map_or_else(|| bench.hash.clone(), |p| p.package.to_owned()),
                };
                if let Some(run) = known.iter().find(|r| r.key == key && r.error.is_none()) {
                    all.push(run.clone());
                    continue;
                }
                let run = match peer {
                    None => bench.once(key, &shared.ours),
                    Some(peer) => once(&environment, peer, key, (&shared, bench)),
                };
                eprintln!("{}", crate::sweep::said(&run));
                file.push(&Line::Run(Box::new(run.clone())))?;
                all.push(run);
            }
        }
    }
    Ok(all)
}

fn once(
    environment: &Environment,
    peer: &Peer,
    key: Key,
    (shared, bench): (&Shared, &Bench),
) -> Run {
    let begun = Instant::now();
    let ready = shared.peers.ready(&bench.renderer);
    let result = ready.and_then(|ready| environment.measure(peer, ready, bench));
    let (figures, error) = match result {
        Ok(figures) => (Some(figures), None),
        Err(e) => (None, Some(e.to_string())),
    };
    Run {
        key,
        commit: peer.package.to_owned(),
        machine: Machine::here(),
        renderer: None,
        jobs: 1,
        seconds: begun.elapsed().as_secs_f64(),
        error,
        figures,
    }
}

pub(crate) fn run(a: &Arguments) -> Result<ExitCode, Failure> {
    let out = a
        .out
        .clone()
        .unwrap_or_else(|| origin::root().join("target/peers"));
    let bench = Bench::new(
        a.program.as_deref(),
        a.commit.as_deref(),
        a.timeout,
        Some(&out),
    )?;
    let all = measure(a, &bench, &out)?;
    table::print(&views::sweep(&all));
    println!();
    table::print(&views::peers(&all, &titles()));
    if a.document {
        let made = Made {
            command: origin::command(),
            ..Made::default()
        };
        let lines = all.iter().cloned().map(|r| Line::Run(Box::new(r)));
        document::save("peers", std::iter::once(Line::Made(made)).chain(lines))?;
    }
    Ok(if all.iter().all(|r| r.error.is_none()) {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}
