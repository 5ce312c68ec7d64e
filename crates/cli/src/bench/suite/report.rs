//! The report of a suite as Markdown.

use crate::bench::ablation::Variant;
use crate::bench::ablation::report::runs;
use crate::bench::figures::Errors;
use crate::bench::runner::{Spread, median};
use crate::bench::suite::catalogue::{Suite, published_ablation};
use crate::bench::suite::published::{ABLATION_TABLE, Ablated, Figure, Published, System, sources};
use crate::bench::suite::{Case, Report, Row, State};
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
             camera, with a thread per stage, and \"ms\" is from a frame's arrival to its pose; \"dropped\" is the share of frames that a newer one \
             replaced before they were tracked: they have no part in the errors.\n\n";
    let mut table = Table::new([
        "sequence",
        "case",
        "state",
        "frames",
        "dropped %",
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
            cells.extend(std::iter::repeat_with(absent).take(10));
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

/// A row per system with published figures, and ours below them. The best error of a sequence is bold; runs without a pose for some frames
/// are excluded.
fn compared(report: &Report, suite: Suite) -> String {
    let mut table = Table::new([
        "sequence",
        "system",
        "ATE mm",
        "SD",
        "less than ORB-SLAM2 %",
        "RPE mm/s",
        "SD",
        "RPE deg/s",
        "SD",
        "ms per frame",
        "source",
    ])
    .align(1, Align::Left)
    .align(9, Align::Left)
    .align(10, Align::Left);
    let mut tables = suite.published().tables.to_owned();
    for row in report.sequences.iter().filter(|r| !r.published.is_empty()) {
        let mut lines: Vec<Line> = row.published.iter().map(Line::published).collect();
        if row
            .cases
            .iter()
            .any(|c| c.cell.variant == Variant::None.label())
            && let Some(ablated) = published_ablation(&format!("sim:{}", row.name))
        {
            lines.extend(Line::ablated(&ablated));
            tables = format!(
                "{}, and {ABLATION_TABLE} (its parts)",
                suite.published().tables
            );
        }
        lines.extend(row.cases.iter().filter_map(Line::own));
        let base = row
            .published
            .iter()
            .find(|p| p.system == System::OrbSlam2.name());
        let base = base.and_then(|p| p.ate).map(|f| f.rmse);
        let best = [0, 1, 2].map(|k| {
            let values = lines.iter().filter(|l| l.is_whole);
            values
                .filter_map(|l| l.errors[k].rmse)
                .min_by(f64::total_cmp)
        });
        for line in lines {
            table.row(line.cells(row.name, base, &best));
        }
    }
    format!(
        "Beside published figures. The best error of a sequence is bold. Times were taken on the machines that stand beside them; ours is that of tracking on this one.\n\n{}\n{}",
        table.to_markdown(),
        sources(suite.published().systems(), &tables)
    )
}

#[derive(Clone, Default)]
struct Told {
    /// m or degrees.
    rmse: Option<f64>,
    /// Formatted: RMSE, and standard deviation.
    cells: Option<[String; 2]>,
}

/// A line of the comparison.
struct Line {
    system: String,
    /// Absolute error, relative translation and rotation errors.
    errors: [Told; 3],
    /// Whether every frame has a pose.
    is_whole: bool,
    times: String,
    source: String,
}

/// Factor and number of decimals of the three errors in tables: mm, and degrees.
const WRITTEN: [(f64, usize); 3] = [(1e3, 1), (1e3, 1), (1.0, 2)];

impl Line {
    fn published(p: &Published) -> Self {
        let figures = [p.ate, p.rpe_translation, p.rpe_rotation_deg];
        let tables: Vec<&str> = figures.iter().flatten().map(|f| f.table).collect();
        let paper = System::Paper.mark();
        let quoted = if p.mark == paper {
            String::new()
        } else {
            format!(", quoting {}", p.mark)
        };
        let times = p.ms_per_frame.iter();
        let times: Vec<String> = times.map(|(ms, on)| format!("{ms} ({on})")).collect();
        let mut errors = <[Told; 3]>::default();
        for ((told, figure), written) in errors.iter_mut().zip(figures).zip(WRITTEN) {
            *told = Told::published(figure, written);
        }
        Self {
            system: p.system.to_owned(),
            errors,
            is_whole: true,
            times: if times.is_empty() {
                absent()
            } else {
                times.join(", ")
            },
            source: format!("{paper} {}{quoted}", tables.join(", ")),
        }
    }

    /// The published method with some of its parts.
    fn ablated(ablated: &Ablated) -> impl Iterator<Item = Self> {
        let ablated = *ablated;
        Variant::ALL
            .into_iter()
            .zip(0..ablated.ate.len())
            .map(move |(variant, k)| {
                let figure = Figure {
                    rmse: ablated.ate[k],
                    sd: Some(ablated.sd[k]),
                    table: ABLATION_TABLE,
                };
                let ate = Told::published(Some(figure), WRITTEN[0]);
                Self {
                    system: format!("published method, {}", variant.label()),
                    errors: [ate, Told::default(), Told::default()],
                    is_whole: true,
                    times: absent(),
                    source: format!("{} {ABLATION_TABLE}", System::Paper.mark()),
                }
            })
    }

    fn own(case: &Case) -> Option<Self> {
        let figures = case.cell.figures.as_ref()?;
        let label = case.label();
        let errors = own_errors(case);
        let dropped = figures.dropped.map_or(0.0, |d| d.worst);
        Some(Self {
            system: match label.as_str() {
                "" => "Stillpoint".to_owned(),
                label => format!("Stillpoint, {label}"),
            },
            errors,
            is_whole: figures.tracked.worst >= 1.0 && dropped == 0.0,
            times: milliseconds(case),
            source: "this run".to_owned(),
        })
    }

    fn cells(self, sequence: &str, base: Option<f64>, best: &[Option<f64>; 3]) -> Vec<String> {
        let mut cells = vec![sequence.to_owned(), self.system];
        for (k, told) in self.errors.into_iter().enumerate() {
            let is_best = self.is_whole && told.rmse.is_some() && told.rmse == best[k];
            let [rmse, sd] = told.cells.unwrap_or_else(|| [absent(), absent()]);
            cells.push(if is_best { format!("**{rmse}**") } else { rmse });
            cells.push(sd);
            if k == 0 {
                let less = told
                    .rmse
                    .zip(base)
                    .map(|(e, base)| 100.0 * (1.0 - e / base));
                cells.push(less.map_or_else(absent, |l| format!("{l:.1}")));
            }
        }
        cells.push(self.times);
        cells.push(self.source);
        cells
    }
}

impl Told {
    fn published(figure: Option<Figure>, (factor, digits): (f64, usize)) -> Self {
        let text = |x: f64| format!("{:.digits$}", x * factor);
        Self {
            rmse: figure.map(|f| f.rmse),
            cells: figure.map(|f| [text(f.rmse), f.sd.map_or_else(absent, text)]),
        }
    }

    fn own(errors: Option<Errors>, (factor, digits): (f64, usize)) -> Self {
        let text = |x: f64| format!("{:.digits$}", x * factor);
        let cells = |e: Errors| {
            let rmse = format!("{} / {}", text(e.rmse.median), text(e.rmse.worst));
            [rmse, text(e.sd.median)]
        };
        Self {
            rmse: errors.map(|e| e.rmse.median),
            cells: errors.map(cells),
        }
    }
}

fn absent() -> String {
    "-".to_owned()
}

/// RMSE (median and worst) and SD of the absolute and of both relative errors.
fn own_errors(case: &Case) -> [Told; 3] {
    let f = case.cell.figures.as_ref();
    let [ate, translation, rotation] = WRITTEN;
    [
        Told::own(f.and_then(|f| f.ate), ate),
        Told::own(f.and_then(|f| f.rpe_translation), translation),
        Told::own(f.and_then(|f| f.rpe_rotation_deg), rotation),
    ]
}

/// Median and p95 of the time per frame, each as the median over the runs.
fn milliseconds(case: &Case) -> String {
    let figures = |run: &Summary| {
        if let Some(live) = &run.pace.live {
            return Some([live.latency_ms.median, live.latency_ms.p95]);
        }
        let frame = run.pace.timing_ms.iter().find(|s| s.stage == "frame")?;
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
        f.and_then(|f| f.dropped).map_or_else(absent, percent),
        f.map_or_else(absent, |f| percent(f.tracked)),
    ];
    let told = own_errors(case).map(|t| t.cells.unwrap_or_else(|| [absent(), absent()]));
    cells.extend(told.concat());
    cells.push(milliseconds(case));
    cells
}

fn percent(share: Spread) -> String {
    format!("{:.1} / {:.1}", share.median * 100.0, share.worst * 100.0)
}

fn state(row: &Row, case: Option<&Case>) -> &'static str {
    match (row.state, case.map(|c| c.cell.figures.as_ref())) {
        (State::NotFound, _) => "not found",
        (State::NotRun, None) => "not run",
        (_, None | Some(None)) => "failed",
        (_, Some(Some(f))) if f.tracked.worst < 1.0 => "lost frames",
        (_, Some(Some(f))) if f.dropped.is_some_and(|d| d.worst > 0.0) => "dropped frames",
        (_, Some(Some(f))) if f.ate.is_none() && f.drift.is_none() => "no score",
        _ => "ran",
    }
}

/// Remarks that do not fit into the table.
fn notes(row: &Row) -> Vec<String> {
    let mut notes = Vec::new();
    for case in &row.cases {
        let label = match case.label().as_str() {
            "" => row.name.to_owned(),
            label => format!("{}, {label}", row.name),
        };
        let mut add = |text: &str| notes.push(format!("- {label}: {text}\n"));
        if let Some(e) = &case.cell.error {
            // A line break would end the list.
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
