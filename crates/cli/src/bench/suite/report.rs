//! The report of a suite as Markdown, which also reads well in a terminal.

use crate::bench::suite::{Errors, Report, Row, State};
use stillpoint::evaluation::{Align, Table};

pub(crate) fn markdown(report: &Report) -> String {
    let m = &report.machine;
    let mut text = format!(
        "# Suite {}\n\nMade by `{}`.\n\n{}, {} cores, {}; {}; Stillpoint {}; detector: {}.\n\n",
        report.suite,
        report.command,
        m.cpu,
        m.cores,
        m.system,
        m.rustc,
        m.stillpoint,
        report.detector
    );
    text += "Errors of the final poses: median over the runs, and after the stroke the worst run. ATE after alignment by a rigid \
             motion; RPE over 1 s. \"tracked\" is the share of frames with a pose. \"published\" is the ATE RMSE of a dynamic \
             RGB-D system of this kind, \"best\" that of a better one where there is one, \"unfiltered\" that of the published \
             system with its rejection of moving things switched off. Published figures come from the systems' papers, \
             not from this machine; ours go through tracking and mapping one after the other, with nothing dropped.\n\n";
    let mut table = Table::new([
        "sequence",
        "state",
        "frames",
        "tracked %",
        "ATE mm",
        "SD",
        "RPE mm/s",
        "SD",
        "RPE deg/s",
        "SD",
        "published mm",
        "best mm",
        "unfiltered mm",
    ])
    .align(1, Align::Left);
    for row in &report.sequences {
        table.row(cells(row));
    }
    text += &table.to_markdown();
    let notes: Vec<String> = report.sequences.iter().flat_map(notes).collect();
    if !notes.is_empty() {
        text += "\n";
        text += &notes.concat();
    }
    text
}

fn cells(row: &Row) -> Vec<String> {
    let absent = || "-".to_owned();
    let f = row.figures.as_ref();
    let both = |e: Option<Errors>, factor: f64, digits: usize| match e {
        None => [absent(), absent()],
        Some(e) => [
            format!(
                "{:.digits$} / {:.digits$}",
                e.rmse.median * factor,
                e.rmse.worst * factor
            ),
            format!("{:.digits$}", e.sd.median * factor),
        ],
    };
    let mut cells = vec![
        row.name.to_owned(),
        state(row).to_owned(),
        f.map_or_else(absent, |f| f.frames.to_string()),
        f.map_or_else(absent, |f| {
            format!(
                "{:.1} / {:.1}",
                f.tracked.median * 100.0,
                f.tracked.worst * 100.0
            )
        }),
    ];
    cells.extend(both(f.and_then(|f| f.ate), 1e3, 1));
    cells.extend(both(f.and_then(|f| f.rpe_translation), 1e3, 1));
    cells.extend(both(f.and_then(|f| f.rpe_rotation_deg), 1.0, 2));
    let p = &row.published;
    cells.extend(
        [p.reference, p.best, p.unfiltered]
            .map(|ate| ate.map_or_else(absent, |ate| format!("{:.1}", ate * 1e3))),
    );
    cells
}

fn state(row: &Row) -> &'static str {
    match row.state {
        State::Ran => match &row.figures {
            Some(f) if f.tracked.worst < 1.0 => "lost frames",
            Some(f) if f.ate.is_none() && f.drift.is_none() => "no score",
            _ => "ran",
        },
        State::Failed => "failed",
        State::NotRun => "not run",
        State::NotFound => "not found",
    }
}

/// What does not fit into the table.
fn notes(row: &Row) -> Vec<String> {
    let mut notes = Vec::new();
    let mut add = |text: &str| notes.push(format!("- {}: {text}\n", row.name));
    if let Some(e) = &row.error {
        // A message of several lines would end the list.
        add(&e.split_whitespace().collect::<Vec<_>>().join(" "));
    }
    if let Some(f) = &row.figures {
        if let Some(d) = f.drift {
            add(&format!(
                "the camera stands still in the ground truth; drift RMSE {:.2} / {:.2} mm",
                d.rmse.median * 1e3,
                d.rmse.worst * 1e3
            ));
        }
        if !f.identical {
            add("the runs differ");
        }
        if f.ate.is_some() && f.evaluated < f.frames {
            add(&format!(
                "ATE is about {} of {} frames: the others have no pose or no ground truth",
                f.evaluated, f.frames
            ));
        }
    }
    if !row.note.is_empty() {
        add(row.note);
    }
    notes
}
