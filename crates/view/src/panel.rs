//! The lines under an image: state and legend.

use crate::draw::draw_mark;
use crate::overlay::{Mark, Overlay};
use crate::text::Text;
use crate::{Colour, Picture, shapes};

const LEGEND: [(Entry, &str); 8] = [
    (Entry::Mark(Mark::Static), "static"),
    (Entry::Word, "rejected for"),
    (Entry::Mark(Mark::Dynamic(Colour::SEMANTIC)), "object"),
    (Entry::Mark(Mark::Dynamic(Colour::RIGID)), "motion"),
    (Entry::Mark(Mark::Dynamic(Colour::HISTORY)), "history"),
    (Entry::Mark(Mark::Dynamic(Colour::EPIPOLAR)), "epipolar"),
    (Entry::Mark(Mark::Dynamic(Colour::DEPTH)), "depth"),
    (Entry::Region, "moving region"),
];

const NAME: &str = "Stillpoint";

/// The sign before a word of the legend.
#[derive(Clone, Copy)]
enum Entry {
    Mark(Mark),
    Region,
    /// No sign: a heading for the following entries.
    Word,
}

/// The image with the overlay's lines below.
pub(crate) fn with_panel(picture: Picture, overlay: &Overlay<'_>) -> Picture {
    let text = Text::for_width(picture.width());
    let (width, mut y) = (picture.width(), picture.height());
    let state = overlay.badge.is_some() || !overlay.caption.is_empty();
    let small = text.scaled(0.9);
    let lines = if overlay.legend {
        lines(small, width)
    } else {
        Vec::new()
    };
    if !state && lines.is_empty() {
        return picture;
    }
    let gap = text.space(0.2);
    let height = usize::from(state) * text.line() + lines.len() * small.line() + gap;
    let mut picture = picture.with_strip(height, Colour::PANEL);
    y += gap / 2;
    if state {
        draw_state(&mut picture, y, text, overlay);
        y += text.line();
    }
    for line in lines {
        draw_line(&mut picture, y, small, &line);
        y += small.line();
    }
    picture
}

fn draw_state(picture: &mut Picture, y: usize, text: Text, overlay: &Overlay<'_>) {
    let pad = text.space(0.4);
    let room = picture.width().saturating_sub(2 * pad);
    let mut x = pad;
    if let Some((words, colour)) = overlay.badge {
        let words = text.cut(words, room);
        let end = x + text.width(&words) + 2 * pad;
        let (top, bottom) = (y + text.space(0.1), y + text.line() - text.space(0.1));
        shapes::plate(
            picture,
            (x as i64, top as i64),
            (end as i64, bottom as i64),
            colour,
        );
        text.write(picture, ((x + pad) as i64, y as i64), &words, colour.ink());
        x = end + pad;
    }
    let words = text.cut(overlay.caption, (pad + room).saturating_sub(x));
    text.write(picture, (x as i64, y as i64), &words, Colour::WHITE);
    sign(picture, (x + text.width(&words) + 2 * pad, y), text);
}

/// Draws the product's mark and name at the right end of a line, if they fit behind `x`.
fn sign(picture: &mut Picture, (x, y): (usize, usize), text: Text) {
    let small = text.scaled(0.9);
    let (mark, wide) = (small.space(1.2), small.width(NAME) + small.space(0.4));
    let Some(left) = picture.width().checked_sub(wide).filter(|l| *l >= x + mark) else {
        return;
    };
    let middle = (
        left as f32 - 0.55 * mark as f32,
        y as f32 + (text.line() - 1) as f32 / 2.0,
    );
    let size = mark as f32;
    shapes::ring(picture, middle, 0.31 * size, 0.09 * size, Colour::UNUSED);
    shapes::disc(picture, middle, 0.14 * size, Colour::of_number(0));
    let at = (left as i64, y as i64);
    small.write(picture, at, NAME, Colour::UNUSED);
}

impl Entry {
    /// Width of the sign, px.
    fn room(self, text: Text) -> usize {
        match self {
            Self::Mark(_) | Self::Region => text.space(1.1),
            Self::Word => 0,
        }
    }

