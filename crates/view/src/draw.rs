//! Frames with what was found in them.

use crate::overlay::{Mark, Overlay, OverlayBox};
use crate::{Colour, Picture, shapes, text};
use stillpoint_imaging::RgbdFrame;

/// Radius of the disc of a static feature, px.
const STATIC_RADIUS: f32 = 2.0;
/// Radius of the dot of a feature that was not used, px.
const UNUSED_RADIUS: f32 = 1.25;
/// Radius and width of the ring of a dynamic feature, px.
const RING: (f32, f32) = (4.0, 1.5);
/// How far the dark edge reaches that makes marks stand out from bright images, px.
const EDGE: f32 = 1.0;

/// Draws an overlay over a frame: its colour image where it has one, else the grey one. A caption makes the picture higher by
/// one line.
#[must_use]
pub fn draw(frame: &RgbdFrame, overlay: &Overlay<'_>) -> Picture {
    let mut picture = Picture::from_frame(frame);
    if let Some(cells) = &overlay.cells {
        shapes::cells(&mut picture, cells);
    }
    // What matters more is drawn later.
    let rank = |mark: &Mark| match mark {
        Mark::Unused => 0,
        Mark::Static => 1,
        Mark::Dynamic(_) => 2,
    };
    for turn in 0..3 {
        for (u, v, mark) in overlay.keypoints.iter().filter(|k| rank(&k.2) == turn) {
            draw_mark(&mut picture, (*u, *v), *mark);
        }
    }
    let scale = text::scale(picture.width());
    for object in overlay.boxes {
        draw_box(&mut picture, object, scale);
    }
    if overlay.caption.is_empty() {
        picture
    } else {
        let (width, top) = (picture.width(), picture.height());
        let mut picture = picture.with_strip(strip(scale), Colour::BLACK);
        title(
            &mut picture,
            (0, top),
            width,
            overlay.caption,
            Colour::WHITE,
        );
        picture
    }
}

fn draw_mark(picture: &mut Picture, at: (f32, f32), mark: Mark) {
    match mark {
        Mark::Static => {
            shapes::disc(picture, at, STATIC_RADIUS + EDGE, Colour::BLACK);
            shapes::disc(picture, at, STATIC_RADIUS, Colour::STATIC);
        }
        Mark::Dynamic(colour) => {
            let (radius, width) = RING;
            shapes::ring(picture, at, radius, width + 2.0 * EDGE, Colour::BLACK);
            shapes::ring(picture, at, radius, width, colour);
            shapes::disc(picture, at, STATIC_RADIUS, colour);
        }
        Mark::Unused => shapes::disc(picture, at, UNUSED_RADIUS, Colour::UNUSED),
    }
}

/// Corners further out than this are drawn as if they lay there, px; no image is that large.
const FAR: f64 = 1e6;

fn draw_box(picture: &mut Picture, object: &OverlayBox, scale: usize) {
    let b = &object.bounds;
    if ![b.x0, b.y0, b.x1, b.y1].iter().all(|c| c.is_finite()) {
        return;
    }
    // The pixel centred at 0 begins at -0.5.
    let edge = |c: f64| (c + 0.5).round().clamp(-FAR, FAR) as i64;
    let (x0, y0, x1, y1) = (edge(b.x0), edge(b.y0), edge(b.x1), edge(b.y1));
    let (w, h) = (picture.width() as i64, picture.height() as i64);
    if x1 <= x0 || y1 <= y0 || x1 <= 0 || y1 <= 0 || x0 >= w || y0 >= h {
        return;
    }
    let line = scale as i64;
    shapes::frame(
        picture,
        (x0, y0),
        (x1, y1),
        (line, object.coasting),
        object.colour,
    );
    if object.label.is_empty() {
        return;
    }
    let pad = 2 * scale;
    let label = text::cut(
        &object.label,
        scale,
        picture.width().saturating_sub(2 * pad),
    );
    let (wide, high) = (
        (text::width(&label, scale) + 2 * pad) as i64,
        (text::height(scale) + pad) as i64,
    );
    let x = x0.min(w - wide).max(0);
    // Above the box, or inside where there is no room.
    let y = if y0 >= high { y0 - high } else { y0.max(0) };
    picture.fill((x, y), (x + wide, y + high), object.colour, 1.0);
    let at = (x + pad as i64, y + scale as i64);
    text::write(picture, at, &label, scale, ink_on(object.colour));
}

/// Black on bright colours, white on dark ones.
fn ink_on(ground: Colour) -> Colour {
    let Colour(r, g, b) = ground;
    let luma = 77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b);
    if luma > 128 * 256 {
        Colour::BLACK
    } else {
        Colour::WHITE
    }
}

/// Height of a line of text with space around it, px.
fn strip(scale: usize) -> usize {
    text::height(scale) + 4 * scale
}

/// A line of text in a strip whose upper left corner and width are given; cut where it is too long.
fn title(picture: &mut Picture, (x, y): (usize, usize), room: usize, words: &str, colour: Colour) {
    let scale = text::scale(room);
    let pad = 2 * scale;
    let words = text::cut(words, scale, room.saturating_sub(2 * pad));
    let at = ((x + pad) as i64, (y + pad) as i64);
    text::write(picture, at, &words, scale, colour);
}

/// Two pictures beside each other, each under its title.
#[must_use]
pub fn side_by_side(left: &Picture, right: &Picture, titles: [&str; 2]) -> Picture {
    let scale = text::scale(left.width().max(right.width()));
    let (top, gap) = (strip(scale), 4 * scale);
    let width = left.width() + gap + right.width();
    let height = top + left.height().max(right.height());
    let mut both = Picture::new(width, height, Colour::WHITE);
    let mut x = 0;
    for (picture, words) in [left, right].into_iter().zip(titles) {
        both.paste(picture, x, top);
        title(&mut both, (x, 0), picture.width(), words, Colour::BLACK);
        x += picture.width() + gap;
    }
    both
}
