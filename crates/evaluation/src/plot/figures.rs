//! The figures: a trajectory with its error, and times per frame.

use super::axes::{Axes, LABEL, SMALL, range, ticks};
use super::canvas::{Anchor, Figure};
use super::colour::{Colour, FRAME, INK, REFERENCE, SERIES, WHITE, map};
use crate::ate::{Ate, PairError};
use crate::timing::Stats;
use crate::{Statistics, TimedPose};
use stillpoint_geometry::{Alignment, Se3, Vec3};

/// Size of a title, px.
const TITLE: f64 = 18.0;
const NAMES: [&str; 3] = ["x", "y", "z"];

/// Millimetres, or metres when errors are that large: unit and factor.
fn error_unit(max: f64) -> (&'static str, f64) {
    if max < 2.0 { ("mm", 1e3) } else { ("m", 1.0) }
}

/// Runs of pairs without a gap in time: within them, lines are drawn.
fn runs(pairs: &[PairError]) -> Vec<&[PairError]> {
    let mut steps: Vec<f64> = pairs.windows(2).map(|w| w[1].stamp - w[0].stamp).collect();
    steps.sort_unstable_by(f64::total_cmp);
    let gap = 3.5 * steps.get(steps.len() / 2).copied().unwrap_or_default();
    pairs.chunk_by(|a, b| b.stamp - a.stamp <= gap).collect()
}

/// The two axes along which the ground truth extends most (the estimate, when the ground truth stands still), in their
/// order.
fn widest_axes(pairs: &[PairError]) -> (usize, usize) {
    let extents = |f: fn(&PairError) -> Vec3| {
        [0, 1, 2].map(|axis| {
            let values = || pairs.iter().map(|p| f(p)[axis]);
            let low = values().fold(f64::INFINITY, f64::min);
            values().fold(f64::NEG_INFINITY, f64::max) - low
        })
    };
    let mut extents_of = extents(|p| p.reference);
    if extents_of.iter().all(|e| *e <= 0.0) {
        extents_of = extents(|p| p.estimate);
    }
    let least = (0..3)
        .rev()
        .min_by(|a, b| extents_of[*a].total_cmp(&extents_of[*b]))
        .unwrap_or(2);
    match least {
        0 => (1, 2),
        1 => (0, 2),
        _ => (0, 1),
    }
}

/// Top view coloured by error, x, y and z over time, and the error over time.
///
/// The top view shows the two axes along which the ground truth extends most, at the same scale. Lines break at gaps.
#[must_use]
pub fn trajectory_figure(title: &str, ate: &Ate) -> Figure {
    draw(title, ate, "ATE RMSE")
}

/// The same for an estimate of a camera that stands still: nothing is aligned, and the error is the distance from the
/// first pose.
#[must_use]
pub fn drift_figure(title: &str, estimate: &[TimedPose]) -> Figure {
    let at = |p: &TimedPose| p.world_from_camera.translation;
    let pairs: Vec<PairError> = estimate
        .iter()
        .map(|p| PairError {
            stamp: p.stamp,
            reference: at(&estimate[0]),
            estimate: at(p),
            error: (at(p) - at(&estimate[0])).norm(),
        })
        .collect();
    let errors: Vec<f64> = pairs.iter().map(|p| p.error).collect();
    let ate = Ate {
        statistics: Statistics::of(&errors).unwrap_or_default(),
        alignment: Alignment {
            target_from_source: Se3::identity(),
            scale: 1.0,
        },
        pairs,
    };
    draw(title, &ate, "fixed camera, not aligned: drift RMS")
}

fn draw(title: &str, ate: &Ate, measure: &str) -> Figure {
    let mut figure = Figure::new(1200.0, 855.0);
    let s = &ate.statistics;
    let (unit, factor) = error_unit(s.max);
    figure.title([30.0, 34.0], title, TITLE, Anchor::Start);
    let decimals = if unit == "mm" { 1 } else { 3 };
    let show = |v: f64| format!("{:.decimals$}", v * factor);
    let summary = format!(
        "{measure} {} {unit}, median {}, max {}, {} pairs",
        show(s.rmse),
        show(s.median),
        show(s.max),
        s.count
    );
    figure.text([1170.0, 33.0], &summary, LABEL, Anchor::End);
    top_view(&mut figure, ate);
    positions(&mut figure, ate);
    errors(&mut figure, ate);
    figure
}

