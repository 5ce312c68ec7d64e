//! The report of a suite as Markdown, which also reads well in a terminal.

use crate::bench::ablation::report::runs;
use crate::bench::runner::median;
use crate::bench::suite::catalogue::Suite;
use crate::bench::suite::published::{Figure, Published, sources};
use crate::bench::suite::{Case, Errors, Report, Row, State};
use crate::run::summary::Summary;
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
    text += &runs(&report.seeds);
    text += "\n\nErrors of the final poses: median over the seeds, and after the stroke the worst one. ATE after alignment by a rigid motion; RPE \
             over 1 s. \"tracked\" is the share of frames with a pose. \"ms\" is tracking, without reading the image and without the network: median \
             / p95. Frames go through tracking and mapping one after the other, with nothing dropped; in \"live\" runs the recording is played as a \
             camera, with a thread per stage, and \"ms\" is from a frame's arrival to its pose.\n\n";
    let mut table = Table::new([
        "sequence",
        "case",
        "state",
        "frames",
        "tracked %",
        "ATE mm",
        "SD",
        "RPE mm/s",
        "SD",
        "RPE deg/s",
        "SD",
        "ms",
    ])
    .align(1, Align::Left)
    .align(2, Align::Left);
    for row in &report.sequences {
        if row.cases.is_empty() {
            let mut cells = vec![row.name.to_owned(), String::new(), state(row, None).into()];
            cells.extend(std::iter::repeat_with(absent).take(9));
            table.row(cells);
        }
        for case in &row.cases {
            table.row(cells(row, case));
        }
    }
    text += &table.to_markdown();
    let notes: Vec<String> = report.sequences.iter().flat_map(notes).collect();
    if !notes.is_empty() {
        text += "\n";
        text += &notes.concat();
    }
    text + "\n" + &compared(report, suite)
}

/// A row per system that figures were published of, and ours below them.
fn compared(report: &Report, suite: Suite) -> String {
    let mut table = Table::new([
        "sequence",
        "system",
        "ATE mm",
        "SD",
        "RPE mm/s",
        "SD",
        "RPE deg/s",
        "SD",
        "ms per frame",
        "source",
    ])
    .align(1, Align::Left)
    .align(8, Align::Left)
    .align(9, Align::Left);
    for row in report.sequences.iter().filter(|r| !r.published.is_empty()) {
        for published in &row.published {
            table.row(published_cells(row.name, published));
        }
        for case in row.cases.iter().filter(|c| c.cell.figures.is_some()) {
            table.row(own_cells(row.name, case));
        }
    }
    let errors = suite.published();
    let sources = sources(errors.systems(), errors.tables);
    format!(
        "Beside published figures. Times were taken on the machines that stand beside them; ours is that of tracking on this one.\n\n{}\n{sources}",
        table.to_markdown()
    )
}

fn published_cells(sequence: &str, p: &Published) -> Vec<String> {
    let both = |f: Option<Figure>, factor: f64, digits: usize| {
        let text = |x: f64| format!("{:.digits$}", x * factor);
        [
            f.map_or_else(absent, |f| text(f.rmse)),
            f.and_then(|f| f.sd).map_or_else(absent, text),
        ]
    };
    let mut cells = vec![sequence.to_owned(), p.system.to_owned()];
    cells.extend(both(p.ate, 1e3, 1));
    cells.extend(both(p.rpe_translation, 1e3, 1));
    cells.extend(both(p.rpe_rotation_deg, 1.0, 2));
    let times: Vec<String> = p
        .ms_per_frame
        .iter()
        .map(|(ms, machine)| format!("{ms} ({machine})"))
        .collect();
    cells.push(if times.is_empty() {
        absent()
    } else {
        times.join(", ")
    });
    let tables = [p.ate, p.rpe_translation, p.rpe_rotation_deg];
    let tables: Vec<&str> = tables.iter().flatten().map(|f| f.table).collect();
    let paper = crate::bench::suite::published::System::Paper.mark();
    let quoted = if p.mark == paper {
        String::new()
    } else {
        format!(", quoting {}", p.mark)
    };
    cells.push(format!("{paper} {}{quoted}", tables.join(", ")));
    cells
}

