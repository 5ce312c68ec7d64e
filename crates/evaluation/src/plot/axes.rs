//! Axes: from data to pixels, with ticks, grid and labels.

use super::canvas::{Anchor, Figure};
use super::colour::{FRAME, GRID};

/// Size of tick labels and axis labels, px.
pub(super) const SMALL: f64 = 12.0;
pub(super) const LABEL: f64 = 13.0;
/// Length of a tick, px, chosen: a third of a label's height.
const TICK: f64 = 4.0;

/// A rectangle of the figure that shows a range of data.
#[derive(Clone, Debug)]
pub(super) struct Axes {
    pub(super) area: [f64; 4],
    pub(super) x: [f64; 2],
    pub(super) y: [f64; 2],
}

/// The range of values, extended by a fraction on both sides; an interval around a single value, and 0 to 1 for none.
pub(super) fn range(values: impl Iterator<Item = f64>, margin: f64) -> [f64; 2] {
    let (lo, hi) = values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
            (a.min(v), b.max(v))
        });
    if lo > hi {
        return [0.0, 1.0];
    }
    let extra = ((hi - lo) * margin).max(1e-9 * hi.abs().max(1.0));
    let extra = if hi - lo > 0.0 { extra } else { extra.max(0.5) };
    [lo - extra, hi + extra]
}

/// Ticks at multiples of 1, 2 or 5 times a power of ten, about `count` of them, and their number of decimals.
pub(super) fn ticks([lo, hi]: [f64; 2], count: f64) -> (Vec<f64>, usize) {
    let raw = (hi - lo) / count.max(1.0);
    if !(raw.is_finite() && raw > 0.0) {
        return (Vec::new(), 0);
    }
    let power = libm::pow(10.0, libm::floor(libm::log10(raw)));
    let wanted = |s: &f64| *s >= raw * 0.999;
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|f| f * power)
        .into_iter()
        .find(wanted);
    let step = step.unwrap_or(10.0 * power);
    // A short range may lie between two multiples of its step: then the next finer step with a multiple in the range is used.
    let multiples = |step: f64| {
        let first = (lo / step - 1e-9).ceil();
        (first, (hi / step + 1e-9).floor() - first)
    };
    let finer = [1.0, 0.5, 0.2, 0.1].map(|f| f * step);
    let step = finer
        .into_iter()
        .find(|s| multiples(*s).1 >= 0.0)
        .unwrap_or(step);
    let mut decimals = (-libm::floor(libm::log10(step) + 1e-9)).clamp(0.0, 9.0) as usize;
    let in_last_digit = step * libm::pow(10.0, decimals as f64);
    decimals += usize::from((in_last_digit - libm::round(in_last_digit)).abs() > 1e-6);
    let (first, n) = multiples(step);
    let n = n.clamp(0.0, 100.0) as usize;
    // Adding 0.0 turns -0.0 into 0.0.
    let values = (0..=n).map(|k| (first + k as f64) * step + 0.0).collect();
    (values, decimals)
}

impl Axes {
    /// Equal scale on both axes: widens the range that has room.
    pub(super) fn with_equal_scale(mut self) -> Self {
        let [_, _, w, h] = self.area;
        let scale = ((self.x[1] - self.x[0]) / w).max((self.y[1] - self.y[0]) / h);
        let widen = |[lo, hi]: [f64; 2], px: f64| {
            let (mid, half) = (0.5 * (lo + hi), 0.5 * px * scale);
            [mid - half, mid + half]
        };
        (self.x, self.y) = (widen(self.x, w), widen(self.y, h));
        self
    }

    pub(super) fn at(&self, x: f64, y: f64) -> [f64; 2] {
        let [left, top, w, h] = self.area;
        [
            left + w * (x - self.x[0]) / (self.x[1] - self.x[0]),
            top + h * (1.0 - (y - self.y[0]) / (self.y[1] - self.y[0])),
        ]
    }

    /// Draws grid, ticks with their labels, frame and axis labels; an empty `x_label` is omitted (a panel above another one that has it).
    pub(super) fn draw(&self, figure: &mut Figure, x_label: &str, y_label: &str) {
        let [left, top, w, h] = self.area;
        let (bottom, right) = (top + h, left + w);
        let (xs, x_decimals) = ticks(self.x, (w / 60.0).clamp(3.0, 12.0));
        let (ys, y_decimals) = ticks(self.y, (h / 28.0).clamp(2.0, 8.0));
        for &t in &xs {
            let [px, _] = self.at(t, self.y[0]);
            figure.line(vec![[px, top], [px, bottom]], GRID, 1.0);
            figure.line(vec![[px, bottom], [px, bottom + TICK]], FRAME, 1.0);
            let text = format!("{t:.x_decimals$}");
            figure.text([px, bottom + 17.0], &text, SMALL, Anchor::Middle);
        }
        // The label keeps its distance from ticks with many digits.
        let mut offset = 50.0f64;
        for &t in &ys {
            let [_, py] = self.at(self.x[0], t);
            let text = format!("{t:.y_decimals$}");
            figure.line(vec![[left, py], [right, py]], GRID, 1.0);
            figure.line(vec![[left - TICK, py], [left, py]], FRAME, 1.0);
            figure.text([left - 7.0, py + 4.3], &text, SMALL, Anchor::End);
            offset = offset.max(super::font::width(&text, SMALL) + 20.0);
        }
        let corners = [
            [left, top],
            [right, top],
            [right, bottom],
            [left, bottom],
            [left, top],
        ];
        figure.line(corners.to_vec(), FRAME, 1.0);
        if !x_label.is_empty() {
            figure.text(
                [left + 0.5 * w, bottom + 36.0],
                x_label,
                LABEL,
                Anchor::Middle,
            );
        }
        figure.text_upwards([left - offset, top + 0.5 * h], y_label, LABEL);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn tick_values_are_round() {
        assert_eq!(
            ticks([0.0, 10.0], 5.0),
            (vec![0.0, 2.0, 4.0, 6.0, 8.0, 10.0], 0)
        );
        let (t, decimals) = ticks([-0.13, 0.21], 4.0);
        assert_eq!((t.len(), decimals), (4, 1));
        assert_eq!(ticks([-9969.0, -5363.0], 2.0).0, [-7500.0]);
        assert_eq!(ticks([1.0, 1.0], 4.0).0, []);
        assert_eq!(ticks([f64::NAN, 1.0], 4.0).0, []);
    }

    proptest! {
        #[test]
        fn ticks_lie_in_the_range(lo in -1e4..1e4f64, extent in 1e-4..1e4f64, n in 2.0..12.0f64) {
            let (t, _) = ticks([lo, lo + extent], n);
            prop_assert!(!t.is_empty() && t.len() as f64 <= n + 1.5);
            for v in t {
                prop_assert!(v >= lo - 1e-6 * extent && v <= lo + extent * (1.0 + 1e-6));
            }
        }

        #[test]
        fn axis_range_contains_its_values(v in proptest::collection::vec(-1e6..1e6f64, 0..20)) {
            let [lo, hi] = range(v.iter().copied(), 0.05);
            prop_assert!(lo < hi && v.iter().all(|x| (lo..=hi).contains(x)));
        }
    }
}