fn top_view(figure: &mut Figure, ate: &Ate) {
    let (i, j) = widest_axes(&ate.pairs);
    let both = |axis: usize| {
        ate.pairs
            .iter()
            .flat_map(move |p| [p.reference[axis], p.estimate[axis]])
    };
    let axes = Axes {
        area: [85.0, 85.0, 450.0, 450.0],
        x: range(both(i), 0.06),
        y: range(both(j), 0.06),
    }
    .with_equal_scale();
    axes.draw(
        figure,
        &format!("{} (m)", NAMES[i]),
        &format!("{} (m)", NAMES[j]),
    );
    let place = |p: &Vec3| axes.at(p[i], p[j]);
    let runs = runs(&ate.pairs);
    for run in &runs {
        let points = run.iter().map(|p| place(&p.reference)).collect();
        figure.line(points, REFERENCE, 1.6);
    }
    let max = ate.statistics.max.max(f64::MIN_POSITIVE);
    for run in &runs {
        for w in run.windows(2) {
            let share = 0.5 * (w[0].error + w[1].error) / max;
            figure.line(
                vec![place(&w[0].estimate), place(&w[1].estimate)],
                map(share),
                2.6,
            );
        }
    }
    if let Some(first) = ate.pairs.first() {
        ring(figure, place(&first.estimate));
    }
    let marks = [
        (Mark::Line(REFERENCE), "ground truth"),
        (Mark::Line(map(0.35)), "estimate"),
        (Mark::Ring, "start"),
    ];
    legend(figure, [535.0, 85.0], &marks);
    colour_bar(figure, [553.0, 85.0, 15.0, 450.0], ate.statistics.max);
}

/// How a legend shows an entry.
#[derive(Clone, Copy)]
enum Mark {
    Line(Colour),
    Dashed(Colour),
    Ring,
}

/// Names with their marks in a row that ends at the right at `x`, above an area that begins at `y`.
fn legend(figure: &mut Figure, [x, y]: [f64; 2], entries: &[(Mark, &str)]) {
    const MARK: f64 = 26.0;
    let width = |name: &str| MARK + 7.0 + super::font::width(name, SMALL) + 20.0;
    let mut left = x - entries.iter().map(|e| width(e.1)).sum::<f64>() + 20.0;
    let row = y - 12.0;
    for (mark, name) in entries {
        let line = vec![[left, row], [left + MARK, row]];
        match mark {
            Mark::Line(colour) => figure.line(line, *colour, 2.4),
            Mark::Dashed(colour) => figure.dashed(line, *colour, 1.6),
            Mark::Ring => ring(figure, [left + 0.5 * MARK, row]),
        }
        figure.text([left + MARK + 7.0, row + 4.3], name, SMALL, Anchor::Start);
        left += width(name);
    }
}

fn ring(figure: &mut Figure, centre: [f64; 2]) {
    figure.circle(centre, 5.5, INK);
    figure.circle(centre, 3.5, WHITE);
}

fn colour_bar(figure: &mut Figure, [x, y, w, h]: [f64; 4], max: f64) {
    const STEPS: usize = 90;
    let (unit, factor) = error_unit(max);
    for k in 0..STEPS {
        let share = (k as f64 + 0.5) / STEPS as f64;
        let top = y + h * (1.0 - (k + 1) as f64 / STEPS as f64);
        // Half a pixel of overlap hides the seams.
        let height = h / STEPS as f64 + if k == 0 { 0.0 } else { 0.5 };
        figure.rect([x, top, w, height], map(share));
    }
    let corners = [[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]];
    figure.line(corners.to_vec(), FRAME, 1.0);
    let full = max * factor;
    if full <= 0.0 {
        return figure.text([x + w + 5.0, y + h + 4.0], "0", SMALL, Anchor::Start);
    }
    let (values, decimals) = ticks([0.0, full], 7.0);
    let mut longest = 0.0f64;
    for v in values {
        let py = y + h * (1.0 - v / full);
        let text = format!("{v:.decimals$}");
        figure.line(vec![[x + w, py], [x + w + 4.0, py]], FRAME, 1.0);
        figure.text([x + w + 7.0, py + 4.3], &text, SMALL, Anchor::Start);
        longest = longest.max(super::font::width(&text, SMALL));
    }
    figure.text_upwards(
        [x + w + longest + 26.0, y + 0.5 * h],
        &format!("error ({unit})"),
        LABEL,
    );
}

fn times(ate: &Ate) -> (f64, [f64; 2]) {
    let start = ate.pairs.first().map_or(0.0, |p| p.stamp);
    (
        start,
        range(ate.pairs.iter().map(|p| p.stamp - start), 0.01),
    )
}

fn positions(figure: &mut Figure, ate: &Ate) {
    let (start, x) = times(ate);
    for (axis, name) in NAMES.iter().enumerate() {
        let values = ate
            .pairs
            .iter()
            .flat_map(|p| [p.reference[axis], p.estimate[axis]]);
        let axes = Axes {
            area: [715.0, 85.0 + 155.0 * axis as f64, 455.0, 140.0],
            x,
            y: range(values, 0.08),
        };
        let label = if axis == 2 { "time (s)" } else { "" };
        axes.draw(figure, label, &format!("{name} (m)"));
        for run in runs(&ate.pairs) {
            let points = |f: fn(&PairError) -> Vec3| {
                run.iter()
                    .map(|p| axes.at(p.stamp - start, f(p)[axis]))
                    .collect::<Vec<_>>()
            };
            figure.line(points(|p| p.reference), REFERENCE, 2.6);
            figure.line(points(|p| p.estimate), SERIES[0], 1.3);
        }
    }
    let marks = [
        (Mark::Line(REFERENCE), "ground truth"),
        (Mark::Line(SERIES[0]), "estimate"),
    ];
    legend(figure, [1170.0, 85.0], &marks);
}

