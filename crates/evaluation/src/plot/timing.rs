//! Plot of times per frame.

use super::axes::Axes;
use super::canvas::{Anchor, Figure};
use super::colour::{FRAME, SERIES};
use super::legend::{Mark, legend};
use super::trajectory::TITLE;
use crate::timing::Stats;

/// A name and one value per frame, ms.
#[derive(Clone, Debug, PartialEq)]
pub struct Series<'a> {
    /// Name of the measured stage.
    pub name: &'a str,
    /// Milliseconds, one per frame; `NAN` for none.
    pub milliseconds: &'a [f64],
}

/// Times per frame: one line per series, its median and 99th percentile in the legend, and the time of a frame at 30 Hz if within the
/// range.
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
    figure.text([30.0, 34.0], title, TITLE, Anchor::Start);
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
