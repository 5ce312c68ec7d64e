//! Frames with tinted moving regions, for pages, which show them small.

use crate::{Picture, shapes};
use std::borrow::Cow;
use std::sync::Arc;
use stillpoint_imaging::{ColourImage, RgbdFrame};
use stillpoint_slam::Segments;

/// Tints and outlines the moving regions; returns the frame unchanged if nothing moves.
pub(crate) fn tinted<'a>(frame: &'a RgbdFrame, segments: &Segments) -> Cow<'a, RgbdFrame> {
    if segments.labels.iter().all(|l| *l == 0) {
        return Cow::Borrowed(frame);
    }
    let mut picture = Picture::from_frame(frame);
    let tints = (shapes::TINT, shapes::OUTLINE);
    shapes::region(&mut picture, &segments.mask(frame), tints);
    let (width, height) = (picture.width(), picture.height());
    match ColourImage::from_vec(width, height, picture.data().to_vec()) {
        Ok(colour) => Cow::Owned(RgbdFrame {
            colour: Some(Arc::new(colour)),
            ..frame.clone()
        }),
        // The size matches the pixels, so this does not happen.
        Err(_) => Cow::Borrowed(frame),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_imaging::{DepthImage, FrameId, GrayImage};

    #[test]
    fn only_moving_regions_are_tinted() {
        let near = |i: usize| (24..40).contains(&(i % 64)) && i / 64 > 15;
        let pixels = 64 * 48;
        let frame = RgbdFrame {
            id: FrameId(0),
            stamp: 0.0,
            depth_stamp: 0.0,
            gray: GrayImage::from_vec(64, 48, vec![120; pixels]).unwrap(),
            colour: None,
            depth: {
                let depth = (0..pixels).map(|i| if near(i) { 1.0 } else { 3.0 });
                DepthImage::from_vec(64, 48, depth.collect()).unwrap()
            },
        };
        let cell = |i: usize| u16::from((3..5).contains(&(i % 8)) && i / 8 > 1);
        let mut segments = Segments {
            cell_px: 8,
            width: 8,
            height: 6,
            labels: (0..48).map(cell).collect(),
            seen: [].into(),
        };
        let shown = tinted(&frame, &segments);
        let colour = shown.colour.as_ref().unwrap();
        assert_eq!(colour.at(4, 4), [120; 3]);
        let [r, g, _] = colour.at(32, 36);
        assert!(r > 130 && g < 120, "{r} {g}");
        segments.labels = vec![0; 48].into();
        assert!(tinted(&frame, &segments).colour.is_none());
    }
}
