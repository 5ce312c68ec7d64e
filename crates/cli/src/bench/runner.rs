//! One data set several times, each run in a fresh process, so that memory and timing are honest.

use crate::args::models::DetectorArgs;
use crate::args::{ConfigArgs, InputArgs};
use crate::console;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::run::summary::Summary;
use serde::Serialize;
use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, Stdio};

/// Stands for the data set's folder in the name of a detector.
const PLACE: &str = "{}";

/// All runs of one data set.
#[derive(Debug, Serialize)]
pub(crate) struct Sequence {
    pub(crate) name: String,
    pub(crate) path: String,
    /// What objects were detected with, in words.
    pub(crate) detector: String,
    /// True when all runs gave the same trajectory, byte for byte; absent with fewer than two runs, which say nothing of it.
    pub(crate) identical: Option<bool>,
    pub(crate) runs: Vec<Summary>,
}

/// Median and worst of several runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Spread {
    pub(crate) median: f64,
    pub(crate) worst: f64,
}

impl Spread {
    /// `None` without values. The worst is the largest.
    pub(crate) fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let values: Vec<f64> = values.into_iter().collect();
        let worst = values.iter().copied().reduce(f64::max)?;
        let median = median(values);
        Some(Self { median, worst })
    }

    /// Share of frames with a pose, of which the worst is the smallest. Not a number without runs.
    pub(crate) fn of_tracked(runs: &[Summary]) -> Self {
        let shares: Vec<f64> = runs
            .iter()
            .map(|r| r.tracking.tracked as f64 / r.tracking.frames.max(1) as f64)
            .collect();
        Self {
            worst: shares.iter().copied().fold(f64::INFINITY, f64::min),
            median: median(shares),
        }
    }
}

pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    match n {
        0 => f64::NAN,
        _ if n % 2 == 1 => values[n / 2],
        _ => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
}

/// Whether runs gave the same trajectory.
#[derive(Debug, Default)]
pub(crate) struct Trajectories {
    first: Option<Vec<u8>>,
    /// `None` until there are two.
    same: Option<bool>,
}

impl Trajectories {
    /// Takes the file that one more run wrote.
    pub(crate) fn push(&mut self, trajectory: Vec<u8>) {
        match &self.first {
            None => self.first = Some(trajectory),
            Some(first) => self.same = Some(self.same != Some(false) && *first == trajectory),
        }
    }

    /// True when all were the same bytes; `None` with fewer than two.
    pub(crate) fn identical(&self) -> Option<bool> {
        self.same
    }
}

/// How data sets are run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plan<'a> {
    /// Runs per data set.
    pub(crate) runs: u32,
    /// The runs' results go to `runs/` in it.
    pub(crate) out: &'a Path,
    /// Input options of every run.
    pub(crate) input: &'a InputArgs,
    /// Configuration options of every run.
    pub(crate) config: &'a ConfigArgs,
}

impl Plan<'_> {
    /// Makes the folder for the results, so that one that cannot be written is known before the first run.
    pub(crate) fn prepare(&self) -> Result<(), Failure> {
        let folder = self.out.join("runs");
        std::fs::create_dir_all(&folder).map_err(|e| Failure::write(&folder, &e))
    }

    /// Runs a data set as often as planned, or until the user asks to stop. `name` is that of its results.
    ///
    /// # Errors
    /// The first run that cannot be carried out; losing frames is none.
    pub(crate) fn run(
        &self,
        path: &Path,
        name: String,
        interrupt: &Interrupt,
    ) -> Result<Sequence, Failure> {
        let mut runs = Vec::new();
        let mut trajectories = Trajectories::default();
        for k in 1..=self.runs {
            console::info(&format!("{name}: run {k} of {}", self.runs));
            let (summary, trajectory) = self.once(path, &format!("{name}-{k}"))?;
            if interrupt.requested() {
                break;
            }
            trajectories.push(trajectory);
            runs.push(summary);
        }
        Ok(Sequence {
            name,
            path: path.display().to_string(),
            detector: self.input.detector.detector.clone().unwrap_or_default(),
            identical: trajectories.identical(),
            runs,
        })
    }

    /// One run, whose result goes to `runs/` under a name: its figures and its final trajectory.
    ///
    /// # Errors
    /// A run that failed, or whose summary or trajectory cannot be read.
    pub(crate) fn once(&self, path: &Path, name: &str) -> Result<(Summary, Vec<u8>), Failure> {
        self.with(Vec::new(), path, name)
    }

    /// The same as a live run: with a thread per stage, at the pace of the camera.
    pub(crate) fn live(&self, path: &Path, name: &str) -> Result<Summary, Failure> {
        Ok(self.with(vec!["--live".into()], path, name)?.0)
    }

    /// One run with more arguments.
    fn with(
        &self,
        more: Vec<OsString>,
        path: &Path,
        name: &str,
    ) -> Result<(Summary, Vec<u8>), Failure> {
        // Not every system takes the colon of a simulated scene in the name of a folder.
        let out = self.out.join("runs").join(name.replace(':', "_"));
        let summary = run_once(&[self.arguments(path), more].concat(), path, &out)?;
        let file = out.join("trajectory.txt");
        let trajectory = std::fs::read(&file).map_err(|e| {
            Failure::input(format!(
                "{}: expected the trajectory of a run, found: {e}",
                file.display()
            ))
        })?;
        Ok((summary, trajectory))
    }

    /// The arguments that a run shares with the bench. Every field is named, so that one which is added cannot be forgotten.
    fn arguments(&self, path: &Path) -> Vec<OsString> {
        let InputArgs {
            camera,
            start,
            max_frames,
            topics,
            detector:
                DetectorArgs {
                    detector,
                    runtime,
                    detector_threads,
                },
            strict,
        } = self.input;
        let ConfigArgs { config, set, seed } = self.config;
        let mut all: Vec<OsString> = Vec::new();
        let mut add = |option: &str, value: OsString| all.extend([option.into(), value]);
        if let Some(camera) = camera {
            add("--camera", camera.into());
        }
        add("--start", start.to_string().into());
        if let Some(n) = max_frames {
            add("--max-frames", n.to_string().into());
        }
        if let Some(detector) = detector {
            let detector = detector.replace(PLACE, &path.display().to_string());
            add("--detector", detector.into());
        }
        add("--runtime", runtime.name().into());
        add("--detector-threads", detector_threads.to_string().into());
        if let Some(file) = config {
            add("--config", file.into());
        }
        for value in set {
            add("--set", value.into());
        }
        if let Some(seed) = seed {
            add("--seed", seed.to_string().into());
        }
        for (option, topic) in [
            ("--color-topic", &topics.color_topic),
            ("--depth-topic", &topics.depth_topic),
            ("--info-topic", &topics.info_topic),
            ("--truth-topic", &topics.truth_topic),
            ("--imu-topic", &topics.imu_topic),
            ("--odometry-topic", &topics.odometry_topic),
        ] {
            if let Some(topic) = topic {
                add(option, topic.into());
            }
        }
        if let Some(scale) = topics.depth_scale {
            add("--depth-scale", scale.to_string().into());
        }
        let flags = [
            ("--no-imu", topics.no_imu),
            ("--no-odometry", topics.no_odometry),
            ("--strict", *strict),
        ];
        all.extend(flags.iter().filter(|f| f.1).map(|f| f.0.into()));
        all
    }
}

