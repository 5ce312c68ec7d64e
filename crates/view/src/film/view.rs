//! The view: the image with what moves tinted, and its features.

use crate::{Colour, Picture, shapes};
use stillpoint_imaging::RgbdFrame;
use stillpoint_slam::FrameReport;

/// How much of the colour is mixed into what moves.
const TINT: f32 = 0.5;
/// How much is mixed in at its border.
const BORDER: f32 = 0.9;
/// Radius of a feature, px: what a mark of an image of 640 px has when that is shown in 448.
const RADIUS: f32 = 1.3;
/// How far the dark edge reaches that makes it stand out, px.
const EDGE: f32 = 0.7;

/// A frame in a width, px, with what moves tinted by the report's mask; features that were used green, those that were rejected red.
#[must_use]
pub fn view(frame: &RgbdFrame, report: &FrameReport, width: usize) -> Picture {
    let whole = Picture::from_frame(frame);
    let height = (whole.height() * width).div_ceil(whole.width().max(1));
    let scale = width as f32 / whole.width().max(1) as f32;
    let mut picture = whole.scaled(width, height);
    if !report.segments.labels.is_empty() {
        let mask = report.segments.mask(&frame.depth);
        let mask = Picture::from_gray(&mask).scaled(width, height);
        tint(&mut picture, &mask);
    }
    for turn in [false, true] {
        for verdict in report.verdicts.iter().filter(|v| v.dynamic == turn) {
            let [x, y] = verdict.pixel.map(|c| (c + 0.5) * scale - 0.5);
            let colour = if turn {
                Colour::SEMANTIC
            } else {
                Colour::STATIC
            };
            shapes::disc(&mut picture, (x, y), RADIUS + EDGE, Colour::BLACK);
            shapes::disc(&mut picture, (x, y), RADIUS, colour);
        }
    }
    picture
}

/// Tints what a mask covers, with a line along its border.
fn tint(picture: &mut Picture, mask: &Picture) {
    let inside = |x: i64, y: i64| {
        let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
        mask.at(x, y).map(|c| c.0 > 127)
    };
    for y in 0..picture.height() as i64 {
        for x in 0..picture.width() as i64 {
            if inside(x, y) != Some(true) {
                continue;
            }
            let around = [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)];
            let border = around.iter().any(|(x, y)| inside(*x, *y) == Some(false));
            let coverage = if border { BORDER } else { TINT };
            picture.blend(x, y, Colour::REGION, coverage);
        }
    }
}
