//! Tables of runs for `lab sweep`, `lab peers` and the documents.

mod benchmarks;

pub(crate) use benchmarks::{errors, latency, motion, position, stages, variants};

use crate::results::{Figures, Run};
use crate::table::{Align, Table, figure, median_and_range, spread};

struct Row<'a> {
    input: &'a str,
    variant: &'a str,
    runs: Vec<&'a Run>,
}

/// Runs by input and variant, in order of first occurrence.
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

    fn name(&self) -> String {
        let drift = self.figures().any(|f| f.drift);
        format!("`{}`{}", self.input, if drift { " (drift)" } else { "" })
    }

    /// Errors, mm: ATE of the final poses and of those at each frame, with the seeds' ranges; the median RPE; the worst frame of all seeds.
    fn errors(&self) -> [String; 4] {
        [
            median_and_range(self.all(|f| f.ate_mm), 1),
            median_and_range(self.all(|f| f.online_ate_mm), 1),
            figure(spread(self.all(|f| f.rpe_mm))[0], 1),
            figure(spread(self.all(|f| f.worst_mm))[2], 1),
        ]
    }

    fn sum(&self, of: impl Fn(&Figures) -> usize) -> String {
        self.figures().map(of).sum::<usize>().to_string()
    }
}

/// A row per input and variant: medians over the seeds, ranges if they differ; frames are summed.
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
        let [ate, online, rpe, worst] = row.errors();
        table.row([
            row.name(),
            row.variant.to_owned(),
            count,
            ate,
            online,
            rpe,
            worst,
            row.sum(|f| f.lost),
            row.sum(|f| f.undecided.unwrap_or(0)),
            row.sum(|f| f.wrong),
            figure(spread(row.all(Figures::frame_ms))[0], 1),
            megabytes(&row),
        ]);
    }
    table
}

/// A row per program, for README: median errors by input with ranges, and frames without a pose (except a first one); times of the fastest
/// and the slowest input, peak memory.
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

/// Peak memory of the runs of a row, MB.
fn megabytes(row: &Row<'_>) -> String {
    let all = row.all(|f| f.memory_bytes.map(|b| b as f64 * 1e-6));
    figure(spread(all)[2], 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Time, tests::run};

    #[test]
    fn rows_show_medians_sums_and_failures() {
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
    fn peers_are_shown_side_by_side() {
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
