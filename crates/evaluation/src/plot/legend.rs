//! Legends of colours and lines.

use super::axes::{LABEL, SMALL, ticks};
use super::canvas::{Anchor, Figure};
use super::colour::{Colour, FRAME, INK, WHITE, map};

#[derive(Clone, Copy)]
pub(super) enum Mark {
    Line(Colour),
    /// A line in all colours of the map.
    Shaded,
    Wide(Colour),
    Dashed(Colour),
    Ring,
}

/// Names with their marks in a row that ends at the right at `x`, above an area that begins at `y`.
pub(super) fn legend(figure: &mut Figure, [x, y]: [f64; 2], entries: &[(Mark, &str)]) {
    const MARK: f64 = 26.0;
    let width = |name: &str| MARK + 7.0 + super::font::width(name, SMALL) + 20.0;
    let mut left = x - entries.iter().map(|e| width(e.1)).sum::<f64>() + 20.0;
    let row = y - 12.0;
    for (mark, name) in entries {
        let line = vec![[left, row], [left + MARK, row]];
        match mark {
            Mark::Line(colour) => figure.line(line, *colour, 2.4),
            Mark::Shaded => shaded(figure, [left, row], MARK),
            Mark::Wide(colour) => figure.line(line, *colour, super::panels::TRUTH_WIDTH),
            Mark::Dashed(colour) => figure.dashed(line, *colour, 1.6),
            Mark::Ring => ring(figure, [left + 0.5 * MARK, row]),
        }
        figure.text([left + MARK + 7.0, row + 4.3], name, SMALL, Anchor::Start);
        left += width(name);
    }
}

/// A line whose colours go from one end of the map to the other.
fn shaded(figure: &mut Figure, [x, y]: [f64; 2], length: f64) {
    /// Number of pieces of one colour: chosen as that of the map's supporting points.
    const STEPS: usize = 8;
    let at = |k: usize| [x + length * k as f64 / STEPS as f64, y];
    for k in 0..STEPS {
        let colour = map((k as f64 + 0.5) / STEPS as f64);
        figure.line(vec![at(k), at(k + 1)], colour, 2.4);
    }
}

pub(super) fn ring(figure: &mut Figure, centre: [f64; 2]) {
    figure.circle(centre, 5.5, INK);
    figure.circle(centre, 3.5, WHITE);
}

/// The colours of 0 to `full`, upwards, with ticks and a label at the right.
pub(super) fn colour_bar(figure: &mut Figure, [x, y, w, h]: [f64; 4], full: f64, label: &str) {
    const STEPS: usize = 90;
    for k in 0..STEPS {
        let share = (k as f64 + 0.5) / STEPS as f64;
        let top = y + h * (1.0 - (k + 1) as f64 / STEPS as f64);
        // Half a pixel of overlap hides the seams.
        let height = h / STEPS as f64 + if k == 0 { 0.0 } else { 0.5 };
        figure.rect([x, top, w, height], map(share));
    }
    let corners = [[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]];
    figure.line(corners.to_vec(), FRAME, 1.0);
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
    figure.text_upwards([x + w + longest + 26.0, y + 0.5 * h], label, LABEL);
}