fn errors(figure: &mut Figure, ate: &Ate) {
    let (start, x) = times(ate);
    let (unit, factor) = error_unit(ate.statistics.max);
    let top = (ate.statistics.max * factor * 1.1).max(1e-6);
    let axes = Axes {
        area: [85.0, 625.0, 1085.0, 180.0],
        x,
        y: [0.0, top],
    };
    axes.draw(figure, "time (s)", &format!("error ({unit})"));
    for run in runs(&ate.pairs) {
        let points = run
            .iter()
            .map(|p| axes.at(p.stamp - start, p.error * factor))
            .collect();
        figure.line(points, SERIES[0], 1.5);
    }
    let rmse = ate.statistics.rmse * factor;
    figure.dashed(
        vec![axes.at(x[0], rmse), axes.at(x[1], rmse)],
        SERIES[1],
        1.6,
    );
    let marks = [
        (Mark::Line(SERIES[0]), "error"),
        (Mark::Dashed(SERIES[1]), "RMSE"),
    ];
    legend(figure, [1170.0, 625.0], &marks);
}

/// A name and one value per frame, ms.
#[derive(Clone, Debug, PartialEq)]
pub struct Series<'a> {
    /// What was timed.
    pub name: &'a str,
    /// Milliseconds, one per frame; `NAN` where there is none.
    pub milliseconds: &'a [f64],
}

/// Times per frame: one line per series, its median and 99th percentile in the legend, and the time of a frame at 30 Hz
/// where that is within sight.
#[must_use]
pub fn timing_figure(title: &str, series: &[Series<'_>]) -> Figure {
    const FRAME_MS: f64 = 1000.0 / 30.0;
    /// More entries do not fit into one row.
    const PER_ROW: usize = 3;
    let finite = || {
        let all = series.iter().flat_map(|s| s.milliseconds.iter().copied());
        all.filter(|v| v.is_finite())
    };
    let mut top = finite().fold(1e-3, f64::max);
    let frame_in_sight = top > 0.6 * FRAME_MS;
    let names: Vec<String> = series.iter().map(series_name).collect();
    let colours = SERIES.into_iter().cycle();
    let mut entries: Vec<(Mark, &str)> = colours
        .zip(&names)
        .map(|(c, n)| (Mark::Line(c), n.as_str()))
        .collect();
    if frame_in_sight {
        top = top.max(FRAME_MS);
        entries.push((Mark::Dashed(FRAME), "one frame at 30 Hz (33.3 ms)"));
    }
    let rows: Vec<_> = entries.chunks(PER_ROW).collect();
    let area_top = 62.0 + 20.0 * rows.len() as f64;
    let mut figure = Figure::new(1200.0, area_top + 420.0);
    figure.title([30.0, 34.0], title, TITLE, Anchor::Start);
    let frames = series.iter().map(|s| s.milliseconds.len()).max();
    let axes = Axes {
        area: [85.0, area_top, 1085.0, 360.0],
        x: [0.0, frames.unwrap_or(0).saturating_sub(1).max(1) as f64],
        y: [0.0, top * 1.06],
    };
    axes.draw(&mut figure, "frame", "time (ms)");
    for (row, entries) in rows.iter().rev().enumerate() {
        legend(&mut figure, [1170.0, area_top - 20.0 * row as f64], entries);
    }
    for (s, colour) in series.iter().zip(SERIES.into_iter().cycle()) {
        let indexed: Vec<(usize, f64)> = s.milliseconds.iter().copied().enumerate().collect();
        for run in indexed.chunk_by(|a, b| a.1.is_finite() == b.1.is_finite()) {
            if run[0].1.is_finite() {
                let points = run.iter().map(|(i, v)| axes.at(*i as f64, *v)).collect();
                figure.line(points, colour, 1.3);
            }
        }
    }
    if frame_in_sight {
        let ends = vec![axes.at(axes.x[0], FRAME_MS), axes.at(axes.x[1], FRAME_MS)];
        figure.dashed(ends, FRAME, 1.3);
    }
    figure
}

fn series_name(series: &Series<'_>) -> String {
    let t = Stats::of(series.milliseconds);
    format!(
        "{}: median {:.1}, p99 {:.1} ms",
        series.name, t.median, t.p99
    )
}