fn own_cells(sequence: &str, case: &Case) -> Vec<String> {
    let label = case.label();
    let system = match label.as_str() {
        "" => "Stillpoint".to_owned(),
        label => format!("Stillpoint, {label}"),
    };
    let mut cells = vec![sequence.to_owned(), system];
    cells.extend(errors(case));
    cells.push(milliseconds(case));
    cells.push("this run".to_owned());
    cells
}

fn absent() -> String {
    "-".to_owned()
}

/// RMSE (median and worst) and SD of the absolute and of both relative errors.
fn errors(case: &Case) -> Vec<String> {
    let f = case.cell.figures.as_ref();
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
    [
        both(f.and_then(|f| f.ate), 1e3, 1),
        both(f.and_then(|f| f.rpe_translation), 1e3, 1),
        both(f.and_then(|f| f.rpe_rotation_deg), 1.0, 2),
    ]
    .concat()
}

/// Median and p95 of the time that a frame takes, each as the median over the runs.
fn milliseconds(case: &Case) -> String {
    let figures = |run: &Summary| {
        if let Some(live) = &run.live {
            return Some([live.latency_ms.median, live.latency_ms.p95]);
        }
        let frame = run.timing_ms.iter().find(|s| s.stage == "frame")?;
        Some([frame.median, frame.p95])
    };
    let all: Vec<[f64; 2]> = case.cell.runs.iter().filter_map(figures).collect();
    if all.is_empty() {
        return absent();
    }
    let [middle, late] = [0, 1].map(|k| median(all.iter().map(|f| f[k]).collect()));
    format!("{middle:.1} / {late:.1}")
}

fn cells(row: &Row, case: &Case) -> Vec<String> {
    let f = case.cell.figures.as_ref();
    let mut cells = vec![
        row.name.to_owned(),
        case.label(),
        state(row, Some(case)).to_owned(),
        f.map_or_else(absent, |f| f.frames.to_string()),
        f.map_or_else(absent, |f| {
            format!(
                "{:.1} / {:.1}",
                f.tracked.median * 100.0,
                f.tracked.worst * 100.0
            )
        }),
    ];
    cells.extend(errors(case));
    cells.push(milliseconds(case));
    cells
}

fn state(row: &Row, case: Option<&Case>) -> &'static str {
    match (row.state, case.map(|c| c.cell.figures.as_ref())) {
        (State::NotFound, _) => "not found",
        (State::NotRun, None) => "not run",
        (_, None | Some(None)) => "failed",
        (_, Some(Some(f))) if f.tracked.worst < 1.0 => "lost frames",
        (_, Some(Some(f))) if f.ate.is_none() && f.drift.is_none() => "no score",
        _ => "ran",
    }
}

/// What does not fit into the table.
fn notes(row: &Row) -> Vec<String> {
    let mut notes = Vec::new();
    for case in &row.cases {
        let label = match case.label().as_str() {
            "" => row.name.to_owned(),
            label => format!("{}, {label}", row.name),
        };
        let mut add = |text: &str| notes.push(format!("- {label}: {text}\n"));
        if let Some(e) = &case.cell.error {
            // A message of several lines would end the list.
            add(&e.split_whitespace().collect::<Vec<_>>().join(" "));
        }
        let Some(f) = &case.cell.figures else {
            continue;
        };
        if let Some(d) = f.drift {
            add(&format!(
                "the camera stands still in the ground truth; drift RMSE {:.2} / {:.2} mm",
                d.rmse.median * 1e3,
                d.rmse.worst * 1e3
            ));
        }
        if f.identical == Some(true) {
            add("the seed changes nothing");
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
