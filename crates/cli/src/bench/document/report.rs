//! The document as Markdown.

use crate::bench::ablation::{Cell, Variant, report::overview};
use crate::bench::document::{Document, MATTERS, Measured, peers, unit};
use crate::bench::figures::{Errors, Figures};
use crate::bench::runner::median;
use crate::bench::suite::published::{ABLATION_TABLE, System, sources};
use crate::run::summary::{StageTiming, Summary};
use stillpoint::evaluation::{Align, Table};

/// What OpenCV's ORB takes, in units of this project, where the user does not measure it: 3.6 ms against 1.10 ms on a two-core AMD EPYC.
const OPENCV_UNITS: f64 = 3.3;
/// What the table of times shows: the span's name, and what it is.
const STAGES: [(&str, &str); 7] = [
    ("extract", "extract"),
    ("flow", "flow"),
    ("filter", "filter"),
    ("match", "match"),
    ("pose", "pose"),
    ("detect", "network"),
    ("map", "per keyframe"),
];

pub(crate) fn markdown(document: &Document) -> String {
    let parts = [
        head(document),
        accuracy(&document.sequences),
        ablation(&document.sequences, &document.seeds),
        times(document),
        live(document),
        comparison(document),
        OTHERS.to_owned(),
        remarks(&document.sequences),
    ];
    let parts: Vec<String> = parts.into_iter().filter(|p| !p.is_empty()).collect();
    parts.join("\n")
}

/// How the figures came about.
fn head(d: &Document) -> String {
    let seeds: Vec<String> = d.seeds.iter().map(u64::to_string).collect();
    let seeds = seeds.join(", ");
    let m = &d.machine;
    let [before, after] = d.unit_ms;
    format!(
        "# Benchmarks\n\n\
         This file is made by a command and not edited by hand:\n\n```\n{}\n```\n\n\
         | | |\n|---|---|\n\
         | commit | {} |\n| date | {} |\n| machine | {}, {} cores, {} |\n| compiler | {}{} |\n| detector of the recordings | {} |\n\
         | unit of time | {before:.2} ms before the runs, {after:.2} ms after them |\n\n\
         Unless a table says live, frames go through tracking and mapping one after the other, nothing is dropped, and a detector's answer is there \
         at once; errors are then the same on every run with the same seed, and tables show medians over the seeds ({seeds}). The unit of time is {}. Times in units can be compared between machines; so can {}.\n",
        d.command,
        d.origin.commit,
        d.origin.date,
        m.cpu,
        m.cores,
        m.system,
        m.rustc,
        if cfg!(debug_assertions) {
            ", with debug assertions: times mean little, `cargo build --release` is what counts"
        } else {
            ""
        },
        d.detector,
        unit::WHAT,
        opencv(d)
    )
}

/// How the unit of the peers' times relates to ours.
fn opencv(d: &Document) -> String {
    let unit = unit_ms(d);
    match d.opencv_ms {
        Some(ms) => format!(
            "times in OpenCV units, which are those of the peers below: OpenCV's ORB (1000 features, one thread) took {ms:.2} ms on this machine at \
             this time, {:.1} of our units",
            ms / unit
        ),
        None => format!(
            "times in OpenCV units, which are those of the peers below, but less exactly: that OpenCV's ORB takes {OPENCV_UNITS:.1} of our units \
             was measured on another machine"
        ),
    }
}

/// Our unit during the runs, ms.
fn unit_ms(d: &Document) -> f64 {
    0.5 * (d.unit_ms[0] + d.unit_ms[1])
}

/// OpenCV's ORB during the runs, ms.
fn opencv_ms(d: &Document) -> f64 {
    d.opencv_ms.unwrap_or(OPENCV_UNITS * unit_ms(d))
}

fn absent() -> String {
    "-".to_owned()
}

/// An error with the share of frames that have a pose, where some have none.
fn error(cell: Option<&Cell>, of: fn(&Figures) -> Option<String>) -> String {
    let Some(cell) = cell else {
        return absent();
    };
    let Some(f) = &cell.figures else {
        return "failed".to_owned();
    };
    let text = of(f).unwrap_or_else(absent);
    let poses = (f.tracked.median * f.frames as f64).round();
    if f.tracked.median < 1.0 {
        format!("{text} ({poses:.0} of {})", f.frames)
    } else {
        text
    }
}

fn mm(e: Option<Errors>) -> Option<String> {
    Some(format!("{:.1}", e?.rmse.median * 1e3))
}

