//! Trajectories: top view, coordinates and errors over time.

use super::axes::{Axes, LABEL, range};
use super::canvas::{Anchor, Figure};
use super::colour::{REFERENCE, SERIES, map};
use super::legend::{Mark, colour_bar, legend, ring};
use crate::ate::{Ate, PairError};
use crate::{Statistics, TimedPose};
use stillpoint_geometry::{Alignment, Se3, Vec3};

/// Size of a title, px.
pub(super) const TITLE: f64 = 18.0;
pub(super) const NAMES: [&str; 3] = ["x", "y", "z"];

/// Millimetres, or metres when errors are that large: unit and factor.
pub(super) fn error_unit(max: f64) -> (&'static str, f64) {
    if max < 2.0 { ("mm", 1e3) } else { ("m", 1.0) }
}

/// Runs of pairs without a gap in time: within them, lines are drawn.
pub(super) fn runs(pairs: &[PairError]) -> Vec<&[PairError]> {
    let mut steps: Vec<f64> = pairs.windows(2).map(|w| w[1].stamp - w[0].stamp).collect();
    steps.sort_unstable_by(f64::total_cmp);
    let gap = 3.5 * steps.get(steps.len() / 2).copied().unwrap_or_default();
    pairs.chunk_by(|a, b| b.stamp - a.stamp <= gap).collect()
}

/// The two axes along which the ground truth extends most (the estimate, when the ground truth stands still), in their
/// order.
pub(super) fn widest_axes(pairs: &[PairError]) -> (usize, usize) {
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
    let first = estimate.first().copied();
    let ate = unaligned(estimate, |p| first.as_ref().unwrap_or(p));
    draw(title, &ate, "fixed camera, not aligned: drift RMS")
}

/// An estimate without ground truth: top view coloured by time, and x, y and z over time.
#[must_use]
pub fn poses_figure(title: &str, estimate: &[TimedPose]) -> Figure {
    let trail = unaligned(estimate, |p| p);
    let mut figure = Figure::new(1200.0, 600.0);
    figure.title([30.0, 34.0], title, TITLE, Anchor::Start);
    let (start, [_, end]) = times(&trail);
    let length: f64 = runs(&trail.pairs)
        .iter()
        .flat_map(|run| run.windows(2))
        .map(|w| (w[1].estimate - w[0].estimate).norm())
        .sum();
    let summary = format!("{} poses, {length:.2} m, no ground truth", estimate.len());
    figure.text([1170.0, 33.0], &summary, LABEL, Anchor::End);
    let seconds = |p: &PairError| p.stamp - start;
    top_view(&mut figure, &trail, (false, &seconds, end, "time (s)"));
    positions(&mut figure, &trail, false);
    figure
}

/// Pairs of an estimate with a pose that stands for its ground truth, as they are.
fn unaligned<'a>(estimate: &'a [TimedPose], truth: impl Fn(&'a TimedPose) -> &'a TimedPose) -> Ate {
    let at = |p: &TimedPose| p.world_from_camera.translation;
    let pairs: Vec<PairError> = estimate
        .iter()
        .map(|p| PairError {
            stamp: p.stamp,
            reference: at(truth(p)),
            estimate: at(p),
            error: (at(p) - at(truth(p))).norm(),
        })
        .collect();
    let errors: Vec<f64> = pairs.iter().map(|p| p.error).collect();
    Ate {
        statistics: Statistics::of(&errors).unwrap_or_default(),
        alignment: Alignment {
            target_from_source: Se3::identity(),
            scale: 1.0,
        },
        pairs,
    }
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
    let error = |p: &PairError| p.error * factor;
    let label = format!("error ({unit})");
    top_view(&mut figure, ate, (true, &error, s.max * factor, &label));
    positions(&mut figure, ate, true);
    errors(&mut figure, ate);
    figure
}

/// What the colours of a top view show: whether there is ground truth, the value of a pose, the value at the end of the
/// scale, and its label.
type Shade<'a> = (bool, &'a dyn Fn(&PairError) -> f64, f64, &'a str);

fn top_view(figure: &mut Figure, ate: &Ate, (with_truth, value, full, label): Shade<'_>) {
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
    let mut marks = vec![(Mark::Line(map(0.35)), "estimate"), (Mark::Ring, "start")];
    if with_truth {
        marks.insert(0, (Mark::Line(REFERENCE), "ground truth"));
        for run in &runs {
            let points = run.iter().map(|p| place(&p.reference)).collect();
            figure.line(points, REFERENCE, 1.6);
        }
    }
    for w in runs.iter().flat_map(|run| run.windows(2)) {
        let share = 0.5 * (value(&w[0]) + value(&w[1])) / full.max(f64::MIN_POSITIVE);
        figure.line(
            vec![place(&w[0].estimate), place(&w[1].estimate)],
            map(share),
            2.6,
        );
    }
    if let Some(first) = ate.pairs.first() {
        ring(figure, place(&first.estimate));
    }
    legend(figure, [535.0, 85.0], &marks);
    colour_bar(figure, [553.0, 85.0, 15.0, 450.0], full, label);
}

fn times(ate: &Ate) -> (f64, [f64; 2]) {
    let start = ate.pairs.first().map_or(0.0, |p| p.stamp);
    (
        start,
        range(ate.pairs.iter().map(|p| p.stamp - start), 0.01),
    )
}

fn positions(figure: &mut Figure, ate: &Ate, with_truth: bool) {
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
            if with_truth {
                figure.line(points(|p| p.reference), REFERENCE, 2.6);
            }
            figure.line(points(|p| p.estimate), SERIES[0], 1.3);
        }
    }
    if with_truth {
        let marks = [
            (Mark::Line(REFERENCE), "ground truth"),
            (Mark::Line(SERIES[0]), "estimate"),
        ];
        legend(figure, [1170.0, 85.0], &marks);
    }
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
