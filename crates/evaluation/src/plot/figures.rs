//! The figures: a trajectory with its error, and times per frame.

use super::axes::{Axes, LABEL, SMALL, range, ticks};
use super::canvas::{Anchor, Figure};
use super::colour::{Colour, FRAME, INK, REFERENCE, SERIES, WHITE, map};
use crate::ate::{Ate, PairError};
use crate::timing::Stats;
use stillpoint_geometry::Vec3;

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

/// The two axes along which the ground truth extends most, in their order.
fn widest_axes(pairs: &[PairError]) -> (usize, usize) {
    let extent = |axis: usize| {
        let [lo, hi] = range(pairs.iter().map(|p| p.reference[axis]), 0.0);
        hi - lo
    };
    let least = (0..3)
        .rev()
        .min_by(|a, b| extent(*a).total_cmp(&extent(*b)))
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
    let mut figure = Figure::new(1200.0, 830.0);
    let s = &ate.statistics;
    let (unit, factor) = error_unit(s.max);
    figure.title([30.0, 34.0], title, TITLE, Anchor::Start);
    let decimals = if unit == "mm" { 1 } else { 3 };
    let show = |v: f64| format!("{:.decimals$}", v * factor);
    figure.text(
        [1170.0, 33.0],
        &format!(
            "ATE RMSE {} {unit}, median {}, max {}, {} pairs",
            show(s.rmse),
            show(s.median),
            show(s.max),
            s.count
        ),
        LABEL,
        Anchor::End,
    );
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
        area: [85.0, 60.0, 450.0, 450.0],
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
        figure.circle(place(&first.estimate), 5.5, INK);
        figure.circle(place(&first.estimate), 3.5, WHITE);
    }
    let mark = [(REFERENCE, "ground truth"), (map(0.35), "estimate")];
    legend(figure, [95.0, 68.0], &mark, Some("start"));
    colour_bar(figure, [553.0, 60.0, 15.0, 450.0], ate.statistics.max);
}

/// Lines with names, and a ring with one, on a white box at its top left corner.
fn legend(figure: &mut Figure, [x, y]: [f64; 2], entries: &[(Colour, &str)], ring: Option<&str>) {
    let rows = entries.len() + usize::from(ring.is_some());
    let names = entries.iter().map(|e| e.1).chain(ring);
    let longest = names
        .map(|n| super::font::width(n, SMALL))
        .fold(0.0, f64::max);
    figure.rect([x, y, longest + 62.0, 18.0 * rows as f64 + 8.0], WHITE);
    for (k, (colour, name)) in entries.iter().enumerate() {
        let row = y + 13.0 + 18.0 * k as f64;
        figure.line(vec![[x + 8.0, row], [x + 32.0, row]], *colour, 2.4);
        figure.text([x + 40.0, row + 4.3], name, SMALL, Anchor::Start);
    }
    if let Some(name) = ring {
        let row = y + 13.0 + 18.0 * entries.len() as f64;
        figure.circle([x + 20.0, row], 5.5, INK);
        figure.circle([x + 20.0, row], 3.5, WHITE);
        figure.text([x + 40.0, row + 4.3], name, SMALL, Anchor::Start);
    }
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
            area: [715.0, 60.0 + 155.0 * axis as f64, 455.0, 140.0],
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
    let mark = [(REFERENCE, "ground truth"), (SERIES[0], "estimate")];
    legend(figure, [1040.0, 64.0], &mark, None);
}

fn errors(figure: &mut Figure, ate: &Ate) {
    let (start, x) = times(ate);
    let (unit, factor) = error_unit(ate.statistics.max);
    let top = (ate.statistics.max * factor * 1.1).max(1e-6);
    let axes = Axes {
        area: [85.0, 590.0, 1085.0, 180.0],
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
    let mark = [(SERIES[0], "error"), (SERIES[1], "RMSE")];
    legend(figure, [1075.0, 594.0], &mark, None);
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
    let mut figure = Figure::new(1200.0, 480.0);
    figure.title([30.0, 34.0], title, TITLE, Anchor::Start);
    let values = || series.iter().flat_map(|s| s.milliseconds.iter().copied());
    let highest = values()
        .filter(|v| v.is_finite())
        .fold(0.0, f64::max)
        .max(1e-3);
    let frames = series
        .iter()
        .map(|s| s.milliseconds.len())
        .max()
        .unwrap_or(0);
    let top = if highest > 0.6 * FRAME_MS {
        highest.max(FRAME_MS)
    } else {
        highest
    };
    let names: Vec<String> = series
        .iter()
        .map(|s| {
            let t = Stats::of(s.milliseconds);
            format!("{}: median {:.1}, p99 {:.1} ms", s.name, t.median, t.p99)
        })
        .collect();
    // The legend stands above the data: the axis leaves room for its rows.
    let rows = (names.len() + 1) as f64;
    let axes = Axes {
        area: [85.0, 60.0, 1085.0, 360.0],
        x: [0.0, frames.saturating_sub(1).max(1) as f64],
        y: [0.0, top * 360.0 / (360.0 - (18.0 * rows + 14.0).min(180.0))],
    };
    axes.draw(&mut figure, "frame", "time (ms)");
    let mut entries = Vec::new();
    for ((s, name), colour) in series.iter().zip(&names).zip(SERIES.into_iter().cycle()) {
        let indexed: Vec<(usize, f64)> = s.milliseconds.iter().copied().enumerate().collect();
        for run in indexed.chunk_by(|a, b| a.1.is_finite() == b.1.is_finite()) {
            if run[0].1.is_finite() {
                let points = run.iter().map(|(i, v)| axes.at(*i as f64, *v)).collect();
                figure.line(points, colour, 1.3);
            }
        }
        entries.push((colour, name.as_str()));
    }
    if top >= FRAME_MS {
        let ends = vec![axes.at(axes.x[0], FRAME_MS), axes.at(axes.x[1], FRAME_MS)];
        figure.dashed(ends, FRAME, 1.3);
        entries.push((FRAME, "one frame at 30 Hz (33.3 ms)"));
    }
    legend(&mut figure, [95.0, 65.0], &entries, None);
    figure
}
