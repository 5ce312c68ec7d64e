//! What moves in a frame, pixel by pixel and box by box, and what a detector would say about it.
//!
//! Answers: exact masks and boxes of the movers, and scripted detections that miss, jitter and never know a box. Knows
//! nothing of the sensor: noise does not change what is true.

use crate::random::{Normal, Purpose, Stream, key};
use crate::raster::View;
use stillpoint_imaging::GrayImage;

/// What moves in a frame at the stamp of its colour image.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTruth {
    /// The mover that each pixel's centre sees: k for mover k, 0 for what stands still.
    pub mask: GrayImage,
    /// The movers that are seen, in the order of their numbers.
    pub boxes: Vec<MoverBox>,
}

impl FrameTruth {
    /// Share of the image that shows movers, 0 to 1.
    #[must_use]
    pub fn cover(&self) -> f64 {
        let seen: usize = self.boxes.iter().map(|b| b.visible_px).sum();
        seen as f64 / self.mask.data().len().max(1) as f64
    }
}

/// The visible part of one mover. Pixel (0, 0) reaches from -0.5 to 0.5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoverBox {
    /// Number of the mover, from 1; the same thing in all frames of a scene.
    pub mover: u32,
    /// What it is: `person` or `box`.
    pub class: &'static str,
    /// Left border, px of the recorded image.
    pub x0: f64,
    /// Upper border, px.
    pub y0: f64,
    /// Right border, px.
    pub x1: f64,
    /// Lower border, px.
    pub y1: f64,
    /// Number of pixels in the mask.
    pub visible_px: usize,
}

/// How a scripted detector errs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectionNoise {
    /// Probability that a visible person is not found in a frame, 0 to 1.
    pub drop: f64,
    /// Standard deviation of each border of a box, px.
    pub jitter_px: f64,
    /// Persons of whom fewer pixels are seen are never found.
    pub min_visible_px: usize,
    /// Decides what is missed and how borders jitter.
    pub seed: u64,
}

impl Default for DetectionNoise {
    /// The errors of a small network on people who move: 30 % missed, borders off by 4 px.
    fn default() -> Self {
        Self {
            drop: 0.3,
            jitter_px: 4.0,
            min_visible_px: 1500,
            seed: 0,
        }
    }
}

/// A box as a detector would give it: a row of a script of detections.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScriptedDetection {
    /// Stamp of the colour image, s.
    pub stamp: f64,
    /// Always `person`: what people carry is in no detector's list.
    pub class: &'static str,
    /// How sure the detector is, 0 to 1.
    pub score: f32,
    /// Left border, px of the recorded image.
    pub x0: f64,
    /// Upper border, px.
    pub y0: f64,
    /// Right border, px.
    pub x1: f64,
    /// Lower border, px.
    pub y1: f64,
}

/// Mask and boxes of a view with one sample per pixel, seen through the lens. `classes[k - 1]` is what mover k is.
pub(crate) fn truth(view: &View, classes: &[&'static str]) -> FrameTruth {
    let mut mask = GrayImage::new(view.width, view.height);
    let nothing = [usize::MAX, usize::MAX, 0, 0];
    // Per mover: left, top, right and bottom pixel, and the number of pixels.
    let mut found = vec![(nothing, 0); classes.len()];
    for (k, (out, number)) in mask.data_mut().iter_mut().zip(&view.face).enumerate() {
        let mover = view.faces.get(usize::from(*number)).map_or(0, |f| f.mover);
        *out = mover;
        if let Some((b, count)) = usize::from(mover)
            .checked_sub(1)
            .and_then(|m| found.get_mut(m))
        {
            let (x, y) = (k % view.width, k / view.width);
            *b = [b[0].min(x), b[1].min(y), b[2].max(x), b[3].max(y)];
            *count += 1;
        }
    }
    let seen = found
        .iter()
        .enumerate()
        .filter(|(_, (_, count))| *count > 0);
    let boxes = seen
        .map(|(k, (b, count))| MoverBox {
            mover: k as u32 + 1,
            class: classes[k],
            x0: b[0] as f64 - 0.5,
            y0: b[1] as f64 - 0.5,
            x1: b[2] as f64 + 0.5,
            y1: b[3] as f64 + 0.5,
            visible_px: *count,
        })
        .collect();
    FrameTruth { mask, boxes }
}

/// What a detector would say about the movers of frame `index`.
pub(crate) fn detections(
    truth: &FrameTruth,
    noise: &DetectionNoise,
    normal: &Normal,
    index: usize,
    stamp: f64,
) -> Vec<ScriptedDetection> {
    let mut rows = Vec::new();
    let (w, h) = (truth.mask.width() as f64, truth.mask.height() as f64);
    for mover in &truth.boxes {
        // Addressed by mover and frame: what happens to one person does not depend on who else is seen.
        let seed = key(noise.seed, Purpose::Detections, u64::from(mover.mover));
        let mut rng = Stream::new(seed, Purpose::Detections, index as u64);
        let missed = rng.chance(noise.drop);
        if missed || mover.class != "person" || mover.visible_px < noise.min_visible_px.max(1) {
            continue;
        }
        let mut border = |at: f64, end: f64| {
            let off = noise.jitter_px * f64::from(normal.at(rng.bits()));
            (at + off).clamp(-0.5, end - 0.5)
        };
        let (x0, x1) = (border(mover.x0, w), border(mover.x1, w));
        let (y0, y1) = (border(mover.y0, h), border(mover.y1, h));
        // Larger persons are surer ones.
        let size = (mover.visible_px as f64 / (0.06 * w * h)).min(1.0);
        rows.push(ScriptedDetection {
            stamp,
            class: mover.class,
            score: (0.45 + 0.35 * size + 0.15 * rng.unit()) as f32,
            x0: x0.min(x1),
            y0: y0.min(y1),
            x1: x0.max(x1),
            y1: y0.max(y1),
        });
    }
    rows
}
