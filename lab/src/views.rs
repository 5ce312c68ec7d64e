//! Runs as tables: what `lab sweep` and `lab peers` print and documents show.

use crate::results::{Figures, Live, Run, Time};
use crate::table::{ABSENT, Align, Table, figure, median_and_range, spread};

/// Runs of one row.
struct Row<'a> {
    input: &'a str,
    variant: &'a str,
    runs: Vec<&'a Run>,
}

/// Runs by input and variant, in the order in which they first come.
fn rows(runs: &[Run]) -> Vec<Row<'_>> {
    let mut rows: Vec<Row<'_>> = Vec::new();
    for run in runs {
        let (input, variant) = (run.key.input.as_str(), run.key.variant.as_str());
        match rows
            .iter_mut()
            .find(|r| (r.input, r.variant) == (input, variant))
        {
            Some(row) => row.runs.push(run),
            None => rows.push(Row {
                input,
                variant,
                runs: vec![run],
            }),
        }
    }
    rows
}

impl Row<'_> {
    fn figures(&self) -> impl Iterator<Item = &Figures> {
        self.runs.iter().filter_map(|r| r.figures.as_ref())
    }

    fn all(&self, of: impl Fn(&Figures) -> Option<f64>) -> Vec<f64> {
        self.figures().filter_map(of).collect()
    }

    fn sum(&self, of: impl Fn(&Figures) -> usize) -> String {
        self.figures().map(of).sum::<usize>().to_string()
    }
}

/// A row per input and variant: medians over the seeds, with the range where they differ; frames of all seeds.
pub(crate) fn sweep(runs: &[Run]) -> Table {
    let mut table = Table::new([
        "input",
        "variant",
        "runs",
        "ATE, mm",
        "at each frame",
        "RPE, mm",
        "worst, mm",
        "lost",
        "undecided",
        "wrong",
        "frame, ms",
        "MB",
    ])
    .align(1, Align::Left);
    for row in rows(runs) {
        let failed = row.runs.len() - row.figures().count();
        let count = match failed {
            0 => row.runs.len().to_string(),
            _ => format!("{}, {failed} failed", row.runs.len()),
        };
        let drift = row.figures().any(|f| f.drift);
        table.row([
            format!("`{}`{}", row.input, if drift { " (drift)" } else { "" }),
            row.variant.to_owned(),
            count,
            median_and_range(row.all(|f| f.ate_mm), 1),
            median_and_range(row.all(|f| f.online_ate_mm), 1),
            figure(spread(row.all(|f| f.rpe_mm))[0], 1),
            figure(spread(row.all(|f| f.worst_mm))[2], 1),
            row.sum(|f| f.lost),
            row.sum(|f| f.undecided.unwrap_or(0)),
            row.sum(|f| f.wrong),
            figure(spread(row.all(Figures::frame_ms))[0], 1),
            megabytes(&row),
        ]);
    }
    table
}

/// A row per program, as README quotes it: median errors by input, lowest to highest, and frames without a pose; times of the fastest and the slowest input, the
/// largest memory. A first frame without a pose is not counted as lost.
pub(crate) fn peers(runs: &[Run], names: &[(&str, &str, &str)]) -> Table {
    let rows = rows(runs);
    let mut inputs: Vec<&str> = Vec::new();
    for row in &rows {
        if !inputs.contains(&row.input) {
            inputs.push(row.input);
        }
    }
    let mut head = vec![String::new()];
    head.extend(inputs.iter().map(|name| format!("`{name}`")));
    head.extend(["ms per frame", "memory", "licence"].map(str::to_owned));
    let last = head.len() - 1;
    let mut table = Table::new(head).align(last, Align::Left);
    for (program, title, licence) in names {
        let mut cells = vec![(*title).to_owned()];
        let (mut times, mut memory) = (Vec::new(), Vec::new());
        for input in &inputs {
            let row = rows
                .iter()
                .find(|r| (r.input, r.variant) == (*input, *program));
            let Some(row) = row else {
                cells.push(figure(f64::NAN, 0));
                continue;
            };
            let error = median_and_range(row.all(|f| f.ate_mm), 1);
            let lost = spread(row.all(|f| Some(f.lost as f64)))[0];
            let lost = if lost > 1.0 {
                format!(", {lost:.0} lost")
            } else {
                String::new()
            };
            cells.push(error + &lost);
            times.extend(Some(spread(row.all(Figures::frame_ms))[0]).filter(|t| !t.is_nan()));
            memory.extend(row.all(|f| f.memory_bytes.map(|b| b as f64 * 1e-6)));
        }
        let ([_, fastest, slowest], [.., most]) = (spread(times), spread(memory));
        cells.push(format!("{} to {}", figure(fastest, 0), figure(slowest, 0)));
        cells.push(format!("{} MB", figure(most, 0)));
        cells.push((*licence).to_owned());
        table.row(cells);
    }
    table
}

