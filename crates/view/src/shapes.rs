//! Discs, rings, frames and tinted regions.

use crate::{Colour, Picture};
use stillpoint_imaging::GrayImage;

/// Calls `paint` for the pixels around a point, with their distances, px.
fn around(
    picture: &mut Picture,
    (u, v): (f32, f32),
    reach: f32,
    mut paint: impl FnMut(&mut Picture, i64, i64, f32),
) {
    // Limits the range of pixels for any input.
    let outside = |c: f32, size: usize| !(-reach..=size as f32 + reach).contains(&c);
    if outside(u, picture.width()) || outside(v, picture.height()) {
        return;
    }
    for y in (v - reach).floor() as i64..=(v + reach).ceil() as i64 {
        for x in (u - reach).floor() as i64..=(u + reach).ceil() as i64 {
            let (dx, dy) = (x as f32 - u, y as f32 - v);
            paint(picture, x, y, (dx * dx + dy * dy).sqrt());
        }
    }
}

/// A filled anti-aliased circle. The centre pixel has the pure colour from a radius of 1.25 px on.
pub(crate) fn disc(picture: &mut Picture, centre: (f32, f32), radius: f32, colour: Colour) {
    around(picture, centre, radius + 1.0, |p, x, y, d| {
        p.blend(x, y, colour, radius + 0.5 - d);
    });
}

pub(crate) fn ring(
    picture: &mut Picture,
    centre: (f32, f32),
    radius: f32,
    width: f32,
    colour: Colour,
) {
    around(picture, centre, radius + width + 1.0, |p, x, y, d| {
        p.blend(x, y, colour, 0.5 * width + 0.5 - (d - radius).abs());
    });
}

