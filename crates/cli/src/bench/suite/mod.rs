//! `bench --suite`: runs all sequences found of a public data set, and compares with published figures.

pub(crate) mod catalogue;
pub(crate) mod find;
pub(crate) mod published;
pub(crate) mod pull;
pub(crate) mod report;

use crate::args::BenchArgs;
use crate::bench::ablation::{self, Asked, Cell, Variant, seeds};
use crate::bench::command_line;
use crate::bench::figures::Figures;
use crate::bench::source::Prepared;
use crate::bench::suite::catalogue::Suite;
use crate::bench::suite::find::{Found, find};
use crate::bench::suite::published::Published;
use crate::detector::Settled;
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::machine::Machine;
use crate::{config, console, detector, output};
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(Debug, Serialize)]
pub(crate) struct Report {
    pub(crate) suite: &'static str,
    pub(crate) machine: Machine,
    pub(crate) command: String,
    pub(crate) detector: String,
    pub(crate) seeds: Vec<u64>,
    pub(crate) sequences: Vec<Row>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum State {
    Ran,
    Failed,
    /// The user ended the bench before.
    NotRun,
    NotFound,
}

#[derive(Debug, Serialize)]
pub(crate) struct Row {
    pub(crate) name: &'static str,
    pub(crate) state: State,
    pub(crate) path: Option<PathBuf>,
    pub(crate) cases: Vec<Case>,
    /// Published errors on it.
    pub(crate) published: Vec<Published>,
}

/// A sequence with one camera and one configuration.
#[derive(Debug, Serialize)]
pub(crate) struct Case {
    /// Camera of the runs, where the suite has several.
    pub(crate) camera: Option<&'static str>,
    pub(crate) live: bool,
    #[serde(flatten)]
    pub(crate) cell: Cell,
}

impl Case {
    /// Distinguishes it from other cases; empty where there is only one.
    pub(crate) fn label(&self) -> String {
        let camera = self.camera.into_iter();
        let variant = Some(self.cell.variant).filter(|v| *v != AS_SET);
        camera.chain(variant).collect::<Vec<_>>().join(", ")
    }
}

/// Label of the user's configuration.
const AS_SET: &str = "as set";

/// Finds the suite's sequences, runs them, and writes the report.
///
/// # Errors
/// Folders without any sequence, an output folder that is not writable. A sequence that cannot be run becomes a line of the report.
pub(crate) fn bench(
    suite: Suite,
    args: &BenchArgs,
    interrupt: &Interrupt,
) -> Result<Status, Failure> {
    if args.pull {
        pull::missing(suite, args, interrupt)?;
    }
    let found = find(suite, &pull::folders(args))?;
    let seeds = seeds(config::resolve(&args.config)?.seed, args.runs);
    // Chosen once, so that all runs use the same.
    let settled = detector::settle(&args.input.detector)?;
    settled.announce();
    args.plan().prepare()?;
    let here = found.iter().filter(|f| f.path.is_some()).count();
    console::info(&format!(
        "suite {}: {here} of {} sequences found",
        suite.name(),
        found.len()
    ));
    let row = |f: &Found| row(suite, f, args, (&settled, &seeds), interrupt);
    let sequences = found.iter().map(row).collect();
    let report = Report {
        suite: suite.name(),
        machine: Machine::here(),
        command: command_line(),
        detector: settled.words(),
        seeds,
        sequences,
    };
    write(&report, suite, &args.out)?;
    if interrupt.requested() {
        console::line("interrupted: the report holds the runs that ended");
        return Ok(Status::Failed);
    }
    Ok(status(&report.sequences))
}

/// The runs of every sequence with every camera.
fn asked(args: &BenchArgs, blind: bool) -> Vec<Asked> {
    let mut all: Vec<Asked> = Vec::new();
    if args.ablation {
        let differs = |v: &Variant| !(blind && v.needs_detector());
        all.extend(Variant::ALL.into_iter().filter(differs).map(Asked::from));
    } else {
        all.push(Asked {
            label: AS_SET,
            settings: Vec::new(),
            live: false,
        });
    }
    if args.live {
        all.push(Asked {
            label: "live",
            settings: Vec::new(),
            live: true,
        });
    }
    all
}

fn row(
    suite: Suite,
    found: &Found,
    args: &BenchArgs,
    (settled, seeds): (&Settled, &[u64]),
    interrupt: &Interrupt,
) -> Row {
    let known = found.known;
    let mut row = Row {
        name: known.name,
        state: State::NotFound,
        path: found.path.clone(),
        cases: Vec::new(),
        published: suite.published().of(known.name),
    };
    let Some(path) = &found.path else {
        return row;
    };
    row.state = State::NotRun;
    let prepared = Prepared::of(path.clone(), &args.input, settled);
    let cameras = match args.input.camera {
        Some(_) => &[None],
        None => suite.cameras(),
    };
    for camera in cameras {
        let prepared = prepared.with_camera(*camera);
        for asked in asked(args, prepared.blind) {
            if interrupt.requested() {
                return row;
            }
            let name = match camera {
                Some(camera) => format!("{}-{camera}", known.name),
                None => known.name.to_owned(),
            };
            let cell = ablation::cell(args, (&name, &prepared), (&asked, seeds), interrupt);
            // Ctrl-C also ends the run before its first frame: not a failure of the sequence.
            if cell.figures.is_none() && interrupt.requested() {
                return row;
            }
            row.cases.push(Case {
                camera: *camera,
                live: asked.live,
                cell,
            });
        }
    }
    let any = row.cases.iter().any(|c| c.cell.figures.is_some());
    row.state = if any { State::Ran } else { State::Failed };
    row
}

fn write(report: &Report, suite: Suite, out: &Path) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(report).map_err(Failure::input)?;
    output::write_file(&out.join("suite.json"), format!("{json}\n").as_bytes())?;
    let markdown = report::markdown(report, suite);
    output::write_file(&out.join("suite.md"), markdown.as_bytes())?;
    console::report(&format!("{markdown}\nwritten to {}\n", out.display()));
    Ok(())
}

