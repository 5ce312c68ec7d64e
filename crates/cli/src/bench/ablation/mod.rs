//! `bench --ablation`: accuracy with each part of the static filter switched on, in the form of published ablations.

pub(crate) mod report;
mod variant;

pub(crate) use variant::{Asked, Variant};

use crate::args::{BenchArgs, ConfigArgs};
use crate::bench::figures::{Figures, figures};
use crate::bench::runner::{Plan, Sequence, Trajectories, median};
use crate::bench::source::{Prepared, Source};
use crate::bench::suite::catalogue::published_ablation;
use crate::bench::suite::published::Ablated;
use crate::bench::{command_line, unique_names};
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::machine::Machine;
use crate::run::summary::Summary;
use crate::{config, console, output};
use serde::Serialize;
use std::path::Path;

#[derive(Debug, Serialize)]
pub(crate) struct Report {
    pub(crate) machine: Machine,
    pub(crate) command: String,
    pub(crate) seeds: Vec<u64>,
    pub(crate) sequences: Vec<Row>,
}

#[derive(Debug, Serialize)]
pub(crate) struct Row {
    pub(crate) name: String,
    pub(crate) path: String,
    pub(crate) detector: String,
    pub(crate) blind: bool,
    /// Why nothing could be run.
    pub(crate) error: Option<String>,
    pub(crate) variants: Vec<Cell>,
    /// Published ATE RMSE on the recording of this name, m.
    pub(crate) published: Option<Ablated>,
}

/// One sequence with one configuration.
#[derive(Debug, Serialize)]
pub(crate) struct Cell {
    pub(crate) variant: &'static str,
    pub(crate) settings: Vec<String>,
    pub(crate) error: Option<String>,
    /// `None` when no run completed.
    pub(crate) figures: Option<Figures>,
    /// Share of rejected keypoints: median over the runs.
    pub(crate) rejected: Option<f64>,
    pub(crate) runs: Vec<Summary>,
}

/// Runs every path with every configuration and writes the report.
///
/// # Errors
/// Invalid paths, scenes or detectors, or an output folder that is not writable. Later failures become lines of the report.
pub(crate) fn bench(args: &BenchArgs, interrupt: &Interrupt) -> Result<Status, Failure> {
    let sources: Result<Vec<Source>, Failure> = args.paths.iter().map(|p| Source::of(p)).collect();
    let sources = sources?;
    let seeds = seeds(config::resolve(&args.config)?.seed, args.runs);
    let settled = crate::bench::source::settle(&sources, &args.input)?;
    args.plan().prepare()?;
    let mut sequences = Vec::new();
    for ((source, path), name) in sources
        .iter()
        .zip(&args.paths)
        .zip(unique_names(&args.paths))
    {
        if interrupt.requested() {
            break;
        }
        let mut row = row(args, name, path);
        match source.prepare(&args.input, &settled, &args.out, seeds[0]) {
            Ok(prepared) => {
                row.detector.clone_from(&prepared.words);
                row.blind = prepared.blind;
                row.variants = variants(args, (&row.name, &prepared), &seeds, interrupt);
            }
            // Ctrl-C reaches the simulation process too.
            Err(_) if interrupt.requested() => break,
            Err(e) => {
                console::warn(&format!("{}: {e}", row.name));
                row.error = Some(e.to_string());
            }
        }
        sequences.push(row);
    }
    let report = Report {
        machine: Machine::here(),
        command: command_line(),
        seeds,
        sequences,
    };
    write(&report, &args.out)?;
    if interrupt.requested() {
        console::line("interrupted: the report holds the runs that ended");
        return Ok(Status::Failed);
    }
    Ok(status(&report.sequences))
}

/// Seeds of the runs, all different: runs of equal seeds would be identical.
pub(crate) fn seeds(first: u64, runs: u32) -> Vec<u64> {
    let last = i64::MAX as u64;
    (0..u64::from(runs))
        .map(|k| first.wrapping_add(k) & last)
        .collect()
}

/// A row without runs yet.
pub(crate) fn row(args: &BenchArgs, name: String, path: &Path) -> Row {
    Row {
        published: published_ablation(&name),
        name,
        path: path.display().to_string(),
        detector: args.input.detector.detector.clone().unwrap_or_default(),
        blind: false,
        error: None,
        variants: Vec::new(),
    }
}

/// All configurations that differ on a sequence.
fn variants(
    args: &BenchArgs,
    (name, prepared): (&str, &Prepared),
    seeds: &[u64],
    interrupt: &Interrupt,
) -> Vec<Cell> {
    let mut cells = Vec::new();
    for variant in Variant::ALL {
        if interrupt.requested() {
            break;
        }
        if !(prepared.blind && variant.needs_detector()) {
            cells.push(cell(
                args,
                (name, prepared),
                (&variant.into(), seeds),
                interrupt,
            ));
        }
    }
    cells
}

