//! Anti-aliased text in an embedded font.

use crate::{Colour, Picture};
use ab_glyph::{Font, FontRef, PxScale, ScaleFont, point};
use stillpoint_evaluation::plot::TYPEFACE;

/// Height of a font of size 1 between its extremes, by which `ab_glyph` scales.
const HEIGHT: f32 = 2400.0 / 2048.0;
/// Height of capitals relative to the size.
const CAPITALS: f32 = 1456.0 / 2048.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Text {
    size: f32,
}

impl Text {
    /// A small legible size for an image of this width, px: 16.6 px at 640 px, which is readable when the image is halved.
    pub(crate) fn for_width(picture_width: usize) -> Self {
        Self {
            size: (picture_width as f32 * 0.026).clamp(11.0, 60.0),
        }
    }

    /// Font size (em), px.
    pub(crate) fn of(size: f32) -> Self {
        Self { size }
    }

    pub(crate) fn scaled(self, by: f32) -> Self {
        Self {
            size: self.size * by,
        }
    }

    /// A length proportional to the font size, at least 1 px.
    pub(crate) fn space(self, times: f32) -> usize {
        ((self.size * times).round() as usize).max(1)
    }

    pub(crate) fn capitals(self) -> usize {
        self.space(CAPITALS)
    }

    /// Height of a line with space around it, px.
    pub(crate) fn line(self) -> usize {
        self.capitals() + 2 * self.space(0.4)
    }

    fn scale(self) -> PxScale {
        PxScale::from(self.size * HEIGHT)
    }

    pub(crate) fn width(self, text: &str) -> usize {
        let Some(font) = font() else { return 0 };
        let font = font.as_scaled(self.scale());
        let width = text.chars().map(|c| font.h_advance(font.glyph_id(c)));
        width.sum::<f32>().ceil() as usize
    }

    /// Truncates the text with an ellipsis to a width, px.
    pub(crate) fn cut(self, text: &str, room: usize) -> String {
        if self.width(text) <= room {
            return text.to_owned();
        }
        let mut kept: Vec<char> = text.chars().collect();
        while kept.pop().is_some() {
            let short: String = kept.iter().chain(&['\u{2026}']).collect();
            if self.width(&short) <= room {
                return short;
            }
        }
        String::new()
    }

    /// Draws a text with its left end at `x`, centred in the line with space around it that begins at `y`.
    pub(crate) fn write(self, picture: &mut Picture, (x, y): (i64, i64), text: &str, ink: Colour) {
        let Some(font) = font() else { return };
        let scale = self.scale();
        let scaled = font.as_scaled(scale);
        // Whole pixel rows keep the edges of capitals sharp.
        let base = (y + (self.space(0.4) + self.capitals()) as i64) as f32;
        let mut at = x as f32;
        for c in text.chars() {
            if at >= picture.width() as f32 {
                return;
            }
            let id = scaled.glyph_id(c);
            let glyph = id.with_scale_and_position(scale, point(at, base));
            if let Some(outline) = font.outline_glyph(glyph) {
                let corner = outline.px_bounds().min;
                let (left, top) = (corner.x as i64, corner.y as i64);
                outline.draw(|u, v, coverage| {
                    picture.blend(left + i64::from(u), top + i64::from(v), ink, coverage);
                });
            }
            at += scaled.h_advance(id);
        }
    }
}

/// The font. A test checks that it can be parsed.
fn font() -> Option<FontRef<'static>> {
    FontRef::try_from_slice(TYPEFACE).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn written(text: &str, size: f32) -> Picture {
        let t = Text { size };
        let mut p = Picture::new(t.width(text) + 4, t.line(), Colour::BLACK);
        t.write(&mut p, (2, 0), text, Colour::WHITE);
        p
    }

    #[test]
    fn every_printable_character_has_its_own_glyph() {
        let mut seen = BTreeMap::new();
        for c in ('!'..='~').chain(['\u{b0}', '\u{b1}', '\u{b7}', '\u{d7}', '\u{2026}', '\u{e4}']) {
            let picture = written(&c.to_string(), 24.0);
            let ink = picture.data().iter().filter(|v| **v > 128).count();
            assert!(ink > 6, "{c:?}: {ink}");
            if let Some(other) = seen.insert(picture.data().to_vec(), c) {
                assert!(
                    "Il|".contains(c) && "Il|".contains(other),
                    "{c:?} looks like {other:?}"
                );
            }
        }
    }

    #[test]
    fn text_has_smooth_edges_and_sharp_rows() {
        let p = written("Hello", 17.0);
        let grey = p.data().iter().filter(|v| (32..224).contains(*v)).count();
        assert!(grey > 100, "{grey}");
        // Capitals begin and end at whole rows.
        let t = Text { size: 17.0 };
        let p = written("EEE", 17.0);
        let row = |y: usize| {
            (0..p.width())
                .filter_map(|x| p.at(x, y))
                .map(|c| u32::from(c.0))
                .sum::<u32>()
        };
        let (top, end) = (t.space(0.4), t.space(0.4) + t.capitals());
        assert!(row(end - 1) > 5 * row(end), "{} {}", row(end - 1), row(end));
        assert!(row(top) > 2 * row(top - 1), "{} {}", row(top), row(top - 1));
        assert_eq!(row(top - 2), 0);
    }

    #[test]
    fn text_width_matches_the_drawn_width() {
        for size in [11.0, 17.0, 33.0] {
            let p = written("HELLO H", size);
            let ink = |x: usize| (0..p.height()).any(|y| p.at(x, y).is_some_and(|c| c.0 > 90));
            let last = (0..p.width()).rfind(|x| ink(*x)).unwrap();
            assert!(!ink(0) && !ink(1), "{size}");
            assert!(
                (p.width() - 9..p.width() - 2).contains(&last) || size > 30.0,
                "{size}: {last} of {}",
                p.width()
            );
        }
    }

    #[test]
    fn long_text_is_cut() {
        let t = Text { size: 16.0 };
        assert_eq!(t.cut("person 12", 300), "person 12");
        let short = t.cut("person 12", 50);
        assert!(
            short.starts_with("per") && short.ends_with('\u{2026}'),
            "{short}"
        );
        assert!(t.width(&short) <= 50);
        assert_eq!(t.cut("person", 3), "");
        assert_eq!(t.width(""), 0);
    }

    #[test]
    fn capitals_are_legible_even_when_halved() {
        for (width, least) in [(320, 7), (640, 12), (752, 13), (1280, 22), (64, 7)] {
            let found = Text::for_width(width).capitals();
            assert!(found >= least, "{width}: {found}");
        }
    }
}
