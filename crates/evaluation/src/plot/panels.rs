//! Shared panels of trajectory figures: three coordinates at one scale, and errors over time.

use super::axes::{Axes, range};
use super::canvas::Figure;
use super::colour::{Colour, REFERENCE, SERIES};
use super::legend::{Mark, legend};
use crate::Rpe;
use crate::ate::PairError;
use crate::rpe::{Delta, RelativeError};
use stillpoint_geometry::Vec3;

pub(super) const NAMES: [&str; 3] = ["x", "y", "z"];
/// Width of the truth's line, px, and of an estimate's, chosen: the truth shows by 1.7 px on both sides of an estimate that lies on it.
pub(super) const TRUTH_WIDTH: f64 = 5.0;
pub(super) const WIDTH: f64 = 1.6;
/// Height of a figure with a panel of errors, and the added height per panel of relative errors, px, chosen: ticks of a panel keep two
/// lines of text between them.
pub(super) const HEIGHT: f64 = 855.0;
const RELATIVE: f64 = 195.0;

/// Points of a line without a gap, each with its time, s.
type Timed = Vec<[f64; 2]>;

/// Millimetres, or metres for errors that large: unit and factor.
pub(super) fn error_unit(max: f64) -> (&'static str, f64) {
    if max < 2.0 { ("mm", 1e3) } else { ("m", 1.0) }
}

/// Parts of a series without a gap in time, drawn as lines.
pub(super) fn runs<T>(all: &[T], stamp: fn(&T) -> f64) -> Vec<&[T]> {
    let mut steps: Vec<f64> = all
        .windows(2)
        .map(|w| stamp(&w[1]) - stamp(&w[0]))
        .collect();
    steps.sort_unstable_by(f64::total_cmp);
    let gap = 3.5 * steps.get(steps.len() / 2).copied().unwrap_or_default();
    all.chunk_by(|a, b| stamp(b) - stamp(a) <= gap).collect()
}

pub(super) fn stamp(pair: &PairError) -> f64 {
    pair.stamp
}

/// Axes of x, y and z over the time `x`, under each other and at equal scale; only the last has a time label.
pub(super) fn positions_axes(
    figure: &mut Figure,
    x: [f64; 2],
    values: impl Fn(usize) -> Vec<f64>,
) -> [Axes; 3] {
    let ranges = [0, 1, 2].map(|axis| range(values(axis).into_iter(), 0.08));
    let widest = ranges.iter().map(|r| r[1] - r[0]).fold(0.0, f64::max);
    [0, 1, 2].map(|axis| {
        let middle = 0.5 * (ranges[axis][0] + ranges[axis][1]);
        let axes = Axes {
            area: [715.0, 85.0 + 163.0 * axis as f64, 455.0, 124.0],
            x,
            y: [middle - 0.5 * widest, middle + 0.5 * widest],
        };
        let label = if axis == 2 { "time (s)" } else { "" };
        axes.draw(figure, label, &format!("{} (m)", NAMES[axis]));
        axes
    })
}

/// Draws one coordinate of pairs over time.
pub(super) fn position(
    figure: &mut Figure,
    (axes, axis, start): (&Axes, usize, f64),
    (pairs, of): (&[PairError], fn(&PairError) -> Vec3),
    (colour, width): (Colour, f64),
) {
    for run in runs(pairs, stamp) {
        let at = |p: &PairError| axes.at(p.stamp - start, of(p)[axis]);
        figure.line(run.iter().map(at).collect(), colour, width);
    }
}

/// Draws the true path from above; `place` maps a point to the figure.
pub(super) fn truth_from_above(
    figure: &mut Figure,
    pairs: &[PairError],
    place: impl Fn(&Vec3) -> [f64; 2],
) {
    for run in runs(pairs, stamp) {
        let points = run.iter().map(|p| place(&p.reference)).collect();
        figure.line(points, REFERENCE, TRUTH_WIDTH);
    }
}

/// One estimate's values over time, with its root mean square.
pub(super) struct Series<'a> {
    pub(super) name: &'a str,
    pub(super) colour: Colour,
    pub(super) lines: Vec<Timed>,
    pub(super) rmse: f64,
}

