//! Draws features, boxes and state over frames.

use crate::overlay::{Mark, Overlay, OverlayBox};
use crate::shapes::Line;
use crate::text::Text;
use crate::{Colour, Picture, panel, shapes};
use stillpoint_imaging::RgbdFrame;

/// Radius of the disc of a static feature, px.
const STATIC_RADIUS: f32 = 1.9;
/// Radius of the dot of an unused feature, px.
const UNUSED_RADIUS: f32 = 1.25;
/// Radius and width of the ring of a rejected feature, px.
const RING: (f32, f32) = (3.7, 1.5);
/// Radius of the dot in it, px.
const DOT: f32 = 1.3;
/// Width of the dark edge around marks, for contrast with bright images, px.
const EDGE: f32 = 0.9;

/// Draws an overlay over a frame: its colour image if present, else the grey one. Badge and caption add a line below the image, the legend
/// one or more.
#[must_use]
pub fn draw(frame: &RgbdFrame, overlay: &Overlay<'_>) -> Picture {
    let mut picture = Picture::from_frame(frame);
    if let Some(mask) = overlay.region {
        shapes::region(&mut picture, mask, (shapes::TINT, shapes::OUTLINE));
    }
    // More important marks are drawn later.
    let rank = |mark: &Mark| match mark {
        Mark::Unused => 0,
        Mark::Static => 1,
        Mark::Dynamic(_) => 2,
    };
    for turn in 0..3 {
        for (u, v, mark) in overlay.keypoints.iter().filter(|k| rank(&k.2) == turn) {
            draw_mark(&mut picture, (*u, *v), *mark, 1.0);
        }
    }
    draw_boxes(&mut picture, overlay.boxes);
    panel::with_panel(picture, overlay)
}

/// Draws a feature's mark, magnified by `zoom`.
pub(crate) fn draw_mark(picture: &mut Picture, at: (f32, f32), mark: Mark, zoom: f32) {
    match mark {
        Mark::Static => {
            let radius = STATIC_RADIUS * zoom;
            shapes::disc(picture, at, radius + EDGE, Colour::BLACK);
            shapes::disc(picture, at, radius, Colour::STATIC);
        }
        Mark::Dynamic(colour) => {
            let (radius, width) = (RING.0 * zoom, RING.1 * zoom);
            shapes::ring(picture, at, radius, width + 2.0 * EDGE, Colour::BLACK);
            shapes::ring(picture, at, radius, width, colour);
            shapes::disc(picture, at, DOT * zoom, colour);
        }
        Mark::Unused => shapes::disc(picture, at, UNUSED_RADIUS * zoom, Colour::UNUSED),
    }
}

/// Limit of box corners, px; no image is that large.
const FAR: f64 = 1e6;

/// First and last pixel (exclusive) in both directions.
type Rectangle = ((i64, i64), (i64, i64));

/// Draws all frames, then the labels, so that no frame crosses a label. Labels avoid each other where possible.
fn draw_boxes(picture: &mut Picture, boxes: &[OverlayBox]) {
    let text = Text::for_width(picture.width());
    // The last boxes matter most: their labels are placed first.
    let visible: Vec<_> = boxes
        .iter()
        .filter_map(|b| Some((b, pixels_of(b, picture)?)))
        .collect();
    for (object, (from, to)) in &visible {
        draw_frame(picture, *from, *to, object, text);
    }
    let mut taken: Vec<Rectangle> = Vec::new();
    for (object, around) in visible.iter().rev().filter(|(b, _)| !b.label.is_empty()) {
        let pad = text.space(0.4);
        let room = picture.width().saturating_sub(2 * pad);
        let words = text.cut(&object.label, room);
        let size = ((text.width(&words) + 2 * pad) as i64, text.line() as i64);
        let (from, to) = place(*around, size, picture, &taken);
        shapes::plate(picture, from, to, object.colour);
        let at = (from.0 + pad as i64, from.1);
        text.write(picture, at, &words, object.colour.ink());
        taken.push((from, to));
    }
}

/// The pixels of a box; `None` if it has no area in the image.
fn pixels_of(object: &OverlayBox, picture: &Picture) -> Option<Rectangle> {
    let b = &object.bounds;
    if ![b.x0, b.y0, b.x1, b.y1].iter().all(|c| c.is_finite()) {
        return None;
    }
    // The pixel centred at 0 begins at -0.5.
    let edge = |c: f64| (c + 0.5).round().clamp(-FAR, FAR) as i64;
    let (x0, y0, x1, y1) = (edge(b.x0), edge(b.y0), edge(b.x1), edge(b.y1));
    let (w, h) = (picture.width() as i64, picture.height() as i64);
    let inside = x1 > x0 && y1 > y0 && x1 > 0 && y1 > 0 && x0 < w && y0 < h;
    inside.then_some(((x0, y0), (x1, y1)))
}

fn draw_frame(
    picture: &mut Picture,
    from: (i64, i64),
    to: (i64, i64),
    object: &OverlayBox,
    text: Text,
) {
    let line = |width: usize, coverage: f32| Line {
        width: width as i64,
        dashed: object.coasting,
        coverage,
    };
    if object.quiet {
        shapes::frame(picture, from, to, line(1, 0.55), Colour::THING);
        return;
    }
    // A dark line inside the coloured one gives contrast on any background.
    let width = text.space(0.12);
    let inner = |(x, y): (i64, i64), by: i64| (x + by, y + by);
    let by = width as i64;
    shapes::frame(
        picture,
        inner(from, by),
        inner(to, -by),
        line(1, 0.45),
        Colour::BLACK,
    );
    shapes::frame(picture, from, to, line(width, 1.0), object.colour);
}

/// Position of a label: above its box, inside at the top, below, or inside at the bottom: the first that is inside of the image and
/// overlaps no other label; otherwise inside at the top.
fn place(
    ((x0, y0), (x1, y1)): Rectangle,
    (wide, high): (i64, i64),
    picture: &Picture,
    taken: &[Rectangle],
) -> Rectangle {
    let (w, h) = (picture.width() as i64, picture.height() as i64);
    let x = x0.min(w - wide).max(0);
    let right = (x1.min(w) - wide).max(0);
    let at = |x: i64, y: i64| ((x, y), (x + wide, y + high));
    let top = at(x, y0.clamp(0, (h - high).max(0)));
    let choices = [
        at(x, y0 - high),
        top,
        at(right, y0 - high),
        at(x, y1),
        at(x, y1.min(h) - high),
    ];
    let free = |((ax, ay), (bx, by)): &Rectangle| {
        *ay >= 0
            && *by <= h
            && taken
                .iter()
                .all(|((cx, cy), (dx, dy))| bx <= cx || dx <= ax || by <= cy || dy <= ay)
    };
    choices.into_iter().find(|c| free(c)).unwrap_or(top)
}

/// Two images side by side, with titles.
#[must_use]
pub fn side_by_side(left: &Picture, right: &Picture, titles: [&str; 2]) -> Picture {
    let text = Text::for_width(left.width().max(right.width())).scaled(1.15);
    let (top, gap) = (text.line(), text.space(0.5));
    let width = left.width() + gap + right.width();
    let height = top + left.height().max(right.height());
    let mut both = Picture::new(width, height, Colour::WHITE);
    let mut x = 0;
    for (picture, words) in [left, right].into_iter().zip(titles) {
        both.paste(picture, x, top);
        let words = text.cut(words, picture.width());
        text.write(&mut both, (x as i64, 0), &words, Colour::BLACK);
        x += picture.width() + gap;
    }
    both
}
