//! The tables of docs/benchmarks.md: variants side by side, times by stage, latency of live runs.

use super::{Row, megabytes, rows};
use crate::results::{Figures, Live, Run, Time};
use crate::table::{ABSENT, Align, Table, figure, spread};

/// ATE, mm: median over the seeds, slash, the worst if it differs; and the share of frames with a pose if some have none.
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

/// Median relative error over 1 s, mm / degrees.
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

/// A row per input and variant: errors, and numbers of lost and wrong frames; the columns are those of `lab sweep`.
pub(crate) fn errors(runs: &[Run]) -> Table {
    let head = [
        "input",
        "variant",
        "ATE, mm",
        "at each frame",
        "RPE, mm",
        "worst frame, mm",
        "lost",
        "wrong",
    ];
    let mut table = Table::new(head).align(1, Align::Left);
    for row in rows(runs) {
        let [ate, online, rpe, worst] = row.errors();
        table.row([
            row.name(),
            row.variant.to_owned(),
            ate,
            online,
            rpe,
            worst,
            row.sum(|f| f.lost),
            row.sum(|f| f.wrong),
        ]);
    }
    table
}

/// Columns of the table of times: span and title.
const STAGES: [(&str, &str); 7] = [
    ("extract", "extract"),
    ("flow", "flow"),
    ("filter", "filter"),
    ("match", "match"),
    ("pose", "pose"),
    ("network", "network"),
    ("map", "per keyframe"),
];

/// A row per input and variant: times of frames and stages, and memory; medians over the seeds.
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

/// A row per input and variant of live runs: medians, and in brackets the maximum.
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

    fn cells(table: &Table, line: usize) -> Vec<String> {
        let text = table.to_markdown();
        let cells = text.lines().nth(line).unwrap().split('|');
        let cells: Vec<String> = cells.map(|c| c.trim().to_owned()).collect();
        cells[1..cells.len() - 1].to_vec()
    }

    #[test]
    fn variants_are_shown_side_by_side() {
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
    fn times_and_latency_match_the_runs() {
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
}