/// ATE, mm, with the share of frames that have a pose where some have none: median over the seeds and, after the stroke, the worst where they differ.
pub(crate) fn position(row: &[&Figures]) -> String {
    let [median, _, worst] = spread(row.iter().filter_map(|f| f.ate_mm)).map(|v| figure(v, 1));
    let error = if median == worst {
        median
    } else {
        format!("{median} / {worst}")
    };
    let posed = |f: &&Figures| (f.frames - f.lost) as f64 / f.frames.max(1) as f64;
    let share = (100.0 * spread(row.iter().map(posed))[0]).floor();
    if share < 99.0 {
        format!("{error} ({share:.0} %)")
    } else {
        error
    }
}

/// Median error of the motion over 1 s, mm / degrees.
pub(crate) fn motion(row: &[&Figures]) -> String {
    let median = |of: fn(&Figures) -> Option<f64>, digits| {
        figure(spread(row.iter().filter_map(|f| of(f)))[0], digits)
    };
    let (mm, degrees) = (median(|f| f.rpe_mm, 1), median(|f| f.rpe_deg, 2));
    if mm == ABSENT {
        mm
    } else {
        format!("{mm} / {degrees}")
    }
}

/// A row per input, a column per variant.
pub(crate) fn variants(runs: &[Run], cell: fn(&[&Figures]) -> String) -> Table {
    let rows = rows(runs);
    let distinct = |of: for<'a> fn(&Row<'a>) -> &'a str| {
        let mut all: Vec<&str> = Vec::new();
        for name in rows.iter().map(of) {
            if !all.contains(&name) {
                all.push(name);
            }
        }
        all
    };
    let (inputs, names) = (distinct(|r| r.input), distinct(|r| r.variant));
    let mut head = vec!["input".to_owned(), "frames".to_owned()];
    head.extend(names.iter().map(|n| (*n).to_owned()));
    let mut table = Table::new(head);
    for input in inputs {
        let of = |name: &str| rows.iter().find(|r| (r.input, r.variant) == (input, name));
        let some = rows.iter().filter(|r| r.input == input);
        let frames = some.clone().flat_map(Row::figures).map(|f| f.frames).max();
        let drift = some.flat_map(Row::figures).any(|f| f.drift);
        let mut cells = vec![
            format!("`{input}`{}", if drift { " (drift)" } else { "" }),
            frames.map_or_else(|| ABSENT.to_owned(), |n| n.to_string()),
        ];
        cells.extend(names.iter().map(|name| {
            let figures: Vec<&Figures> = of(name).into_iter().flat_map(Row::figures).collect();
            if figures.is_empty() {
                ABSENT.to_owned()
            } else {
                cell(&figures)
            }
        }));
        table.row(cells);
    }
    table
}

/// What the table of times shows: the span's name, and what it is.
const STAGES: [(&str, &str); 7] = [
    ("extract", "extract"),
    ("flow", "flow"),
    ("filter", "filter"),
    ("match", "match"),
    ("pose", "pose"),
    ("network", "network"),
    ("map", "per keyframe"),
];

