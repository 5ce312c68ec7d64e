//! The report of a suite as Markdown, which also reads well in a terminal.

use crate::bench::suite::catalogue::Suite;
use crate::bench::suite::published::sources;
use crate::bench::suite::{Errors, Report, Row, State};
use stillpoint::evaluation::{Align, Table};

pub(crate) fn markdown(report: &Report, suite: Suite) -> String {
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
             motion; RPE over 1 s. \"tracked\" is the share of frames with a pose. Frames go through tracking and mapping one after \
             the other, with nothing dropped. \"published\" is the ATE RMSE of the method that preset `paper` follows; the table \
             after this one has other systems.\n\n";
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
    ])
    .align(1, Align::Left);
    for row in &report.sequences {
        table.row(cells(row, suite));
    }
    text += &table.to_markdown();
    let notes: Vec<String> = report.sequences.iter().flat_map(notes).collect();
    if !notes.is_empty() {
        text += "\n";
        text += &notes.concat();
    }
    text + "\n" + &published(report, suite)
}

/// What others published on the sequences of the suite, and where.
fn published(report: &Report, suite: Suite) -> String {
    let errors = suite.published();
    let header = errors.systems.map(|s| format!("{} {}", s.name(), s.mark()));
    let mut table = Table::new(["ATE RMSE, mm".to_owned()].into_iter().chain(header));
    for row in &report.sequences {
        if let Some(ates) = errors.of(row.name) {
            let ates = ates.map(|ate| ate.map_or_else(|| "-".to_owned(), millimetres));
            table.row([row.name.to_owned()].into_iter().chain(ates));
        }
    }
    let sources = sources(&errors.systems, errors.table);
    format!("Published:\n\n{}\n{sources}", table.to_markdown())
}

fn millimetres(metres: f64) -> String {
    format!("{:.1}", metres * 1e3)
}

fn cells(row: &Row, suite: Suite) -> Vec<String> {
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
    cells.push(
        suite
            .published()
            .paper(row.name)
            .map_or_else(absent, millimetres),
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
        if f.identical == Some(false) {
            add("the runs differ");
        }
        if f.ate.is_some() && f.evaluated < f.frames {
            add(&format!(
                "ATE is about {} of {} frames: the others have no pose or no ground truth",
                f.evaluated, f.frames
            ));
        }
    }
    notes
}
