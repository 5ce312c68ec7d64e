//! `lab peers`: Stillpoint beside ORB-SLAM3 and RTAB-Map's odometry, on the same images, one program after the other, with the columns of `lab sweep`.
//!
//! The peers come from PyPI into an environment of their own below target/, and are driven by the scripts in lab/peers; nothing of them is part of Stillpoint.

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

/// What Stillpoint is called among the peers.
const OURS: &str = "stillpoint";
/// What the peers need beside themselves.
const TOOLS: [&str; 2] = ["numpy", "opencv-python-headless"];
/// Scenes that ORB-SLAM3's vocabulary is trained on: none that is measured, as their seed is not that of a measured scene.
const TRAINED_ON: [(&str, u64); 2] = [("sitting_xyz", 7), ("halfsphere", 7)];
/// Frames of each of them.
const TRAINING_FRAMES: u64 = 90;

/// A system that we are compared with.
struct Peer {
    /// Its name, and that of its script.
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

/// Name, title and licence of all programs.
pub(crate) fn titles() -> Vec<(&'static str, &'static str, &'static str)> {
    let ours = (OURS, "**Stillpoint**", "MIT or Apache-2.0");
    let peers = PEERS.iter().map(|p| (p.name, p.title, p.licence));
    std::iter::once(ours).chain(peers).collect()
}

/// Whether a variant is one of the peers.
pub(crate) fn is_peer(variant: &str) -> bool {
    PEERS.iter().any(|p| p.name == variant)
}

/// Runs Stillpoint, ORB-SLAM3 and RTAB-Map's odometry on the same images, one after the other.
///
/// The first time it makes an environment of Python with the peers (python3, g++ and a network are needed).
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// sim:SCENE, names below the data folder, paths of what `stillpoint run` takes with ground truth
    #[arg(value_name = "INPUT", default_value = "sim:walking_xyz")]
    inputs: Vec<String>,
    /// Runs of every program; the seeds of ours
    #[arg(long, default_value_t = 3)]
    runs: u64,
    /// The first N frames only
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
    /// The program `stillpoint` [default: target/release/stillpoint of this checkout]
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
    /// The commit that it was built of [default: of the checkout that it lies in]
    #[arg(long)]
    commit: Option<String>,
    /// Detector of ours, as for `stillpoint run`; {} stands for the input's folder
    #[arg(long, default_value = "none")]
    detector: String,
    /// Vocabulary of ORB-SLAM3: a file, or `download` for ORBvoc.txt (139 MB) [default: one that is trained in a minute]
    #[arg(long, value_name = "FILE")]
    vocabulary: Option<String>,
    /// Where the peers are installed [default: target/peers/environment of this checkout]
    #[arg(long, value_name = "DIR")]
    environment: Option<PathBuf>,
    /// Inputs, the vocabulary and peers.jsonl; what is there is not run again [default: target/peers of this checkout]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// A run that takes longer is ended, s
    #[arg(long, value_name = "S", default_value_t = 1800)]
    timeout: u64,
    /// Keep the runs in lab/results/peers.jsonl, of which `lab document` writes docs/evidence/peers.md and the table of README
    #[arg(long)]
    document: bool,
}

/// What a script says beside a trajectory.
#[derive(Deserialize)]
struct Said {
    frames: usize,
    median_ms: f64,
    p95_ms: f64,
    memory_bytes: u64,
}

/// The peers' environment.
struct Environment {
    python: Program,
    /// Arguments of ORB-SLAM3.
    vocabulary: Vec<OsString>,
}

fn script(name: &str) -> OsString {
    origin::root()
        .join(format!("lab/peers/{name}.py"))
        .into_os_string()
}

/// A program that makes something and is only waited for.
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

    /// Runs a peer over a folder in TUM's layout.
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
        // What a peer writes it believes.
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
            // One rendering for all.
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

/// Writes whatever is read as a folder in TUM's layout, which appears when it is whole.
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

/// All runs: of every input, every program in turn, so often.
fn measure(a: &Arguments, bench: &Bench, out: &Path) -> Result<Vec<Run>, Failure> {
    let environment = Environment::new(a, bench, out)?;
    let (mut file, lines) = Appended::open(&out.join("peers.jsonl"))?;
    let known = runs(&lines);
    let mut all = Vec::new();
    for mut input in inputs::parse(&a.inputs)? {
        if let Input::Scene { seed, .. } = &mut input {
            // What is rendered is the same for all runs, as a recording is. The name stays that of the scene.
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

/// One run of a peer.
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