/// A row per input and variant: the time of a frame, of its parts, and memory, medians over the seeds.
pub(crate) fn stages(runs: &[Run]) -> Table {
    let head = ["input", "variant", "frame, ms", "95 %", "largest"];
    let head = head.into_iter().chain(STAGES.map(|s| s.1));
    let mut table = Table::new(head.chain(["MB"])).align(1, Align::Left);
    for row in rows(runs) {
        let time = |stage: &str, of: fn(&Time) -> Option<f64>, digits| {
            let values = row.all(|f| f.time_ms.get(stage).and_then(of));
            figure(spread(values)[0], digits)
        };
        let mut cells = vec![
            format!("`{}`", row.input),
            row.variant.to_owned(),
            time("frame", |t| Some(t.median), 1),
            time("frame", |t| t.p95, 1),
            time("frame", |t| t.max, 0),
        ];
        cells.extend(STAGES.map(|(name, _)| time(name, |t| Some(t.median), 1)));
        cells.push(megabytes(&row));
        table.row(cells);
    }
    table
}

/// Largest memory of the runs of a row, MB.
fn megabytes(row: &Row<'_>) -> String {
    let all = row.all(|f| f.memory_bytes.map(|b| b as f64 * 1e-6));
    figure(spread(all)[2], 0)
}

