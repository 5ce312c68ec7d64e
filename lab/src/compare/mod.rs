//! `lab compare`: whether A and B differ by more than seeds do.

mod metric;
mod pairs;
mod statistics;

use crate::Failure;
use crate::results::Run;
use crate::table::{self, Align, Table};
use metric::{METRICS, Metric, Verdict};
use pairs::{Group, Pairs};
use statistics::{OUTSIDE, RESAMPLES, estimate};
use std::process::ExitCode;

/// Tests whether the runs of B are better or worse than those of A
///
/// Runs are paired by input and seed (and by variant, if there are several). Exit code 1 if B is worse.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// FILE.jsonl, or FILE.jsonl#WHICH: a variant, or the beginning of a commit or of a program's hash
    a: String,
    /// Second side, in the same format
    b: String,
}

struct Comparison {
    table: Table,
    worse: Vec<String>,
    better: Vec<String>,
}

fn compare(groups: &[Group]) -> Comparison {
    let head = [
        "input",
        "figure",
        "pairs",
        "A",
        "B",
        "B / A, B - A",
        "interval",
        "B is",
    ];
    let mut said = Comparison {
        table: Table::new(head).align(1, Align::Left).align(7, Align::Left),
        worse: Vec::new(),
        better: Vec::new(),
    };
    // Bonferroni correction: among many inputs one would exceed its interval by chance.
    let each = OUTSIDE / groups.len().max(1) as f64;
    for metric in &METRICS {
        let mut all: Vec<(Vec<f64>, &Group)> = Vec::new();
        for group in groups {
            let contrasts: Vec<f64> = group
                .pairs
                .iter()
                .filter_map(|p| metric.contrast(p))
                .collect();
            if !contrasts.is_empty() {
                said.row(metric, &group.name, &[(contrasts.clone(), group)], each);
                all.push((contrasts, group));
            }
        }
        if all.len() > 1 {
            said.row(metric, "all inputs", &all, OUTSIDE);
        }
    }
    said
}

impl Comparison {
    fn row(&mut self, metric: &Metric, name: &str, of: &[(Vec<f64>, &Group)], outside: f64) {
        let contrasts: Vec<Vec<f64>> = of.iter().map(|(c, _)| c.clone()).collect();
        let e = estimate(&contrasts, metric.sum, outside);
        let pairs = || of.iter().flat_map(|(_, g)| &g.pairs);
        let shared = pairs().any(|(a, b)| a.jobs.max(b.jobs) > 1);
        let verdict = if metric.timed && shared {
            Verdict::NotTimed
        } else {
            let independent = match of {
                [(one, _)] => one.len(),
                several => several.iter().map(|(_, g)| g.independent()).sum(),
            };
            metric.judge(&contrasts, independent, (e, outside))
        };
        let what = format!("{name}: {}", metric.name);
        match verdict {
            Verdict::Worse => self.worse.push(what),
            Verdict::Better => self.better.push(what),
            _ => {}
        }
        let figures = |run: &Run| run.figures.as_ref().and_then(metric.of);
        // A median over the errors of different inputs is meaningless.
        let [a, b] = if of.len() > 1 {
            [String::new(), String::new()]
        } else {
            [
                metric.side(pairs().filter_map(|p| figures(&p.0))),
                metric.side(pairs().filter_map(|p| figures(&p.1))),
            ]
        };
        let [value, interval] = metric.interval(e);
        let count: usize = contrasts.iter().map(Vec::len).sum();
        self.table.row([
            name.to_owned(),
            metric.name.to_owned(),
            count.to_string(),
            a,
            b,
            value,
            interval,
            verdict.words().to_owned(),
        ]);
    }
}

/// Warnings about images rendered by different programs.
fn other_images(groups: &[Group]) -> Vec<String> {
    let differ = |g: &&Group| g.pairs.iter().any(|(a, b)| a.renderer != b.renderer);
    let said = |g: &Group| {
        format!(
            "{}: the images of A and B were rendered by two programs and may differ; `lab sweep --renderer` has one render for both",
            g.name
        )
    };
    groups.iter().filter(differ).map(said).collect()
}

