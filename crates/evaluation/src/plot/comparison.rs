//! Several estimates of one trajectory in one picture.

use super::axes::{Axes, LABEL, range};
use super::canvas::{Anchor, Figure};
use super::colour::{Colour, REFERENCE, SERIES};
use super::legend::{Mark, legend};
use super::trajectory::{NAMES, TITLE, error_unit, runs, widest_axes};
use crate::ate::{Ate, PairError};
use stillpoint_geometry::Vec3;

/// One of the estimates that are compared.
#[derive(Clone, Copy, Debug)]
pub struct Compared<'a> {
    /// What the legend calls it.
    pub name: &'a str,
    /// Its error, aligned for itself.
    pub ate: &'a Ate,
}

/// Top view, x, y and z over time, and the error over time of several estimates against the same ground truth.
///
/// The top view shows the two axes along which the ground truth extends most, at the same scale. Lines break at gaps.
#[must_use]
pub fn comparison_figure(title: &str, estimates: &[Compared<'_>]) -> Figure {
    let mut figure = Figure::new(1200.0, 855.0);
    figure.title([30.0, 34.0], title, TITLE, Anchor::Start);
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
    figure
}

fn coloured<'a>(estimates: &'a [Compared<'a>]) -> impl Iterator<Item = (&'a Compared<'a>, Colour)> {
    estimates.iter().zip(SERIES.into_iter().cycle())
}

fn all_pairs<'a>(estimates: &'a [Compared<'a>]) -> impl Iterator<Item = &'a PairError> {
    estimates.iter().flat_map(|e| &e.ate.pairs)
}

fn marks<'a>(estimates: &'a [Compared<'a>]) -> Vec<(Mark, &'a str)> {
    coloured(estimates)
        .map(|(e, colour)| (Mark::Line(colour), e.name))
        .collect()
}

/// The ground truth of the estimate that has the most of it.
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
    for run in runs(truth) {
        let points = run.iter().map(|p| place(&p.reference)).collect();
        figure.line(points, REFERENCE, 2.6);
    }
    for (estimate, colour) in coloured(estimates) {
        for run in runs(&estimate.ate.pairs) {
            let points = run.iter().map(|p| place(&p.estimate)).collect();
            figure.line(points, colour, 1.6);
        }
    }
    let mut marks = marks(estimates);
    marks.insert(0, (Mark::Line(REFERENCE), "ground truth"));
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
    for (axis, name) in NAMES.iter().enumerate() {
        let axes = Axes {
            area: [715.0, 85.0 + 155.0 * axis as f64, 455.0, 140.0],
            x,
            y: range(
                all_pairs(estimates).flat_map(|p| [p.reference[axis], p.estimate[axis]]),
                0.08,
            ),
        };
        let label = if axis == 2 { "time (s)" } else { "" };
        axes.draw(figure, label, &format!("{name} (m)"));
        let mut draw = |pairs: &[PairError], of: fn(&PairError) -> Vec3, colour, width| {
            for run in runs(pairs) {
                let at = |p: &PairError| axes.at(p.stamp - start, of(p)[axis]);
                figure.line(run.iter().map(at).collect(), colour, width);
            }
        };
        draw(truth(estimates), |p| p.reference, REFERENCE, 2.6);
        for (estimate, colour) in coloured(estimates) {
            draw(&estimate.ate.pairs, |p| p.estimate, colour, 1.3);
        }
    }
}

fn errors(figure: &mut Figure, estimates: &[Compared<'_>], (unit, factor): (&str, f64)) {
    let (start, x) = times(estimates);
    let most = all_pairs(estimates).map(|p| p.error).fold(0.0, f64::max);
    let axes = Axes {
        area: [85.0, 625.0, 1085.0, 180.0],
        x,
        y: [0.0, (most * factor * 1.1).max(1e-6)],
    };
    axes.draw(figure, "time (s)", &format!("error ({unit})"));
    for (estimate, colour) in coloured(estimates) {
        for run in runs(&estimate.ate.pairs) {
            let at = |p: &PairError| axes.at(p.stamp - start, p.error * factor);
            figure.line(run.iter().map(at).collect(), colour, 1.5);
        }
    }
    legend(figure, [1170.0, 625.0], &marks(estimates));
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
    fn every_estimate_has_its_name_its_figure_and_its_lines() {
        let (bad, good) = (ate(0.3, 60), ate(0.01, 90));
        let off = Compared {
            name: "filter off",
            ate: &bad,
        };
        let on = Compared {
            name: "filter on",
            ate: &good,
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
