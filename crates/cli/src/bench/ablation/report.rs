//! The report of an ablation as Markdown.

use crate::bench::ablation::{Cell, Report, Row, Variant};
use crate::bench::figures::{Errors, Figures};
use crate::bench::suite::published::{ABLATION_TABLE, System, sources};
use stillpoint::evaluation::{Align, Table};

pub(crate) fn markdown(report: &Report) -> String {
    let m = &report.machine;
    let mut text = format!(
        "# Ablation of the static filter\n\nMade by `{}`.\n\n{}, {} cores, {}; {}; Stillpoint {}.\n\n",
        report.command, m.cpu, m.cores, m.system, m.rustc, m.stillpoint
    );
    text += "O: objects. G: epipolar constraint. D: depth within boxes. The first five configurations are the published method \
             with that much of it (preset `off`, else `paper`), on this project's tracking and mapping, which are not ORB-SLAM2's; the last is this project's own filter (preset `default`). ATE is \
             that of the final poses after alignment by a rigid motion; SD is its standard deviation over the frames. Frames go \
             through tracking and mapping one after the other, with nothing dropped.\n\n";
    text += &runs(&report.seeds);
    text += "\n\nATE RMSE in mm: median over the seeds and, after the stroke, the worst one where they differ; in brackets the median share of frames with \
             a pose, where some have none.\n\n";
    text += &overview(&report.sequences);
    text +=
        "\nIn detail: after the stroke the worst seed. \"rejected\" is the share of keypoints.\n\n";
    text += &details(&report.sequences);
    let notes: String = report.sequences.iter().map(notes).collect();
    if !notes.is_empty() {
        text += "\n";
        text += &notes;
    }
    if report.sequences.iter().any(|r| r.published.is_some()) {
        text += "\n";
        text += &sources(&[System::Paper], ABLATION_TABLE);
    }
    text
}

/// Number of runs and how they differ, in words.
pub(crate) fn runs(seeds: &[u64]) -> String {
    match seeds {
        [] => String::new(),
        [one] => format!("One seed each, {one}: no spread is known."),
        [first, .., last] => format!(
            "{} seeds each ({first} to {last}): the runs differ in the seed of the system's random choices and in nothing else. The same seed \
             gives the same result.",
            seeds.len()
        ),
    }
}

/// A line per sequence, a column per configuration, as in published ablations.
pub(crate) fn overview<'a>(rows: impl IntoIterator<Item = &'a Row>) -> String {
    let header = ["sequence"].into_iter();
    let mut table = Table::new(header.chain(Variant::ALL.map(Variant::label)));
    for row in rows {
        let ours = Variant::ALL.map(|v| {
            let cell = row.variants.iter().find(|c| c.variant == v.label());
            cell.map_or_else(absent, short)
        });
        table.row([row.name.clone()].into_iter().chain(ours));
        if let Some(p) = &row.published {
            let theirs = p.ate.map(|ate| format!("{:.1}", ate * 1e3));
            let name = format!("{} as published", p.recording);
            table.row([name].into_iter().chain(theirs));
        }
    }
    table.to_markdown()
}

fn absent() -> String {
    "-".to_owned()
}

/// The absolute error, or the drift where the ground truth stands still.
fn errors(figures: &Figures) -> Option<Errors> {
    figures.ate.or(figures.drift)
}

fn short(cell: &Cell) -> String {
    let Some(figures) = &cell.figures else {
        return "failed".to_owned();
    };
    let error = errors(figures).map_or_else(absent, |e| {
        let [median, worst] = [e.rmse.median, e.rmse.worst].map(|x| format!("{:.1}", x * 1e3));
        if median == worst {
            median
        } else {
            format!("{median} / {worst}")
        }
    });
    let tracked = figures.tracked.median;
    if tracked < 1.0 {
        format!("{error} ({:.0} %)", floor_percent(tracked))
    } else {
        error
    }
}

/// Rounds down, so that 100 % means all frames.
fn floor_percent(share: f64) -> f64 {
    (share * 100.0).floor()
}

fn details(rows: &[Row]) -> String {
    let mut table = Table::new([
        "sequence",
        "filter",
        "frames",
        "tracked %",
        "ATE mm",
        "SD",
        "rejected %",
    ])
    .align(1, Align::Left);
    for row in rows {
        for cell in &row.variants {
            let f = cell.figures.as_ref();
            let e = f.and_then(errors);
            table.row([
                row.name.clone(),
                cell.variant.to_owned(),
                f.map_or_else(absent, |f| f.frames.to_string()),
                f.map_or_else(absent, |f| {
                    let (median, worst) = (f.tracked.median * 100.0, f.tracked.worst * 100.0);
                    format!("{median:.1} / {worst:.1}")
                }),
                e.map_or_else(absent, |e| {
                    let (median, worst) = (e.rmse.median * 1e3, e.rmse.worst * 1e3);
                    format!("{median:.1} / {worst:.1}")
                }),
                e.map_or_else(absent, |e| format!("{:.1}", e.sd.median * 1e3)),
                cell.rejected
                    .map_or_else(absent, |share| format!("{:.1}", share * 100.0)),
            ]);
        }
    }
    table.to_markdown()
}

/// Remarks that do not fit into the tables.
fn notes(row: &Row) -> String {
    let mut text = String::new();
    let mut add = |note: &str| {
        // A line break would end the list.
        let note: Vec<&str> = note.split_whitespace().collect();
        text += &format!("- {}: {}\n", row.name, note.join(" "));
    };
    add(&format!("detector: {}", row.detector));
    if row.error.is_none() && row.blind {
        add("without a detector O, O+G and O+G+D are the same as none and G, and were left out");
    }
    if row.published.is_some() && row.name.starts_with("sim:") {
        add(
            "the published figures are about the recording of that name, which the simulated scene is modelled on",
        );
    }
    if let Some(e) = &row.error {
        add(e);
    }
    let same = |c: &&Cell| {
        c.figures
            .as_ref()
            .is_some_and(|f| f.identical == Some(true))
    };
    let same: Vec<&str> = row
        .variants
        .iter()
        .filter(same)
        .map(|c| c.variant)
        .collect();
    if !same.is_empty() {
        add(&format!("the seed changes nothing for {}", same.join(", ")));
    }
    let drift = |c: &Cell| {
        c.figures
            .as_ref()
            .is_some_and(|f| f.ate.is_none() && f.drift.is_some())
    };
    if row.variants.iter().any(drift) {
        add("the camera stands still in the ground truth; the error is the drift");
    }
    for cell in &row.variants {
        if let Some(e) = &cell.error {
            add(&format!("{}: {e}", cell.variant));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_listed_by_their_seeds() {
        assert_eq!(runs(&[4]), "One seed each, 4: no spread is known.");
        let many = runs(&[4, 5, 6]);
        assert!(many.starts_with("3 seeds each (4 to 6)"), "{many}");
    }

    #[test]
    fn percentage_is_rounded_down() {
        assert_eq!(floor_percent(0.999), 99.0);
        assert_eq!(floor_percent(1.0), 100.0);
    }
}
