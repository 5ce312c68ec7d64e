//! `bench --suite`: all sequences of a public data set that are found, beside published figures.

pub(crate) mod catalogue;
pub(crate) mod find;
pub(crate) mod published;
pub(crate) mod report;

use crate::bench::command_line;
use crate::bench::runner::{Plan, Sequence, Spread};
use crate::bench::suite::catalogue::Suite;
use crate::bench::suite::find::{Found, find};
use crate::bench::suite::published::PublishedAte;
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::machine::Machine;
use crate::run::summary::{ScoreJson, StatisticsJson, Summary};
use crate::{console, detector, output};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The file `suite.json`.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    pub(crate) suite: &'static str,
    pub(crate) machine: Machine,
    pub(crate) command: String,
    /// What the runs were asked to detect objects with.
    pub(crate) detector: String,
    pub(crate) sequences: Vec<Row>,
}

/// What became of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum State {
    /// It ran to its end.
    Ran,
    /// It could not be run.
    Failed,
    /// The user ended the bench before.
    NotRun,
    /// There is no folder of its name.
    NotFound,
}

/// One sequence of the suite.
#[derive(Debug, Serialize)]
pub(crate) struct Row {
    pub(crate) name: &'static str,
    pub(crate) state: State,
    pub(crate) path: Option<PathBuf>,
    pub(crate) error: Option<String>,
    pub(crate) figures: Option<Figures>,
    /// What others published on it.
    pub(crate) published: Vec<PublishedAte>,
    pub(crate) runs: Vec<Summary>,
}

/// Figures over all runs of a sequence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Figures {
    /// Where the camera's model comes from.
    pub(crate) camera: String,
    /// Frames that went through the system.
    pub(crate) frames: usize,
    /// Of those, the frames whose poses the absolute error is about, in the worst run.
    pub(crate) evaluated: usize,
    /// Share of frames with a pose.
    pub(crate) tracked: Spread,
    /// True when all runs gave the same trajectory, byte for byte; absent when there was only one run.
    pub(crate) identical: Option<bool>,
    /// Absolute error of the final poses, m.
    pub(crate) ate: Option<Errors>,
    /// Relative error over 1 s, m.
    pub(crate) rpe_translation: Option<Errors>,
    /// Relative error over 1 s, degrees.
    pub(crate) rpe_rotation_deg: Option<Errors>,
    /// Distance from the first pose where the ground truth stands still, so that no alignment is defined, m.
    pub(crate) drift: Option<Errors>,
}

/// RMSE and standard deviation over all runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Errors {
    pub(crate) rmse: Spread,
    pub(crate) sd: Spread,
}

impl Errors {
    /// From one statistic per run; `None` when no run has it.
    fn of(statistics: &[StatisticsJson]) -> Option<Self> {
        Some(Self {
            rmse: Spread::of(statistics.iter().map(|s| s.rmse))?,
            sd: Spread::of(statistics.iter().map(|s| s.sd))?,
        })
    }
}

/// Finds the suite's sequences, runs them, writes the report.
///
/// # Errors
/// Folders without any sequence, an output folder that cannot be written. A sequence that cannot be run is a line of the
/// report.
pub(crate) fn bench(
    suite: Suite,
    folders: &[PathBuf],
    plan: &Plan<'_>,
    interrupt: &Interrupt,
) -> Result<Status, Failure> {
    let found = find(suite, folders)?;
    // Settled once, so that all runs get the same.
    let settled = detector::settle(&plan.input.detector)?;
    settled.announce();
    let input = plan.input.with_detector(settled.argument.clone());
    let plan = &Plan {
        input: &input,
        ..*plan
    };
    plan.prepare()?;
    let here = found.iter().filter(|f| f.path.is_some()).count();
    console::info(&format!(
        "suite {}: {here} of {} sequences found",
        suite.name(),
        found.len()
    ));
    let report = Report {
        suite: suite.name(),
        machine: Machine::here(),
        command: command_line(),
        detector: settled.words(),
        sequences: found
            .iter()
            .map(|f| row(suite, f, plan, interrupt))
            .collect(),
    };
    write(&report, suite, plan.out)?;
    if interrupt.requested() {
        console::line("interrupted: the report holds the runs that ended");
        return Ok(Status::Failed);
    }
    Ok(status(&report.sequences))
}

