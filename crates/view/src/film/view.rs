//! The view: the image with what moves tinted, and its features.

use crate::{Colour, Picture, shapes};
use stillpoint_imaging::RgbdFrame;
use stillpoint_slam::FrameReport;

/// How much of the colour is mixed into what moves.
const TINT: f32 = 0.5;
/// How much is mixed in along its outline.
const OUTLINE: f32 = 0.9;
/// Radius of a feature, px: what a mark of an image of 640 px has when that is shown in 448.
const RADIUS: f32 = 1.3;
/// How far the dark edge reaches that makes it stand out, px.
const EDGE: f32 = 0.7;

/// A frame in a width, px, with what moves tinted by the report's mask; features that were used green, those that were rejected red.
#[must_use]
pub fn view(frame: &RgbdFrame, report: &FrameReport, width: usize) -> Picture {
    let mut whole = Picture::from_frame(frame);
    if !report.segments.labels.is_empty() {
        shapes::region(&mut whole, &report.segments.mask(frame), (TINT, OUTLINE));
    }
    let height = (whole.height() * width).div_ceil(whole.width().max(1));
    let scale = width as f32 / whole.width().max(1) as f32;
    let mut picture = whole.scaled(width, height);
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
