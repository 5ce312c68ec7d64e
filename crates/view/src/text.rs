//! Text in pixels.

use crate::font;
use crate::{Colour, Picture};

/// How many pixels a pixel of the font takes, so that text is legible and small in a picture of this width: 1 up to 479 px,
/// 2 at 640 px, and still readable then when the picture is halved.
pub(crate) fn scale(picture_width: usize) -> usize {
    ((picture_width + 160) / 320).clamp(1, 4)
}

/// Height of a line without space around it, px.
pub(crate) fn height(scale: usize) -> usize {
    font::HEIGHT * scale
}

/// Width of a text, px.
pub(crate) fn width(text: &str, scale: usize) -> usize {
    let n = text.chars().count();
    (n * (font::WIDTH + 1) * scale).saturating_sub(scale)
}

/// The text, with its end replaced by two dots when it is wider than that.
pub(crate) fn cut(text: &str, scale: usize, room: usize) -> String {
    if width(text, scale) <= room {
        return text.to_owned();
    }
    let fits = (room + scale) / ((font::WIDTH + 1) * scale);
    let kept = text.chars().take(fits.saturating_sub(2));
    kept.chain("..".chars()).take(fits).collect()
}

/// Writes a text with its upper left corner at `(x, y)`.
pub(crate) fn write(
    picture: &mut Picture,
    (x, y): (i64, i64),
    text: &str,
    scale: usize,
    colour: Colour,
) {
    let size = scale as i64;
    for (n, c) in text.chars().enumerate() {
        let left = x + (n * (font::WIDTH + 1) * scale) as i64;
        if left >= picture.width() as i64 {
            return;
        }
        for j in 0..font::HEIGHT {
            for i in 0..font::WIDTH {
                if font::ink(c, i, j) {
                    let corner = (left + i as i64 * size, y + j as i64 * size);
                    let end = (corner.0 + size, corner.1 + size);
                    picture.fill(corner, end, colour, 1.0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_as_wide_as_it_says() {
        for scale in 1..4 {
            let text = "HELLO H";
            let (w, h) = (width(text, scale), height(scale));
            let mut p = Picture::new(w + 2, h + 2, Colour::BLACK);
            write(&mut p, (1, 1), text, scale, Colour::WHITE);
            let column = |x: usize| (0..p.height()).any(|y| p.at(x, y) == Some(Colour::WHITE));
            assert!(!column(0) && column(1) && column(w) && !column(w + 1));
            // Capitals are seven rows high.
            let row = |y: usize| (0..p.width()).any(|x| p.at(x, y) == Some(Colour::WHITE));
            assert!(!row(0) && row(1) && row(7 * scale) && !row(7 * scale + 1));
        }
    }

    #[test]
    fn long_text_is_cut() {
        assert_eq!(cut("person 12", 2, 300), "person 12");
        let short = cut("person 12", 2, 70);
        assert_eq!(short, "pers..");
        assert!(width(&short, 2) <= 70);
        assert_eq!(cut("person", 1, 3), "");
        assert_eq!(width("", 3), 0);
    }

    #[test]
    fn capitals_are_seven_pixels_high_or_more_even_when_halved() {
        for (size, least) in [(320, 7), (640, 14), (752, 14), (1280, 28), (64, 7)] {
            assert!(7 * scale(size) >= least, "{size}");
        }
    }
}