/// Runs a sequence with one configuration, once per seed.
pub(crate) fn cell(
    args: &BenchArgs,
    (name, prepared): (&str, &Prepared),
    (asked, seeds): (&Asked, &[u64]),
    interrupt: &Interrupt,
) -> Cell {
    let Asked { label, live, .. } = *asked;
    let settings = asked.settings.clone();
    let mut sequence = Sequence {
        name: name.to_owned(),
        path: prepared.path.display().to_string(),
        detector: prepared.words.clone(),
        identical: None,
        runs: Vec::new(),
    };
    let mut trajectories = Trajectories::default();
    let mut error = None;
    for (k, seed) in seeds.iter().enumerate() {
        let config = ConfigArgs {
            config: args.config.config.clone(),
            set: [args.config.set.clone(), settings.clone()].concat(),
            seed: Some(*seed),
        };
        let plan = Plan {
            input: &prepared.input,
            config: &config,
            ..args.plan()
        };
        console::info(&format!("{name}: {label}, seed {seed}"));
        let folder = format!("{name}-{label}-{}", k + 1).replace(' ', "-");
        let result = if live {
            // Live runs are not reproducible, so that their trajectories are not compared.
            plan.live(&prepared.path, &folder).map(|s| (s, Vec::new()))
        } else {
            plan.once(&prepared.path, &folder)
        };
        if interrupt.requested() {
            break;
        }
        match result {
            Ok((summary, trajectory)) => {
                trajectories.push(trajectory);
                sequence.runs.push(summary);
            }
            Err(e) => {
                console::warn(&format!("{name}: {label}: {e}"));
                error = Some(e.to_string());
                break;
            }
        }
    }
    sequence.identical = trajectories.identical().filter(|_| !live);
    let shares: Vec<f64> = sequence
        .runs
        .iter()
        .map(|r| r.stages.features.dynamic_share)
        .collect();
    Cell {
        variant: label,
        settings,
        error,
        figures: figures(&sequence),
        rejected: (!shares.is_empty()).then(|| median(shares)),
        runs: sequence.runs,
    }
}

fn write(report: &Report, out: &Path) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(report).map_err(Failure::input)?;
    output::write_file(&out.join("ablation.json"), format!("{json}\n").as_bytes())?;
    let markdown = report::markdown(report);
    output::write_file(&out.join("ablation.md"), markdown.as_bytes())?;
    console::report(&format!("{markdown}\nwritten to {}\n", out.display()));
    Ok(())
}

/// `Ok` when every run completed with a score and the default filter lost no frame; the other configurations may lose frames.
fn status(rows: &[Row]) -> Status {
    let scored = |c: &Cell| {
        let f = c.figures.as_ref();
        c.error.is_none() && f.is_some_and(|f| f.ate.is_some() || f.drift.is_some())
    };
    let whole = |c: &Cell| {
        let own = c.variant == Variant::Default.label();
        !own || c.figures.as_ref().is_some_and(|f| f.tracked.worst >= 1.0)
    };
    let mut cells = rows.iter().flat_map(|r| &r.variants);
    if cells.clone().all(|c| c.figures.is_none()) {
        Status::Unusable
    } else if rows.iter().all(|r| r.error.is_none()) && cells.all(|c| scored(c) && whole(c)) {
        Status::Ok
    } else {
        Status::Failed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::runner::Spread;

    #[test]
    fn runs_have_consecutive_seeds() {
        assert_eq!(seeds(7, 3), [7, 8, 9]);
        assert_eq!(seeds(i64::MAX as u64, 2), [i64::MAX as u64, 0]);
    }

    fn rows(variant: Variant, tracked: Option<f64>, scored: bool) -> Vec<Row> {
        let spread = |x| Spread {
            median: x,
            worst: x,
        };
        let errors = crate::bench::figures::Errors {
            rmse: spread(0.01),
            sd: spread(0.01),
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
        let cell = Cell {
            variant: variant.label(),
            settings: Vec::new(),
            error: None,
            figures,
            rejected: None,
            runs: Vec::new(),
        };
        vec![Row {
            name: "room".into(),
            path: "room".into(),
            detector: "none".into(),
            blind: true,
            error: None,
            variants: vec![cell],
            published: None,
        }]
    }

    #[test]
    fn only_the_default_filter_must_keep_all_frames() {
        assert_eq!(status(&rows(Variant::None, Some(0.5), true)), Status::Ok);
        assert_eq!(status(&rows(Variant::Default, Some(1.0), true)), Status::Ok);
        assert_eq!(
            status(&rows(Variant::Default, Some(0.5), true)),
            Status::Failed
        );
        assert_eq!(status(&rows(Variant::O, Some(1.0), false)), Status::Failed);
        assert_eq!(status(&rows(Variant::O, None, false)), Status::Unusable);
        let mut broken = rows(Variant::Default, Some(1.0), true);
        broken[0].variants[0].error = Some("no".into());
        assert_eq!(status(&broken), Status::Failed);
    }
}
