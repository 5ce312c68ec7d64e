//! Several estimates of one trajectory in one picture.

use super::axes::{Axes, LABEL, range};
use super::canvas::{Anchor, Figure};
use super::colour::{Colour, REFERENCE, SERIES};
use super::legend::{Mark, legend};
use super::panels::{
    HEIGHT, NAMES, Relative, Series, TRUTH_WIDTH, WIDTH, error_unit, height, over_time, position,
    positions_axes, relative_errors, runs, stamp, truth_from_above,
};
use super::trajectory::{TITLE, widest_axes};
use crate::Rpe;
use crate::ate::{Ate, PairError};
use stillpoint_geometry::Vec3;

/// One of the compared estimates.
#[derive(Clone, Copy, Debug)]
pub struct Compared<'a> {
    /// Name in the legend.
    pub name: &'a str,
    /// Its error, aligned separately.
    pub ate: &'a Ate,
    /// Its relative error, if any.
    pub rpe: Option<&'a Rpe>,
}

/// Top view, x, y and z over time, the error over time, and the relative errors of several estimates against the same ground truth.
///
/// The top view shows the two axes along which the ground truth extends most, at equal scale; x, y and z share one scale, as do all
/// estimates. The ground truth is a wide line, visible under estimates. Lines break at gaps.
#[must_use]
pub fn comparison_figure(title: &str, estimates: &[Compared<'_>]) -> Figure {
    let relative: Vec<Relative<'_>> = coloured(estimates)
        .filter_map(|(e, colour)| Some((e.name, colour, e.rpe?)))
        .collect();
    let mut figure = Figure::new(1200.0, height(&relative));
    figure.text([30.0, 34.0], title, TITLE, Anchor::Start);
    let most = estimates.iter().map(|e| e.ate.statistics.max);
    let (unit, factor) = error_unit(most.fold(0.0, f64::max));
    let decimals = if unit == "mm" { 1 } else { 3 };
    let figures: Vec<String> = estimates
        .iter()
        .map(|e| {
            let rmse = e.ate.statistics.rmse * factor;
            format!("{} {rmse:.decimals$} {unit}", e.name)
        })
        .collect();
    let summary = format!("ATE RMSE: {}", figures.join(", "));
    figure.text([1170.0, 33.0], &summary, LABEL, Anchor::End);
    top_view(&mut figure, estimates);
    positions(&mut figure, estimates);
    errors(&mut figure, estimates, (unit, factor));
    relative_errors(&mut figure, times(estimates), &relative);
    figure
}

fn coloured<'a>(estimates: &'a [Compared<'a>]) -> impl Iterator<Item = (&'a Compared<'a>, Colour)> {
    estimates.iter().zip(SERIES.into_iter().cycle())
}

fn all_pairs<'a>(estimates: &'a [Compared<'a>]) -> impl Iterator<Item = &'a PairError> {
    estimates.iter().flat_map(|e| &e.ate.pairs)
}

/// The longest ground truth among the estimates.
fn truth<'a>(estimates: &'a [Compared<'a>]) -> &'a [PairError] {
    let longest = estimates.iter().max_by_key(|e| e.ate.pairs.len());
    longest.map_or(&[], |e| &e.ate.pairs)
}

fn top_view(figure: &mut Figure, estimates: &[Compared<'_>]) {
    let truth = truth(estimates);
    let (i, j) = widest_axes(truth);
    let both =
        |axis: usize| all_pairs(estimates).flat_map(move |p| [p.reference[axis], p.estimate[axis]]);
    let axes = Axes {
        area: [85.0, 85.0, 500.0, 450.0],
        x: range(both(i), 0.06),
        y: range(both(j), 0.06),
    }
    .with_equal_scale();
    let label = |axis: usize| format!("{} (m)", NAMES[axis]);
    axes.draw(figure, &label(i), &label(j));
    let place = |p: &Vec3| axes.at(p[i], p[j]);
    truth_from_above(figure, truth, place);
    for (estimate, colour) in coloured(estimates) {
        for run in runs(&estimate.ate.pairs, stamp) {
            let points = run.iter().map(|p| place(&p.estimate)).collect();
            figure.line(points, colour, 1.6);
        }
    }
    let mut marks = vec![(Mark::Wide(REFERENCE), "ground truth")];
    marks.extend(coloured(estimates).map(|(e, colour)| (Mark::Line(colour), e.name)));
    legend(figure, [585.0, 85.0], &marks);
}

/// The first stamp, and the seconds from it that all estimates span.
fn times(estimates: &[Compared<'_>]) -> (f64, [f64; 2]) {
    let stamps = || all_pairs(estimates).map(|p| p.stamp);
    let start = stamps().reduce(f64::min).unwrap_or(0.0);
    (start, range(stamps().map(|t| t - start), 0.01))
}

fn positions(figure: &mut Figure, estimates: &[Compared<'_>]) {
    let (start, x) = times(estimates);
    let values = |axis: usize| {
        let both = all_pairs(estimates).flat_map(|p| [p.reference[axis], p.estimate[axis]]);
        both.collect()
    };
    let panels = positions_axes(figure, x, values);
    for (axis, axes) in panels.iter().enumerate() {
        let place = (axes, axis, start);
        let truth = truth(estimates);
        position(
            figure,
            place,
            (truth, |p| p.reference),
            (REFERENCE, TRUTH_WIDTH),
        );
        for (estimate, colour) in coloured(estimates) {
            let pairs = &estimate.ate.pairs;
            position(figure, place, (pairs, |p| p.estimate), (colour, WIDTH));
        }
    }
}

fn errors(figure: &mut Figure, estimates: &[Compared<'_>], (unit, factor): (&str, f64)) {
    let (start, x) = times(estimates);
    let series = coloured(estimates).map(|(estimate, colour)| {
        let lines = runs(&estimate.ate.pairs, stamp).into_iter();
        let lines = lines.map(|run| {
            let points = run.iter().map(|p| [p.stamp - start, p.error * factor]);
            points.collect()
        });
        Series {
            name: estimate.name,
            colour,
            lines: lines.collect(),
            rmse: estimate.ate.statistics.rmse * factor,
        }
    });
    let series: Vec<Series<'_>> = series.collect();
    let label = format!("error ({unit})");
    over_time(figure, (HEIGHT - 230.0, 180.0), (x, &label), &series);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EvalOptions, Score, TimedPose, score};
    use stillpoint_geometry::Se3;

    fn ate(offset: f64, poses: usize) -> Ate {
        let pose = |k: usize, off: f64| {
            let t = k as f64 / 30.0;
            TimedPose {
                stamp: t,
                world_from_camera: Se3 {
                    translation: Vec3::new(libm::cos(t), libm::sin(3.0 * t) * (1.0 + off), 0.2 * t),
                    ..Se3::identity()
                },
            }
        };
        let truth: Vec<TimedPose> = (0..90).map(|k| pose(k, 0.0)).collect();
        let estimate: Vec<TimedPose> = (0..poses).map(|k| pose(k, offset)).collect();
        match score(&truth, &estimate, &EvalOptions::default()).unwrap() {
            Score::Moving(e) => e.ate,
            Score::Fixed(_) => panic!("the ground truth moves"),
        }
    }

    #[test]
    fn comparison_shows_name_figure_and_lines_per_estimate() {
        let (bad, good) = (ate(0.3, 60), ate(0.01, 90));
        let off = Compared {
            name: "filter off",
            ate: &bad,
            rpe: None,
        };
        let on = Compared {
            name: "filter on",
            ate: &good,
            rpe: None,
        };
        let svg = comparison_figure("a room", &[off, on]).to_svg();
        for part in [
            "a room",
            "filter off",
            "filter on",
            "ground truth",
            "error (mm)",
        ] {
            assert!(svg.contains(part), "no {part}");
        }
        for ate in [&bad, &good] {
            let rmse = format!("{:.1} mm", ate.statistics.rmse * 1e3);
            assert!(svg.contains(&rmse), "no {rmse}");
        }
        // Per estimate: top view, three coordinates, the error, and a mark in each of two legends.
        let alone = comparison_figure("a room", &[off]).to_svg();
        let lines = |svg: &str| svg.matches("<polyline").count() + svg.matches("<path").count();
        assert!(
            lines(&svg) >= lines(&alone) + 7,
            "{} {}",
            lines(&svg),
            lines(&alone)
        );
        assert!(comparison_figure("both", &[off, on]).to_png().is_ok());
        assert!(comparison_figure("nothing", &[]).to_png().is_ok());
    }
}