/// Warnings about missing errors, and whether only B lacks one.
fn broken(groups: &[Group]) -> Vec<(String, bool)> {
    let mut all = Vec::new();
    let ate = |r: &Run| r.figures.as_ref().and_then(|f| f.ate_mm).is_some();
    for group in groups {
        for (a, b) in &group.pairs {
            let [ours, theirs] = [ate(a), ate(b)];
            let why = |r: &Run| r.error.clone().unwrap_or("too few poses".to_owned());
            let side = match (ours, theirs) {
                (true, true) => continue,
                (true, false) => format!("B has no error: {}", why(b)),
                (false, true) => format!("A has no error: {}", why(a)),
                (false, false) => format!("neither has an error: {}; {}", why(a), why(b)),
            };
            let line = format!("{}, seed {}: {side}", group.name, a.key.seed);
            all.push((line, ours && !theirs));
        }
    }
    all
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (a, b) = (pairs::side(&arguments.a)?, pairs::side(&arguments.b)?);
    let Pairs { groups, alone } = pairs::pair(a, b)?;
    if groups.is_empty() {
        return Err(format!(
            "expected runs of the same inputs and seeds, found no pair: {}",
            alone.join("; ")
        )
        .into());
    }
    let Comparison {
        table,
        mut worse,
        better,
    } = compare(&groups);
    println!(
        "A: {}\nB: {}\n\n{} of {RESAMPLES} draws of inputs and their seeds, percentiles; of single inputs the share outside is divided by their number. \
         Errors, times and memory: median ratio, over all inputs the geometric mean. Frames: mean difference.\n",
        arguments.a,
        arguments.b,
        format_args!("Intervals: {:.0} %", 100.0 * (1.0 - OUTSIDE)),
    );
    table::print(&table);
    for (line, b_alone) in broken(&groups) {
        println!("{line}");
        if b_alone {
            worse.push(line);
        }
    }
    for line in alone.iter().chain(&other_images(&groups)) {
        println!("{line}");
    }
    let list = |what: &[String]| what.join("; ");
    if !better.is_empty() {
        println!("\nbetter: {}", list(&better));
    }
    if worse.is_empty() {
        println!("\nB is not worse");
        return Ok(ExitCode::SUCCESS);
    }
    println!("\nB is WORSE: {}", list(&worse));
    Ok(ExitCode::FAILURE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Time;
    use crate::results::tests::run;

    fn groups(ratio: impl Fn(u64) -> f64, seeds: u64) -> Vec<Group> {
        let pair = |seed| {
            let ate = 1.0 + seed as f64;
            (
                run("x", "a", seed, ate),
                run("x", "b", seed, ate * ratio(seed)),
            )
        };
        let pairs = (0..seeds).map(pair).collect();
        let name = "x".to_owned();
        vec![Group { name, pairs }]
    }

    fn verdicts(groups: &[Group]) -> (usize, usize) {
        let said = compare(groups);
        (said.worse.len(), said.better.len())
    }

    #[test]
    fn only_differences_beyond_the_seed_spread_are_found() {
        assert_eq!(verdicts(&groups(|_| 1.02, 8)), (1, 0));
        assert_eq!(verdicts(&groups(|_| 0.98, 8)), (0, 1));
        assert_eq!(verdicts(&groups(|_| 1.0, 8)), (0, 0));
        // Better as often as worse.
        assert_eq!(
            verdicts(&groups(|s| if s % 2 == 0 { 0.7 } else { 1.5 }, 8)),
            (0, 0)
        );
        // Five seeds agree by chance too often.
        assert_eq!(verdicts(&groups(|_| 1.5, 5)), (0, 0));
        let text = compare(&groups(|_| 1.5, 5)).table.to_markdown();
        assert!(text.contains("too few to tell"), "{text}");
    }

    #[test]
    fn pooled_inputs_reveal_a_common_difference() {
        let three = |name: &str, ratio: f64| {
            let mut group = groups(|_| ratio, 3).remove(0);
            group.name = name.to_owned();
            for (a, _) in &mut group.pairs {
                a.key.input = name.to_owned();
            }
            group
        };
        let said = compare(&[three("sim:x", 1.1), three("sim:y", 1.1)]);
        assert_eq!(said.worse, ["all inputs: ATE, mm"]);
        // All seeds share the images of a recording.
        let said = compare(&[three("x", 1.1), three("y", 1.1)]);
        assert_eq!(said.worse, Vec::<String>::new());
        // Scenes that disagree show nothing, however precisely each is known.
        let said = compare(&[three("sim:x", 1.1), three("sim:y", 0.99)]);
        assert_eq!(said.worse, Vec::<String>::new());
    }

    #[test]
    fn times_need_solitary_runs_and_exceed_a_margin() {
        let timed = |factor: f64, jobs: usize| {
            let mut all = groups(|_| 1.0, 8);
            for (a, b) in &mut all[0].pairs {
                for (r, ms) in [(a, 5.0), (b, 5.0 * factor)] {
                    let time = Time {
                        median: ms,
                        ..Time::default()
                    };
                    r.jobs = jobs;
                    let figures = r.figures.as_mut().unwrap();
                    figures.time_ms.insert("frame".to_owned(), time);
                }
            }
            compare(&all)
        };
        assert_eq!(timed(1.2, 1).worse, ["x: frame, ms"]);
        assert!(timed(1.04, 1).worse.is_empty() && timed(1.2, 2).worse.is_empty());
        assert!(timed(1.2, 2).table.to_markdown().contains("needs --jobs 1"));
    }

    #[test]
    fn differing_renderers_are_reported() {
        let mut all = groups(|_| 1.0, 2);
        assert!(other_images(&all).is_empty());
        all[0].pairs[1].1.renderer = Some("other".to_owned());
        assert!(other_images(&all)[0].starts_with("x: the images of A and B"));
    }

    #[test]
    fn lost_frames_count_and_failed_runs_are_reported() {
        let mut all = groups(|_| 1.0, 8);
        for (_, b) in &mut all[0].pairs {
            b.figures.as_mut().unwrap().lost = 3;
        }
        assert_eq!(compare(&all).worse, ["x: lost frames"]);
        let b = &mut all[0].pairs[2].1;
        (b.figures, b.error) = (None, Some("timed out after 9 s".to_owned()));
        let said = broken(&all);
        assert_eq!(said.len(), 1);
        assert!(said[0].1 && said[0].0 == "x, seed 2: B has no error: timed out after 9 s");
    }
}
