//! Runs one data set several times, each time in a fresh process.

use crate::args::{ConfigArgs, InputArgs, forward};
use crate::console;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::run::summary::Summary;
use serde::Serialize;
use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, Stdio};

#[derive(Debug, Serialize)]
pub(crate) struct Sequence {
    pub(crate) name: String,
    pub(crate) path: String,
    pub(crate) detector: String,
    /// True when all trajectories are identical, byte for byte; absent with fewer than two runs.
    pub(crate) identical: Option<bool>,
    pub(crate) runs: Vec<Summary>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Spread {
    pub(crate) median: f64,
    pub(crate) worst: f64,
}

impl Spread {
    pub(crate) fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let values: Vec<f64> = values.into_iter().collect();
        let worst = values.iter().copied().reduce(f64::max)?;
        let median = median(values);
        Some(Self { median, worst })
    }

    /// Share of frames with a pose, of which the worst is the smallest. NaN without runs.
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
    /// `None` with fewer than two.
    same: Option<bool>,
}

impl Trajectories {
    pub(crate) fn push(&mut self, trajectory: Vec<u8>) {
        match &self.first {
            None => self.first = Some(trajectory),
            Some(first) => self.same = Some(self.same != Some(false) && *first == trajectory),
        }
    }

    /// True when all are the same bytes; `None` with fewer than two.
    pub(crate) fn identical(&self) -> Option<bool> {
        self.same
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Plan<'a> {
    pub(crate) runs: u32,
    /// Output folder; the results of the runs go to `runs/` in it.
    pub(crate) out: &'a Path,
    pub(crate) input: &'a InputArgs,
    pub(crate) config: &'a ConfigArgs,
}

impl Plan<'_> {
    /// Creates the output folder, so that an unwritable one is reported before the first run.
    pub(crate) fn prepare(&self) -> Result<(), Failure> {
        let folder = self.out.join("runs");
        std::fs::create_dir_all(&folder).map_err(|e| Failure::write(&folder, &e))
    }

    /// Runs a data set as often as planned, or until interrupted. `name` is that of its results.
    ///
    /// # Errors
    /// The first run that fails; lost frames are not a failure.
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

    /// One run, with its result in `runs/` under a name: summary and final trajectory.
    ///
    /// # Errors
    /// A failed run, or an unreadable summary or trajectory.
    pub(crate) fn once(&self, path: &Path, name: &str) -> Result<(Summary, Vec<u8>), Failure> {
        self.with(Vec::new(), path, name)
    }

    /// One live run: a thread per stage, at camera rate.
    pub(crate) fn live(&self, path: &Path, name: &str) -> Result<Summary, Failure> {
        Ok(self.with(vec!["--live".into()], path, name)?.0)
    }

    fn with(
        &self,
        more: Vec<OsString>,
        path: &Path,
        name: &str,
    ) -> Result<(Summary, Vec<u8>), Failure> {
        // Some systems do not allow the colon of `sim:SCENE` in folder names.
        let out = self.out.join("runs").join(name.replace(':', "_"));
        let summary = run_once(
            &[forward::typed(self.input, self.config, path), more].concat(),
            path,
            &out,
        )?;
        let file = out.join("trajectory.txt");
        let trajectory = std::fs::read(&file).map_err(|e| {
            Failure::input(format!(
                "{}: expected the trajectory of a run, found: {e}",
                file.display()
            ))
        })?;
        Ok((summary, trajectory))
    }
}

pub(crate) fn program() -> Result<Command, Failure> {
    crate::program()
        .map_err(|e| Failure::input(format!("expected to find this program, found: {e}")))
}

/// One run in a separate process.
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
    // Exit code 1 means lost frames: a figure of the report, not a failure of the bench.
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

    #[test]
    fn spread_gives_median_and_worst() {
        let s = Spread::of([3.0, 1.0, 2.0, 10.0]).unwrap();
        assert_eq!((s.median, s.worst), (2.5, 10.0));
        assert_eq!(Spread::of([]), None);
        assert_eq!(median(vec![5.0, 1.0, 3.0]), 3.0);
    }

    #[test]
    fn identity_check_needs_two_runs() {
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
}