/// This program, to be run in a process of its own.
pub(crate) fn program() -> Result<Command, Failure> {
    crate::program()
        .map_err(|e| Failure::input(format!("expected to find this program, found: {e}")))
}

/// One run in a process of its own.
fn run_once(arguments: &[OsString], path: &Path, out: &Path) -> Result<Summary, Failure> {
    let mut command = program()?;
    let output = command
        .args(["--quiet", "run"])
        .arg(path)
        .arg("--out")
        .arg(out)
        .args(arguments)
        .stdin(Stdio::null())
        .output()
        .map_err(|e| Failure::input(format!("expected to run this program, found: {e}")))?;
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
    let wrong = |found: &dyn std::fmt::Display| {
        Failure::input(format!(
            "{}: expected the summary of a run, found: {found}",
            file.display()
        ))
    };
    let text = std::fs::read_to_string(&file).map_err(|e| wrong(&e))?;
    serde_json::from_str(&text).map_err(|e| wrong(&e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::TopicArgs;
    use crate::args::models::RuntimeChoice;

    #[test]
    fn median_and_worst() {
        let s = Spread::of([3.0, 1.0, 2.0, 10.0]).unwrap();
        assert_eq!((s.median, s.worst), (2.5, 10.0));
        assert_eq!(Spread::of([]), None);
        assert_eq!(median(vec![5.0, 1.0, 3.0]), 3.0);
    }

    #[test]
    fn the_same_bytes_need_two_runs() {
        let of = |runs: &[&str]| {
            let mut t = Trajectories::default();
            runs.iter().for_each(|r| t.push(r.as_bytes().to_vec()));
            t.identical()
        };
        assert_eq!(of(&[]), None);
        assert_eq!(of(&["a"]), None);
        assert_eq!(of(&["a", "a", "a"]), Some(true));
        assert_eq!(of(&["a", "b", "a"]), Some(false));
    }

    #[test]
    fn runs_get_the_options_of_the_bench() {
        let input = InputArgs {
            camera: Some("tum_fr3".into()),
            start: 5,
            max_frames: Some(7),
            topics: TopicArgs {
                color_topic: Some("/c".into()),
                depth_topic: Some("/d".into()),
                info_topic: Some("/f".into()),
                truth_topic: Some("/t".into()),
                imu_topic: Some("/i".into()),
                no_imu: true,
                odometry_topic: Some("/o".into()),
                no_odometry: true,
                depth_scale: Some(5000.0),
            },
            detector: DetectorArgs {
                detector: Some("scripted:{}/boxes.csv".into()),
                runtime: RuntimeChoice::Rten,
                detector_threads: 2,
            },
            strict: true,
        };
        let config = ConfigArgs {
            config: Some("my.toml".into()),
            set: vec!["a.b=1".into(), "a.c=2".into()],
            seed: Some(9),
        };
        let plan = Plan {
            runs: 1,
            out: Path::new("out"),
            input: &input,
            config: &config,
        };
        let expected = "--camera tum_fr3 --start 5 --max-frames 7 --detector scripted:a/boxes.csv --runtime rten \
                        --detector-threads 2 --config my.toml \
                        --set a.b=1 --set a.c=2 --seed 9 --color-topic /c --depth-topic /d --info-topic /f --truth-topic /t \
                        --imu-topic /i --odometry-topic /o --depth-scale 5000 --no-imu --no-odometry --strict";
        let found: Vec<String> = plan
            .arguments(Path::new("a"))
            .iter()
            .map(|a| a.to_string_lossy().into_owned())
            .collect();
        assert_eq!(found.join(" "), expected);
    }
}