/// `Ok` when every sequence found has a score in every case and was tracked throughout by the user's configuration, or in an ablation by
/// the default filter; the other variants may lose frames. `Unusable` when none could be run.
fn status(rows: &[Row]) -> Status {
    let scored = |f: &Figures| f.ate.is_some() || f.drift.is_some();
    let own = |c: &Case| c.live || [AS_SET, Variant::Default.label()].contains(&c.cell.variant);
    let well = |c: &Case| {
        let figures = c.cell.figures.as_ref();
        let whole = |f: &Figures| !own(c) || f.tracked.worst >= 1.0;
        c.cell.error.is_none() && figures.is_some_and(|f| scored(f) && whole(f))
    };
    let well = |r: &Row| match r.state {
        State::NotFound => true,
        State::Failed | State::NotRun => false,
        State::Ran => r.cases.iter().all(well),
    };
    let mut cases = rows.iter().flat_map(|r| &r.cases);
    if cases.all(|c| c.cell.figures.is_none()) {
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
    use crate::bench::figures::Errors;
    use crate::bench::runner::Spread;

    fn spread(x: f64) -> Spread {
        Spread {
            median: x,
            worst: x,
        }
    }

    fn case(variant: &'static str, tracked: Option<f64>, scored: bool) -> Case {
        let errors = Errors {
            rmse: spread(0.01),
            sd: spread(0.005),
        };
        let figures = tracked.map(|tracked| Figures {
            camera: String::new(),
            frames: 10,
            evaluated: 10,
            tracked: spread(tracked),
            dropped: None,
            identical: None,
            ate: scored.then_some(errors),
            rpe_translation: None,
            rpe_rotation_deg: None,
            drift: None,
        });
        Case {
            camera: None,
            live: false,
            cell: Cell {
                variant,
                settings: Vec::new(),
                error: None,
                figures,
                rejected: None,
                runs: Vec::new(),
            },
        }
    }

    fn row(state: State, cases: Vec<Case>) -> Row {
        Row {
            name: "walking_xyz",
            state,
            path: None,
            cases,
            published: Vec::new(),
        }
    }

    #[test]
    fn status_depends_only_on_the_sequences_found() {
        let good = || row(State::Ran, vec![case(AS_SET, Some(1.0), true)]);
        let missing = || row(State::NotFound, Vec::new());
        let failed = || row(State::Failed, vec![case(AS_SET, None, false)]);
        assert_eq!(status(&[good(), missing()]), Status::Ok);
        for bad in [
            row(State::Ran, vec![case(AS_SET, Some(0.99), true)]),
            row(State::Ran, vec![case(AS_SET, Some(1.0), false)]),
            row(State::NotRun, Vec::new()),
            failed(),
        ] {
            assert_eq!(status(&[good(), bad]), Status::Failed);
        }
        assert_eq!(status(&[failed(), missing()]), Status::Unusable);
        // Reduced variants of an ablation may lose frames.
        for (variant, expected) in [("O+G", Status::Ok), ("default", Status::Failed)] {
            let cases = vec![case(variant, Some(0.5), true)];
            assert_eq!(status(&[row(State::Ran, cases)]), expected, "{variant}");
        }
    }
}
