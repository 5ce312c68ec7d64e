//! Frames with what was found in them.

use crate::overlay::{Mark, Overlay, OverlayBox};
use crate::shapes::Line;
use crate::text::Text;
use crate::{Colour, Picture, panel, shapes};
use stillpoint_imaging::RgbdFrame;

/// Radius of the disc of a static feature, px.
const STATIC_RADIUS: f32 = 1.9;
/// Radius of the dot of a feature that was not used, px.
const UNUSED_RADIUS: f32 = 1.25;
/// Radius and width of the ring of a rejected feature, px.
const RING: (f32, f32) = (3.7, 1.5);
/// Radius of the dot in it, px.
const DOT: f32 = 1.3;
/// How far the dark edge reaches that makes marks stand out from bright images, px.
const EDGE: f32 = 0.9;

/// Draws an overlay over a frame: its colour image where it has one, else the grey one. Badge and caption make the picture
/// higher by a line, the legend by one or more.
#[must_use]
pub fn draw(frame: &RgbdFrame, overlay: &Overlay<'_>) -> Picture {
    let mut picture = Picture::from_frame(frame);
    if let Some(mask) = overlay.region {
        shapes::region(&mut picture, mask, (shapes::TINT, shapes::OUTLINE));
    }
    // What matters more is drawn later.
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

/// A feature's mark, `zoom` times as large as in an image.
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

/// Corners further out than this are drawn as if they lay there, px; no image is that large.
const FAR: f64 = 1e6;

/// First and last pixel (exclusive) of something in both directions.
type Rectangle = ((i64, i64), (i64, i64));

/// First the frames, then the labels, so that no frame crosses a label. Labels stay clear of each other where they can.
fn draw_boxes(picture: &mut Picture, boxes: &[OverlayBox]) {
    let text = Text::for_width(picture.width());
    // The last boxes matter most: they choose the places of their labels first.
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

/// The pixels of a box; none where it has no area in the picture.
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
    // A dark line inside the coloured one keeps it visible on whatever is behind.
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

/// Where a label of a size stands: above its box, or else inside at the top, below, inside at the bottom: the first of these
/// that is within the picture and clear of other labels; inside at the top where none is.
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

/// Two pictures beside each other, each under its title.
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