fn accuracy(sequences: &[Measured]) -> String {
    let mut table = Table::new([
        "sequence",
        "frames",
        "ATE: filter off",
        "no detector",
        "detector",
        "RPE: filter off",
        "no detector",
        "detector",
    ]);
    for s in sequences {
        let cells = s.cells();
        let first = cells.iter().flatten().find_map(|c| c.figures.as_ref());
        let fixed = first.is_some_and(|f| f.drift.is_some());
        let mark = if fixed { " (drift)" } else { "" };
        let mut row = vec![
            format!("{}{mark}", s.row.name),
            first.map_or_else(absent, |f| f.frames.to_string()),
        ];
        row.extend(cells.map(|c| error(c, |f| mm(f.ate.or(f.drift)))));
        row.extend(cells.map(|c| {
            error(c, |f| {
                let (mm, deg) = (f.rpe_translation?, f.rpe_rotation_deg?);
                Some(format!(
                    "{:.1} / {:.2}",
                    mm.rmse.median * 1e3,
                    deg.rmse.median
                ))
            })
        }));
        table.row(row);
    }
    let mut text = format!(
        "## Accuracy\n\nRMSE of the final poses. ATE in mm after alignment by a rigid motion (the drift where the camera is fixed), RPE over 1 s \
         in mm / degrees. In brackets the frames with a pose, where some have none. \"Filter off\" and \"no detector\" see no detections.\n\n{}",
        table.to_markdown()
    );
    text.push('\n');
    for (detector, names) in detectors(sequences) {
        text += &format!("- {detector}: {}\n", names.join(", "));
    }
    text
}

/// Each detector in words, with the sequences that it looked at.
fn detectors(sequences: &[Measured]) -> Vec<(String, Vec<&str>)> {
    let mut all: Vec<(String, Vec<&str>)> = Vec::new();
    for s in sequences {
        let cell = s.variant(Variant::Default);
        let network = cell.and_then(|c| c.runs.first()?.stages.detector.network());
        let network = network.map_or_else(String::new, |n| format!(" ({n})"));
        let detector = format!("Detector {}{network}", s.row.detector);
        match all.iter_mut().find(|(known, _)| *known == detector) {
            Some((_, names)) => names.push(&s.row.name),
            None => all.push((detector, vec![&s.row.name])),
        }
    }
    all
}

/// How many seeds, and what two figures in a cell are.
fn spread(seeds: &[u64]) -> String {
    match seeds {
        [one] => format!("Of one seed ({one})."),
        seeds => format!(
            "Of {} seeds: median and, after the stroke, the worst where they differ.",
            seeds.len()
        ),
    }
}

fn ablation(sequences: &[Measured], seeds: &[u64]) -> String {
    let whole = |s: &&Measured| s.variant(Variant::O).is_some();
    let rows: Vec<_> = sequences.iter().filter(whole).map(|s| &s.row).collect();
    if rows.is_empty() {
        return String::new();
    }
    let mut text = format!(
        "## Ablation of the static filter\n\nATE RMSE in mm, in brackets the share of frames with a pose where some have none. O: objects. G: epipolar \
         constraint. D: depth within boxes. The first five are the published method with that much of it, \"adapted\" is all of it with the weights of all classes and \
         without a split of boxes of one depth, the last is this project's own filter; all but \"none\" see the detections. {seeds} Recordings are in the table where the filter changes the error by a factor of more than {MATTERS:.0}, or the frames \
         that have a pose. Simulated scenes are named after the recordings that the published figures are about: other rooms, other people, and simulated \
         images, so only the pattern can be compared.\n\n{}\n",
        overview(rows.iter().copied()),
        seeds = spread(seeds),
    );
    if rows.iter().any(|r| r.published.is_some()) {
        text += &sources(&[System::Paper], ABLATION_TABLE);
    }
    text
}

fn stage<'a>(run: &'a Summary, name: &str) -> Option<&'a StageTiming> {
    run.pace.timing_ms.iter().find(|s| s.stage == name)
}

fn times(d: &Document) -> String {
    let header = ["sequence", "detector", "frame, ms", "units", "OpenCV units"];
    let header = header.into_iter().chain(STAGES.map(|s| s.1));
    let mut table = Table::new(header.chain(["peak MB"])).align(1, Align::Left);
    for s in &d.sequences {
        let [off, alone, detected] = s.cells();
        for (cell, label) in [(off, "filter off"), (alone, "none"), (detected, "with")] {
            let Some(run) = cell.and_then(|c| c.runs.first()) else {
                continue;
            };
            let Some(frame) = stage(run, "frame") else {
                continue;
            };
            let mut row = vec![
                s.row.name.clone(),
                label.to_owned(),
                format!("{:.1} / {:.1} / {:.0}", frame.median, frame.p95, frame.max),
                format!("{:.1}", frame.median / unit_ms(d)),
                format!("{:.2}", frame.median / opencv_ms(d)),
            ];
            row.extend(STAGES.map(|(name, _)| {
                stage(run, name).map_or_else(absent, |s| format!("{:.1}", s.median))
            }));
            row.push(megabytes(run.pace.peak_memory_bytes));
            table.row(row);
        }
    }
    format!(
        "## Time and memory\n\n`frame` is tracking, grey image in and pose out, without reading the image and without the network: median / p95 / largest. \
         The columns after the units are medians of its parts, then of the network and of mapping, which takes place once per keyframe, in ms. Peak memory \
         is that of the whole program, images read ahead included.\n\n{}",
        table.to_markdown()
    )
}

fn megabytes(bytes: Option<u64>) -> String {
    bytes.map_or_else(absent, |b| format!("{:.0}", b as f64 * 1e-6))
}

