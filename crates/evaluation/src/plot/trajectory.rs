//! Trajectories: top view, coordinates and errors over time.

use super::axes::{Axes, LABEL, range};
use super::canvas::{Anchor, Figure};
use super::colour::{ESTIMATE, REFERENCE, map};
use super::legend::{Mark, colour_bar, legend, ring};
use super::panels::{
    HEIGHT, NAMES, Relative, Series, TRUTH_WIDTH, WIDTH, error_unit, height, over_time, position,
    positions_axes, relative_errors, runs, stamp, truth_from_above,
};
use crate::ate::{Ate, PairError};
use crate::{Rpe, Statistics, TimedPose};
use stillpoint_geometry::{Alignment, Se3, Vec3};

/// Size of a title, px.
pub(super) const TITLE: f64 = 18.0;

/// The two axes along which the ground truth (if at rest, the estimate) extends most, in their order.
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

/// Top view coloured by error, x, y and z over time, the error over time, and the relative errors, if any.
///
/// The top view shows the two axes along which the ground truth extends most, at equal scale; x, y and z share one scale. The ground truth
/// is a wide line, visible under the estimate. Lines break at gaps.
#[must_use]
pub fn trajectory_figure(title: &str, ate: &Ate, rpe: Option<&Rpe>) -> Figure {
    draw(title, (ate, rpe), "ATE RMSE")
}

/// Likewise for an estimate of a camera at rest: nothing is aligned, and the error is the distance from the first pose.
#[must_use]
pub fn drift_figure(title: &str, estimate: &[TimedPose]) -> Figure {
    let first = estimate.first().copied();
    let ate = unaligned(estimate, |p| first.as_ref().unwrap_or(p));
    draw(title, (&ate, None), "fixed camera, not aligned: drift RMS")
}

/// An estimate without ground truth: top view coloured by time, and x, y and z over time.
#[must_use]
pub fn poses_figure(title: &str, estimate: &[TimedPose]) -> Figure {
    let trail = unaligned(estimate, |p| p);
    let mut figure = Figure::new(1200.0, 600.0);
    figure.text([30.0, 34.0], title, TITLE, Anchor::Start);
    let (start, [_, end]) = times(&trail);
    let length: f64 = runs(&trail.pairs, stamp)
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

/// Pairs of an estimate with a pose as its ground truth, without alignment.
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

fn draw(title: &str, (ate, rpe): (&Ate, Option<&Rpe>), measure: &str) -> Figure {
    let rpe = rpe.filter(|rpe| !rpe.errors.is_empty());
    let relative: Vec<Relative<'_>> = rpe
        .map(|rpe| ("relative error", ESTIMATE, rpe))
        .into_iter()
        .collect();
    let mut figure = Figure::new(1200.0, height(&relative));
    let s = &ate.statistics;
    let (unit, factor) = error_unit(s.max);
    figure.text([30.0, 34.0], title, TITLE, Anchor::Start);
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
    relative_errors(&mut figure, times(ate), &relative);
    figure
}

/// Colours of a top view: whether there is ground truth, the value of a pose, the value at the end of the scale, and its label.
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
    let mut marks = vec![(Mark::Shaded, "estimate"), (Mark::Ring, "start")];
    if with_truth {
        marks.insert(0, (Mark::Wide(REFERENCE), "ground truth"));
        truth_from_above(figure, &ate.pairs, place);
    }
    let runs = runs(&ate.pairs, stamp);
    for w in runs.iter().flat_map(|run| run.windows(2)) {
        let share = 0.5 * (value(&w[0]) + value(&w[1])) / full.max(f64::MIN_POSITIVE);
        figure.line(
            vec![place(&w[0].estimate), place(&w[1].estimate)],
            map(share),
            2.2,
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
    let pairs = &ate.pairs;
    let values = |axis: usize| {
        let both = pairs
            .iter()
            .flat_map(|p| [p.reference[axis], p.estimate[axis]]);
        both.collect()
    };
    let panels = positions_axes(figure, x, values);
    for (axis, axes) in panels.iter().enumerate() {
        let place = (axes, axis, start);
        if with_truth {
            position(
                figure,
                place,
                (pairs, |p| p.reference),
                (REFERENCE, TRUTH_WIDTH),
            );
        }
        position(figure, place, (pairs, |p| p.estimate), (ESTIMATE, WIDTH));
    }
    if with_truth {
        let marks = [
            (Mark::Wide(REFERENCE), "ground truth"),
            (Mark::Line(ESTIMATE), "estimate"),
        ];
        legend(figure, [1170.0, 85.0], &marks);
    }
}

fn errors(figure: &mut Figure, ate: &Ate) {
    let (start, x) = times(ate);
    let (unit, factor) = error_unit(ate.statistics.max);
    let lines = runs(&ate.pairs, stamp).into_iter();
    let lines = lines.map(|run| {
        let points = run.iter().map(|p| [p.stamp - start, p.error * factor]);
        points.collect()
    });
    let series = Series {
        name: "error",
        colour: ESTIMATE,
        lines: lines.collect(),
        rmse: ate.statistics.rmse * factor,
    };
    let label = format!("error ({unit})");
    over_time(figure, (HEIGHT - 230.0, 180.0), (x, &label), &[series]);
}