/// An anti-aliased line with round ends: its width, px, and opacity.
pub(crate) fn segment(
    picture: &mut Picture,
    (ax, ay): (f32, f32),
    (bx, by): (f32, f32),
    (width, share): (f32, f32),
    colour: Colour,
) {
    // Skips NaN, and coordinates too far away for any image.
    if [ax, ay, bx, by].iter().any(|c| c.is_nan() || c.abs() > 1e5) {
        return;
    }
    let reach = 0.5 * width + 1.0;
    let range = |a: f32, b: f32, end: usize| {
        let end = end as f32;
        let low = (a.min(b) - reach).floor().clamp(0.0, end);
        low as i64..(a.max(b) + reach).ceil().clamp(0.0, end) as i64
    };
    let (dx, dy) = (bx - ax, by - ay);
    let square = (dx * dx + dy * dy).max(1e-6);
    for y in range(ay, by, picture.height()) {
        for x in range(ax, bx, picture.width()) {
            let (px, py) = (x as f32 - ax, y as f32 - ay);
            let along = ((px * dx + py * dy) / square).clamp(0.0, 1.0);
            let (ex, ey) = (px - along * dx, py - along * dy);
            let distance = (ex * ex + ey * ey).sqrt();
            let coverage = (0.5 * width + 0.5 - distance).clamp(0.0, 1.0);
            picture.blend(x, y, colour, share * coverage);
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Line {
    pub(crate) width: i64,
    pub(crate) dashed: bool,
    /// Opacity, 0 to 1.
    pub(crate) coverage: f32,
}

/// A dash and the gap after it, in widths of a line of 2 px.
const DASH: i64 = 4;

/// A frame inside the pixels from `(x0, y0)` up to and excluding `(x1, y1)`. No pixel is drawn twice.
pub(crate) fn frame(
    picture: &mut Picture,
    (x0, y0): (i64, i64),
    (x1, y1): (i64, i64),
    line: Line,
    colour: Colour,
) {
    let dash = DASH * line.width.max(2);
    let drawn = |along: i64| !line.dashed || (along / dash) % 2 == 0;
    let (w, h) = (picture.width() as i64, picture.height() as i64);
    let (top, bottom) = ((y0 + line.width).min(y1), (y1 - line.width).max(y0));
    let (left, right) = ((x0 + line.width).min(x1), (x1 - line.width).max(x0));
    for x in x0.max(0)..x1.min(w) {
        if drawn(x - x0) {
            picture.fill((x, y0), (x + 1, top), colour, line.coverage);
            picture.fill((x, bottom.max(top)), (x + 1, y1), colour, line.coverage);
        }
    }
    for y in top.max(0)..bottom.min(h) {
        if drawn(y - y0) {
            picture.fill((x0, y), (left, y + 1), colour, line.coverage);
            picture.fill((right.max(left), y), (x1, y + 1), colour, line.coverage);
        }
    }
}

/// A filled rectangle with corners cut by a pixel or two: the background of a text.
pub(crate) fn plate(
    picture: &mut Picture,
    (x0, y0): (i64, i64),
    (x1, y1): (i64, i64),
    colour: Colour,
) {
    let cut = ((y1 - y0) / 12).clamp(1, 4);
    for y in y0..y1 {
        let from_edge = (y - y0).min(y1 - 1 - y);
        let inset = (cut - from_edge).max(0);
        picture.fill((x0 + inset, y), (x1 - inset, y + 1), colour, 1.0);
    }
}

/// Opacity of the tint of a moving region; the image stays visible.
pub(crate) const TINT: f32 = 0.26;
pub(crate) const OUTLINE: f32 = 0.75;

/// Tints a mask's region and draws its outline, with opacities `tint` and `outline`. The outline is smooth: its opacity at a pixel follows
/// the mixture of the 3x3 neighbourhood. Pixels beyond the mask's size stay unchanged.
pub(crate) fn region(picture: &mut Picture, mask: &GrayImage, (tint, outline): (f32, f32)) {
    let (width, height) = (
        picture.width().min(mask.width()),
        picture.height().min(mask.height()),
    );
    let around = |v: usize, end: usize| v.saturating_sub(1)..(v + 2).min(end);
    // Most pixels of a region are interior.
    let filled = Picture::mixed_with(Colour::REGION, tint);
    // How many of each column's three pixels are inside, with a column beyond each border.
    let mut columns = vec![0_u8; width + 2];
    for y in 0..height {
        let rows = around(y, height);
        let tall = rows.len();
        columns.fill(0);
        for row in rows {
            for (count, value) in columns[1..].iter_mut().zip(&mask.row(row)[..width]) {
                *count += u8::from(*value > 127);
            }
        }
        if columns.iter().all(|n| *n == 0) {
            continue;
        }
        let row = &mask.row(y)[..width];
        for (x, near) in columns.windows(3).enumerate() {
            match near.iter().sum::<u8>() {
                0 => {}
                9 => picture.replace(x, y, &filled),
                inside => {
                    let all = (tall * around(x, width).len()) as f32;
                    let covered = f32::from(inside) / all;
                    let line = outline * (1.0 - (2.0 * covered - 1.0).abs());
                    let fill = if row[x] > 127 { tint } else { 0.0 };
                    picture.blend(x as i64, y as i64, Colour::REGION, fill.max(line));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey() -> Picture {
        Picture::new(60, 40, Colour(100, 100, 100))
    }

    fn count(picture: &Picture, colour: Colour) -> usize {
        picture
            .data()
            .chunks_exact(3)
            .filter(|p| **p == [colour.0, colour.1, colour.2])
            .count()
    }

    #[test]
    fn discs_cover_their_area_at_any_subpixel_position() {
        for offset in [0.0f32, 0.25, 0.5, 0.9] {
            let mut p = grey();
            disc(
                &mut p,
                (20.0 + offset, 15.0 + offset),
                3.0,
                Colour(101, 100, 100),
            );
            let covered = count(&p, Colour(101, 100, 100));
            assert!((20..=37).contains(&covered), "{offset}: {covered} px of 28");
            let mut p = grey();
            disc(&mut p, (20.0 + offset, 15.0 + offset), 1.25, Colour::STATIC);
            let (x, y) = (
                (20.0 + offset).round() as usize,
                (15.0 + offset).round() as usize,
            );
            assert_eq!(p.at(x, y), Some(Colour::STATIC), "{offset}");
        }
    }

    #[test]
    fn invalid_points_draw_nothing() {
        for point in [
            (f32::NAN, 5.0),
            (5.0, f32::INFINITY),
            (-1e9, 5.0),
            (1e30, -1e30),
        ] {
            let mut p = grey();
            disc(&mut p, point, 3.0, Colour::STATIC);
            ring(&mut p, point, 3.0, 1.0, Colour::STATIC);
            assert_eq!(p, grey(), "{point:?}");
        }
    }

    #[test]
    fn segments_have_their_length_and_width() {
        let mut p = grey();
        segment(
            &mut p,
            (10.0, 20.0),
            (40.0, 20.0),
            (3.0, 1.0),
            Colour::STATIC,
        );
        assert_eq!(p.at(25, 20), Some(Colour::STATIC));
        let covered = count(&p, Colour::STATIC);
        assert!((80..=110).contains(&covered), "{covered}");
        for end in [(f32::NAN, 3.0), (1e30, -1e30)] {
            let mut p = grey();
            segment(&mut p, (5.0, 5.0), end, (2.0, 1.0), Colour::STATIC);
            assert_eq!(p, grey(), "{end:?}");
        }
        let mut p = grey();
        segment(
            &mut p,
            (-50.0, -50.0),
            (-20.0, -9.0),
            (2.0, 1.0),
            Colour::STATIC,
        );
        assert_eq!(p, grey());
    }

    #[test]
    fn dashed_frames_leave_half_out() {
        let line = |dashed, coverage| Line {
            width: 1,
            dashed,
            coverage,
        };
        let (mut full, mut dashed) = (grey(), grey());
        frame(&mut full, (5, 5), (53, 35), line(false, 1.0), Colour::RIGID);
        frame(
            &mut dashed,
            (5, 5),
            (53, 35),
            line(true, 1.0),
            Colour::RIGID,
        );
        assert_eq!(count(&full, Colour::RIGID), 2 * 48 + 2 * 30 - 4);
        let part = count(&dashed, Colour::RIGID);
        assert!((60..=100).contains(&part), "{part}");
        assert_eq!(full.at(5, 5), Some(Colour::RIGID));
        assert_eq!(full.at(52, 34), Some(Colour::RIGID));
        assert_eq!(full.at(6, 6), grey().at(6, 6));
        // No pixel of a pale frame is blended twice.
        let mut pale = grey();
        frame(&mut pale, (5, 5), (53, 35), line(false, 0.5), Colour::WHITE);
        assert_eq!(count(&pale, Colour(178, 178, 178)), 2 * 48 + 2 * 30 - 4);
    }

    #[test]
    fn regions_are_tinted_and_outlined() {
        let mut mask = GrayImage::new(60, 30);
        for y in 10..20 {
            mask.data_mut()[y * 60 + 20..y * 60 + 40].fill(255);
        }
        let mut p = grey();
        region(&mut p, &mask, (0.2, 0.8));
        for untouched in [(5, 5), (17, 15), (30, 7), (42, 15), (30, 35)] {
            assert_eq!(
                p.at(untouched.0, untouched.1),
                grey().at(5, 5),
                "{untouched:?}"
            );
        }
        let red = |x, y| p.at(x, y).unwrap().0;
        let inner = red(30, 15);
        assert!(inner > 120 && (23..37).all(|x| red(x, 15) == inner));
        for (x, y) in [(20, 15), (39, 15), (30, 10), (30, 19)] {
            assert!(red(x, y) > inner + 30, "outline at {x} {y}: {}", red(x, y));
        }
        // An image smaller than the mask.
        region(
            &mut Picture::new(3, 2, Colour::WHITE),
            &mask,
            (TINT, OUTLINE),
        );
    }
}