fn row(suite: Suite, found: &Found, plan: &Plan<'_>, interrupt: &Interrupt) -> Row {
    let known = found.known;
    let mut row = Row {
        name: known.name,
        state: State::NotFound,
        path: found.path.clone(),
        error: None,
        figures: None,
        published: suite.published().list(known.name),
        runs: Vec::new(),
    };
    let Some(path) = &found.path else {
        return row;
    };
    row.state = State::NotRun;
    if interrupt.requested() {
        return row;
    }
    match plan.run(path, known.name.to_owned(), interrupt) {
        Ok(sequence) => {
            if let Some(figures) = figures(&sequence) {
                (row.state, row.figures) = (State::Ran, Some(figures));
                row.runs = sequence.runs;
            }
        }
        // Ctrl-C reaches the run too, and ends it before its first frame: that is no failure of the sequence.
        Err(_) if interrupt.requested() => {}
        Err(e) => {
            let e = e.to_string();
            console::warn(&format!("{}: {e}", known.name));
            (row.state, row.error) = (State::Failed, Some(e));
        }
    }
    row
}

/// `None` without runs.
pub(crate) fn figures(sequence: &Sequence) -> Option<Figures> {
    let runs = &sequence.runs;
    let first = runs.first()?;
    let scores: Vec<&ScoreJson> = runs
        .iter()
        .filter_map(|r| Some(&r.accuracy.as_ref()?.final_poses))
        .collect();
    let (mut ate, mut translation, mut rotation, mut drift) = (vec![], vec![], vec![], vec![]);
    let mut evaluated = Vec::new();
    for score in scores {
        match score {
            ScoreJson::Moving(m) => {
                evaluated.push(m.pairs);
                ate.push(m.ate);
                translation.extend(m.rpe.as_ref().map(|r| r.translation));
                rotation.extend(m.rpe.as_ref().map(|r| r.rotation_deg));
            }
            ScoreJson::Fixed(f) => drift.push(f.drift),
        }
    }
    Some(Figures {
        camera: first.input.camera.clone(),
        frames: first.frames,
        evaluated: evaluated.into_iter().min().unwrap_or(0),
        tracked: Spread::of_tracked(runs),
        identical: sequence.identical,
        ate: Errors::of(&ate),
        rpe_translation: Errors::of(&translation),
        rpe_rotation_deg: Errors::of(&rotation),
        drift: Errors::of(&drift),
    })
}

fn write(report: &Report, suite: Suite, out: &Path) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(report).map_err(Failure::input)?;
    output::write_file(&out.join("suite.json"), format!("{json}\n").as_bytes())?;
    let markdown = report::markdown(report, suite);
    output::write_file(&out.join("suite.md"), markdown.as_bytes())?;
    console::report(&format!("{markdown}\nwritten to {}\n", out.display()));
    Ok(())
}

/// Well when every sequence that was found was tracked throughout and has a score; unusable when none could be run.
fn status(rows: &[Row]) -> Status {
    let whole = |f: &Figures| f.tracked.worst >= 1.0 && (f.ate.is_some() || f.drift.is_some());
    let well = |r: &Row| match r.state {
        State::NotFound => true,
        _ => r.figures.as_ref().is_some_and(whole),
    };
    if rows.iter().all(|r| r.figures.is_none()) {
        Status::Unusable
    } else if rows.iter().all(well) {
        Status::Ok
    } else {
        Status::Failed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spread(x: f64) -> Spread {
        Spread {
            median: x,
            worst: x,
        }
    }

    fn row(state: State, tracked: Option<f64>, scored: bool) -> Row {
        let errors = Errors {
            rmse: spread(0.01),
            sd: spread(0.005),
        };
        let figures = tracked.map(|tracked| Figures {
            camera: String::new(),
            frames: 10,
            evaluated: 10,
            tracked: spread(tracked),
            identical: None,
            ate: scored.then_some(errors),
            rpe_translation: None,
            rpe_rotation_deg: None,
            drift: None,
        });
        Row {
            name: "walking_xyz",
            state,
            path: None,
            error: None,
            figures,
            published: Vec::new(),
            runs: Vec::new(),
        }
    }

    #[test]
    fn the_status_is_that_of_what_was_found() {
        let good = || row(State::Ran, Some(1.0), true);
        let missing = || row(State::NotFound, None, false);
        assert_eq!(status(&[good(), missing()]), Status::Ok);
        for bad in [
            row(State::Ran, Some(0.99), true),
            row(State::Ran, Some(1.0), false),
            row(State::Failed, None, false),
        ] {
            assert_eq!(status(&[good(), bad]), Status::Failed);
        }
        let failed = row(State::Failed, None, false);
        assert_eq!(status(&[failed, missing()]), Status::Unusable);
    }

    #[test]
    fn errors_are_median_and_worst_of_the_runs() {
        let of = |rmse: f64, sd: f64| StatisticsJson {
            rmse,
            sd,
            mean: 0.0,
            median: 0.0,
            max: 0.0,
        };
        let e = Errors::of(&[of(3.0, 0.5), of(1.0, 0.7), of(2.0, 0.6)]).unwrap();
        assert_eq!((e.rmse.median, e.rmse.worst), (2.0, 3.0));
        assert_eq!((e.sd.median, e.sd.worst), (0.6, 0.7));
        assert_eq!(Errors::of(&[]), None);
    }
}