    fn gap(self, text: Text) -> usize {
        match self {
            Self::Mark(_) | Self::Region => text.space(0.65),
            Self::Word => text.space(0.2),
        }
    }

    fn width(self, text: Text, words: &str) -> usize {
        self.room(text) + text.width(words) + self.gap(text)
    }
}

/// The legend's entries, as many per line as fit.
fn lines(text: Text, width: usize) -> Vec<Vec<(Entry, &'static str)>> {
    let room = width.saturating_sub(2 * text.space(0.4));
    let (mut lines, mut line, mut x) = (Vec::new(), Vec::new(), 0);
    for (entry, words) in LEGEND {
        let wide = entry.width(text, words);
        // The space after the last entry may be cut.
        if x > 0 && x + wide - entry.gap(text) > room {
            lines.push(std::mem::take(&mut line));
            x = 0;
        }
        line.push((entry, words));
        x += wide;
    }
    lines.push(line);
    lines
}

fn draw_line(picture: &mut Picture, y: usize, text: Text, entries: &[(Entry, &str)]) {
    let mut x = text.space(0.4);
    let zoom = text.space(1.0) as f32 / 14.0;
    for (entry, words) in entries {
        let room = entry.room(text);
        let (u, v) = (
            x as f32 + room as f32 / 2.0,
            y as f32 + (text.line() - 1) as f32 / 2.0,
        );
        match entry {
            Entry::Mark(mark) => draw_mark(picture, (u, v), *mark, zoom.max(1.0)),
            Entry::Region => {
                let half = room as f32 * 0.36;
                let corner = |sign: f32| ((u + sign * half) as i64, (v + sign * half) as i64);
                let (from, to) = (corner(-1.0), corner(1.0));
                picture.fill(from, to, Colour::REGION, 2.0 * shapes::TINT);
                let line = shapes::Line {
                    width: 1,
                    dashed: false,
                    coverage: 1.0,
                };
                shapes::frame(picture, from, to, line, Colour::REGION);
            }
            Entry::Word => {}
        }
        let at = ((x + room) as i64, y as i64);
        let ink = match entry {
            Entry::Word => Colour::UNUSED,
            Entry::Mark(_) | Entry::Region => Colour::WHITE,
        };
        text.write(picture, at, words, ink);
        x += entry.width(text, words);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn legend_wraps_to_the_width() {
        for (width, most) in [(1280, 1), (640, 1), (320, 2), (160, 4), (40, 8), (0, 8)] {
            let lines = lines(Text::for_width(width).scaled(0.9), width);
            assert_eq!(lines.iter().flatten().count(), LEGEND.len());
            assert!(lines.len() <= most, "{width}: {}", lines.len());
            assert!(lines.iter().all(|l| !l.is_empty()));
        }
    }

    #[test]
    fn picture_is_signed_if_space_allows() {
        let signed = |width: usize, caption: &str| {
            let overlay = Overlay {
                caption,
                ..Overlay::default()
            };
            let with = with_panel(Picture::new(width, 10, Colour::WHITE), &overlay);
            let Colour(r, g, b) = Colour::of_number(0);
            with.data().chunks_exact(3).any(|p| p == [r, g, b])
        };
        assert!(signed(640, "frame 3, 185 inliers"));
        assert!(!signed(640, &"frame 3, 185 inliers, ".repeat(4)));
        assert!(!signed(64, "f"));
    }

    #[test]
    fn legend_explains_every_mark_in_its_colour() {
        let overlay = Overlay {
            legend: true,
            ..Overlay::default()
        };
        let picture = with_panel(Picture::new(640, 10, Colour::WHITE), &overlay);
        for colour in [
            Colour::STATIC,
            Colour::SEMANTIC,
            Colour::RIGID,
            Colour::HISTORY,
            Colour::EPIPOLAR,
            Colour::DEPTH,
        ] {
            let found = picture
                .data()
                .chunks_exact(3)
                .any(|p| p == [colour.0, colour.1, colour.2]);
            assert!(found, "{colour:?}");
        }
    }
}