fn live(d: &Document) -> String {
    let mut table = Table::new([
        "sequence",
        "runs",
        "dropped %",
        "latency ms: median",
        "p95",
        "p99",
        "OpenCV units: median",
        "p99",
        "detections/s",
        "their age, ms",
        "ATE, mm",
        "peak MB",
    ]);
    let mut any = false;
    for s in &d.sequences {
        let runs: Vec<_> = s
            .live
            .iter()
            .filter_map(|r| Some((r, r.pace.live.as_ref()?)))
            .collect();
        if runs.is_empty() {
            continue;
        }
        any = true;
        let of = |value: &dyn Fn(&(&Summary, &crate::run::live_report::LiveJson)) -> f64| {
            let values: Vec<f64> = runs.iter().map(value).collect();
            let worst = values.iter().copied().fold(f64::NAN, f64::max);
            (median(values), worst)
        };
        let both = |(median, worst): (f64, f64), digits: usize| {
            format!("{median:.digits$} ({worst:.digits$})")
        };
        let one = |(median, _): (f64, f64)| format!("{median:.1}");
        let latency = of(&|(_, l)| l.latency_ms.median);
        let p99 = of(&|(_, l)| l.latency_ms.p99);
        let ate = of(&|(r, _)| final_error(r).map_or(f64::NAN, |e| e * 1e3));
        table.row([
            s.row.name.clone(),
            runs.len().to_string(),
            both(of(&|(_, l)| l.dropped_share * 100.0), 1),
            one(latency),
            one(of(&|(_, l)| l.latency_ms.p95)),
            both(p99, 1),
            format!("{:.1}", latency.0 / opencv_ms(d)),
            format!("{:.1}", p99.0 / opencv_ms(d)),
            one(of(&|(_, l)| l.detections_per_second)),
            format!("{:.0}", of(&|(_, l)| l.detections_age_ms.mean).0),
            both(ate, 1),
            format!(
                "{:.0}",
                of(&|(r, _)| r.pace.peak_memory_bytes.unwrap_or(0) as f64 * 1e-6).0
            ),
        ]);
    }
    if !any {
        return String::new();
    }
    format!(
        "## Live\n\nThe recording is played as a camera, at its own rate, with a thread per stage and the detector of the tables above. Latency is from a \
         frame's arrival to its pose. Medians of the runs, in brackets the worst one: live runs differ.\n\n{}",
        table.to_markdown()
    )
}

/// ATE RMSE, or the drift's, of the final poses, m.
fn final_error(run: &Summary) -> Option<f64> {
    use crate::run::summary::ScoreJson;
    Some(match &run.accuracy.as_ref()?.final_poses {
        ScoreJson::Moving(m) => m.ate.rmse,
        ScoreJson::Fixed(f) => f.drift.rmse,
    })
}

fn comparison(d: &Document) -> String {
    let names: Vec<&str> = d.sequences.iter().map(|s| s.row.name.as_str()).collect();
    let table = peers::markdown(&names);
    if table.is_empty() {
        return table;
    }
    format!(
        "## Other systems on the same recordings\n\n{table}\n\
         Beside these stand the columns \"OpenCV units\" above: of `frame` for the time of the tracking call, of live runs for what a user waits.\n"
    )
}

const OTHERS: &str = "## Other measurements\n\n\
    | what | command |\n|---|---|\n\
    | public data sets beside published figures | `stillpoint bench --suite tum-dynamic DIR`, `--suite bonn` |\n\
    | an ablation with several seeds | `stillpoint bench --ablation PATH... --runs 5` |\n\
    | kernels: pyramid, FAST, descriptors, flow, solvers, decoding, rendering, places, map files | `cargo bench -p stillpoint-features`, also `-imaging`, `-estimation`, `-datasets`, `-simulator`, `-place`, `-map` |\n\
    | loop closing: error without and with it, true and false loops | `cargo run --release --manifest-path lab/Cargo.toml -- loops scene SCENE --first-seed N --seeds N` |\n\
    | closing one loop in a large map | `cargo run --release --manifest-path lab/Cargo.toml -- closing KEYFRAMES FEATURES` |\n\
    | hours of the same two rooms | `cargo run --release --manifest-path lab/Cargo.toml -- soak --minutes N --rate HZ --max-keyframes N` |\n";

/// What went wrong.
fn remarks(sequences: &[Measured]) -> String {
    let mut text = String::new();
    let mut add = |name: &str, what: &str| {
        // A message of several lines would end the list.
        let what: Vec<&str> = what.split_whitespace().collect();
        text += &format!("- {name}: {}\n", what.join(" "));
    };
    for s in sequences {
        if let Some(e) = &s.row.error {
            add(&s.row.name, e);
        }
        for cell in s.row.variants.iter().chain(&s.alone) {
            if let Some(e) = &cell.error {
                add(&s.row.name, &format!("{}: {e}", cell.variant));
            }
        }
    }
    if text.is_empty() {
        text
    } else {
        format!("## What failed\n\n{text}")
    }
}
