//! The typeface of plots, pictures and pages: text looks the same on every machine, and needs no system fonts.

use ab_glyph::{Font, FontRef, OutlineCurve, Point};

/// Roboto Medium, reduced to the used characters: see `font/README.md`.
pub const TYPEFACE: &[u8] = include_bytes!("../../font/Roboto-Medium.ttf");

/// A part of a letter's outline, in px relative to the start of the text's baseline, y down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step {
    Move([f64; 2]),
    Line([f64; 2]),
    Quad([f64; 2], [f64; 2]),
    Cubic([f64; 2], [f64; 2], [f64; 2]),
}

/// The font, and px per unit of it. A test ensures that it can be read.
fn font(size: f64) -> Option<(FontRef<'static>, f64)> {
    let font = FontRef::try_from_slice(TYPEFACE).ok()?;
    let unit = size / f64::from(font.units_per_em()?);
    Some((font, unit))
}

pub(super) fn width(text: &str, size: f64) -> f64 {
    let Some((font, unit)) = font(size) else {
        return 0.0;
    };
    let advance = |c: char| f64::from(font.h_advance_unscaled(font.glyph_id(c)));
    unit * text.chars().map(advance).sum::<f64>()
}

/// The outlines of a text of one line.
pub(super) fn outlines(text: &str, size: f64, step: &mut impl FnMut(Step)) {
    let Some((font, unit)) = font(size) else {
        return;
    };
    let mut left = 0.0;
    for c in text.chars() {
        let id = font.glyph_id(c);
        let place = |p: Point| [left + unit * f64::from(p.x), -unit * f64::from(p.y)];
        let mut at: Option<Point> = None;
        for curve in font.outline(id).into_iter().flat_map(|o| o.curves) {
            let (from, to) = match curve {
                OutlineCurve::Line(a, b)
                | OutlineCurve::Quad(a, _, b)
                | OutlineCurve::Cubic(a, _, _, b) => (a, b),
            };
            // A contour begins where the previous one did not end.
            if at != Some(from) {
                step(Step::Move(place(from)));
            }
            step(match curve {
                OutlineCurve::Line(_, b) => Step::Line(place(b)),
                OutlineCurve::Quad(_, c, b) => Step::Quad(place(c), place(b)),
                OutlineCurve::Cubic(_, c, d, b) => Step::Cubic(place(c), place(d), place(b)),
            });
            at = Some(to);
        }
        left += unit * f64::from(font.h_advance_unscaled(id));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_printable_character_has_outlines_in_its_box() {
        for c in ('!'..='~').chain(['\u{b0}', '\u{b1}', '\u{b5}', '\u{d7}', '\u{2013}']) {
            let (mut moves, mut least, mut most) = (0, [f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
            outlines(&c.to_string(), 100.0, &mut |step| {
                let (Step::Move(p) | Step::Line(p) | Step::Quad(_, p) | Step::Cubic(_, _, p)) =
                    step;
                moves += usize::from(matches!(step, Step::Move(_)));
                for k in 0..2 {
                    (least[k], most[k]) = (least[k].min(p[k]), most[k].max(p[k]));
                }
            });
            assert!(moves > 0, "{c}");
            assert!(
                least[1] > -95.0 && most[1] < 30.0,
                "{c}: {least:?} {most:?}"
            );
            assert!(
                least[0] > -10.0 && most[0] < width(&c.to_string(), 100.0) + 10.0,
                "{c}"
            );
        }
    }

    #[test]
    fn text_width_is_the_sum_of_its_letters() {
        let apart = width("a", 10.0) + width("b", 10.0);
        assert!((width("ab", 10.0) - apart).abs() < 1e-9 && apart > 8.0);
        assert!((width("ab", 20.0) - 2.0 * apart).abs() < 1e-9);
        assert_eq!(width("", 10.0), 0.0);
    }
}
