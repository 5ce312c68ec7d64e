//! The camera image with tinted moving regions, and its features.

use crate::{Colour, Picture, shapes};
use stillpoint_imaging::RgbdFrame;
use stillpoint_slam::FrameReport;

/// Opacity of the tint of moving regions.
const TINT: f32 = 0.5;
/// Opacity of their outline.
const OUTLINE: f32 = 0.9;
/// Radius of a feature, px: that of an image of 640 px scaled to 448.
const RADIUS: f32 = 1.3;
/// Width of the dark edge around it, px.
const EDGE: f32 = 0.7;

/// A frame scaled to a width, px, with moving regions tinted by the report's mask; used features are green, rejected ones red.
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