/// A full-width panel: values over time from 0 on, with their label.
pub(super) fn over_time(
    figure: &mut Figure,
    (top, height): (f64, f64),
    (x, label): ([f64; 2], &str),
    all: &[Series<'_>],
) {
    let values = all.iter().flat_map(|s| s.lines.iter().flatten());
    let most = values.map(|p| p[1]).fold(0.0, f64::max);
    let axes = Axes {
        area: [85.0, top, 1085.0, height],
        x,
        y: [0.0, (most * 1.1).max(1e-6)],
    };
    axes.draw(figure, "time (s)", label);
    for series in all {
        for line in &series.lines {
            let points = line.iter().map(|[t, v]| axes.at(*t, *v)).collect();
            figure.line(points, series.colour, 1.5);
        }
    }
    let mut marks: Vec<(Mark, &str)> = all.iter().map(|s| (Mark::Line(s.colour), s.name)).collect();
    // With several estimates each has its own RMSE in the title.
    if let [one] = all {
        let ends = [x[0], x[1]].map(|t| axes.at(t, one.rmse));
        figure.dashed(ends.to_vec(), SERIES[1], 1.6);
        marks.push((Mark::Dashed(SERIES[1]), "RMSE"));
    }
    legend(figure, [1170.0, top], &marks);
}

/// Name, colour and relative errors of an estimate.
pub(super) type Relative<'a> = (&'a str, Colour, &'a Rpe);

/// Height of a figure with these relative errors.
pub(super) fn height(relative: &[Relative<'_>]) -> f64 {
    HEIGHT
        + if relative.is_empty() {
            0.0
        } else {
            2.0 * RELATIVE
        }
}

/// The relative errors over time: of translation, and under it of rotation.
pub(super) fn relative_errors(
    figure: &mut Figure,
    (start, x): (f64, [f64; 2]),
    all: &[Relative<'_>],
) {
    let Some((_, _, first)) = all.first() else {
        return;
    };
    let over = match first.delta {
        Delta::Seconds(s) => format!("{s} s"),
        Delta::Frames(n) => format!("{n} frames"),
    };
    let most = all.iter().map(|(_, _, rpe)| rpe.translation.max);
    let (unit, factor) = error_unit(most.fold(0.0, f64::max));
    let mut panel =
        |row: f64, label: &str, of: &dyn Fn(&RelativeError) -> f64, rmse: &dyn Fn(&Rpe) -> f64| {
            let series: Vec<Series<'_>> = all
                .iter()
                .map(|(name, colour, rpe)| Series {
                    name,
                    colour: *colour,
                    lines: runs(&rpe.errors, |e| e.stamp)
                        .into_iter()
                        .map(|run| run.iter().map(|e| [e.stamp - start, of(e)]).collect())
                        .collect(),
                    rmse: rmse(rpe),
                })
                .collect();
            over_time(
                figure,
                (HEIGHT + 30.0 + RELATIVE * row, 120.0),
                (x, label),
                &series,
            );
        };
    panel(
        0.0,
        &format!("RPE, {over} ({unit})"),
        &|e| e.translation * factor,
        &|rpe| rpe.translation.rmse * factor,
    );
    panel(
        1.0,
        &format!("RPE, {over} (deg)"),
        &|e| e.rotation_deg,
        &|rpe| rpe.rotation_deg.rmse,
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinate_panels_share_one_scale() {
        let mut figure = Figure::new(1200.0, 855.0);
        let values = |axis: usize| [vec![0.0, 4.0], vec![7.0, 7.2], vec![]][axis].clone();
        let panels = positions_axes(&mut figure, [0.0, 1.0], values);
        let spans = panels.each_ref().map(|a| a.y[1] - a.y[0]);
        assert!(
            spans.iter().all(|s| (s - spans[0]).abs() < 1e-12),
            "{spans:?}"
        );
        assert!(panels[1].y[0] < 7.0 && panels[1].y[1] > 7.2);
    }
}