/// A row per input and variant of live runs: medians, and in brackets the largest.
pub(crate) fn latency(runs: &[Run]) -> Table {
    let mut table = Table::new([
        "input",
        "variant",
        "runs",
        "dropped, %",
        "latency, ms",
        "95 %",
        "99 %",
        "detections/s",
        "their age, ms",
        "ATE, mm",
        "MB",
    ])
    .align(1, Align::Left);
    for row in rows(runs) {
        let live = |of: fn(&Live) -> Option<f64>, digits| {
            let [median, _, most] = spread(row.all(|f| f.live.as_ref().and_then(of)));
            let [median, most] = [median, most].map(|v| figure(v, digits));
            if median == most {
                median
            } else {
                format!("{median} ({most})")
            }
        };
        let [ate, _, worst] = spread(row.all(|f| f.ate_mm)).map(|v| figure(v, 1));
        table.row([
            format!("`{}`", row.input),
            row.variant.to_owned(),
            row.runs.len().to_string(),
            live(|l| Some(100.0 * l.dropped_share), 1),
            live(|l| Some(l.latency_ms.median), 1),
            live(|l| l.latency_ms.p95, 1),
            live(|l| l.latency_ms.p99, 1),
            live(|l| Some(l.detections_per_second), 1),
            live(|l| Some(l.detections_age_ms), 0),
            format!("{ate} ({worst})"),
            megabytes(&row),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::tests::run;

    /// The cells of a line of a table.
    fn cells(table: &Table, line: usize) -> Vec<String> {
        let text = table.to_markdown();
        let cells = text.lines().nth(line).unwrap().split('|');
        let cells: Vec<String> = cells.map(|c| c.trim().to_owned()).collect();
        cells[1..cells.len() - 1].to_vec()
    }

    #[test]
    fn variants_stand_side_by_side() {
        let mut runs = vec![
            run("a", "off", 0, 10.0),
            run("a", "off", 1, 30.0),
            run("a", "off", 2, 20.0),
            run("a", "on", 0, 1.0),
            run("b", "on", 0, 2.0),
        ];
        for r in &mut runs[..3] {
            r.figures.as_mut().unwrap().lost = 40;
        }
        let table = variants(&runs, position);
        assert_eq!(cells(&table, 0), ["input", "frames", "off", "on"]);
        assert_eq!(
            cells(&table, 2),
            ["`a`", "100", "20.0 / 30.0 (60 %)", "1.0"]
        );
        assert_eq!(cells(&table, 3), ["`b`", "100", "-", "2.0"]);
        let figures = runs[3].figures.as_mut().unwrap();
        (figures.rpe_mm, figures.rpe_deg) = (Some(3.21), Some(0.5));
        let table = variants(&runs, motion);
        assert_eq!(cells(&table, 2), ["`a`", "100", "-", "3.2 / 0.50"]);
    }

    #[test]
    fn times_and_latency_are_those_of_the_runs() {
        let mut runs = [5.0, 7.0, 6.0].map(|ms| run("a", "nano", ms as u64, ms));
        for (k, r) in runs.iter_mut().enumerate() {
            let figures = r.figures.as_mut().unwrap();
            let time = |median: f64| Time {
                median,
                p95: Some(median + 1.0),
                p99: Some(median + 2.0),
                max: Some(median + 3.0),
            };
            let frame = time(figures.ate_mm.unwrap());
            figures.time_ms.insert("frame".to_owned(), frame);
            figures.time_ms.insert("flow".to_owned(), time(1.5));
            figures.memory_bytes = Some(7_000_000);
            figures.live = Some(Live {
                dropped_share: 0.01 * k as f64,
                latency_ms: frame,
                detections_per_second: 29.0,
                detections_age_ms: 50.0,
            });
        }
        let row = cells(&stages(&runs), 2);
        assert_eq!(row[..5], ["`a`", "nano", "6.0", "7.0", "9"]);
        assert_eq!(row[5..], ["-", "1.5", "-", "-", "-", "-", "-", "7"]);
        let row = cells(&latency(&runs), 2);
        assert_eq!(row[2..6], ["3", "1.0 (2.0)", "6.0 (7.0)", "7.0 (8.0)"]);
        assert_eq!(row[6..], ["8.0 (9.0)", "29.0", "50", "6.0 (7.0)", "7"]);
    }

    #[test]
    fn rows_hold_medians_sums_and_failures() {
        let mut runs = [1.0, 3.0, 2.0]
            .map(|ate| run("sim:a", "off", ate as u64, ate))
            .to_vec();
        for (k, r) in runs.iter_mut().enumerate() {
            let figures = r.figures.as_mut().unwrap();
            (figures.lost, figures.wrong) = (k, 2);
        }
        let mut broken = run("sim:a", "off", 9, 0.0);
        (broken.figures, broken.error) = (None, Some("no".to_owned()));
        runs.push(broken);
        let text = sweep(&runs).to_markdown();
        let cells: Vec<&str> = text
            .lines()
            .nth(2)
            .unwrap()
            .split('|')
            .map(str::trim)
            .collect();
        let expected = [
            "`sim:a`",
            "off",
            "4, 1 failed",
            "2.0 (1.0 to 3.0)",
            "-",
            "-",
            "-",
            "3",
            "0",
            "6",
        ];
        assert_eq!(cells[1..11], expected);
    }

    #[test]
    fn peers_stand_side_by_side() {
        let mut runs = vec![
            run("a", "x", 0, 1.0),
            run("a", "y", 0, 2.0),
            run("b", "x", 0, 3.0),
        ];
        for r in &mut runs {
            let figures = r.figures.as_mut().unwrap();
            figures.lost = if r.key.variant == "y" { 15 } else { 1 };
            figures.time_ms.insert(
                "frame".to_owned(),
                Time {
                    median: 5.0,
                    ..Time::default()
                },
            );
            figures.memory_bytes = Some(7_000_000);
        }
        let text = peers(&runs, &[("x", "X", "MIT"), ("y", "Y", "none")]).to_markdown();
        let cells = |line: usize| -> Vec<String> {
            let line = text.lines().nth(line).unwrap();
            line.split('|')
                .map(|c| c.trim().to_owned())
                .filter(|c| !c.is_empty())
                .collect()
        };
        assert_eq!(cells(2), ["X", "1.0", "3.0", "5 to 5", "7 MB", "MIT"]);
        assert_eq!(
            cells(3),
            ["Y", "2.0, 15 lost", "-", "5 to 5", "7 MB", "none"]
        );
    }
}
