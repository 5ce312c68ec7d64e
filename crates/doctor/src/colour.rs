//! Whether red and blue are what they are called.
//!
//! Answers: whether the coloured surfaces of the images are rather warm or cool. Wood, skin, cardboard, brick and most lamps reflect
//! or send more red than green and more green than blue; hardly anything in a room has these three the other way round. Exchanged channels
//! turn the one into the other exactly. It is a statistic of surfaces: a room painted blue would be misjudged, and a room without colours is not judged.

use crate::finding::{Figure, Finding, Report, Symptom};
use stillpoint_imaging::ColourImage;

/// Time between images that are looked at, s; stride over their pixels, and side of the square that is averaged there, px.
const EVERY: f64 = 0.25;
const STRIDE: usize = 8;
const SQUARE: usize = 5;
/// Ratio of neighbouring channels from which a surface is called warm or cool.
const TINTED: f64 = 1.08;
/// Ratio by which red, or blue, stands out above both other channels.
const VIVID: f64 = 1.25;
/// Share of all surfaces that is added to each count, so that a handful of pixels decides nothing.
const FLOOR: f64 = 0.004;
/// Share of surfaces with a colour that a judgement needs.
const MIN_COLOURED: f64 = 0.02;
/// Cool surfaces outnumber warm ones by this factor, in the geometric mean of the three counts; in streams as they should be, the warm ones do by
/// 1.6 and more.
const COOL: f64 = 1.35;

/// Counts of surfaces by their colour, each beside the same with red and blue exchanged.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Colours {
    seen: u32,
    /// Red over green over blue.
    tinted: [u32; 2],
    /// Red above both.
    vivid: [u32; 2],
    /// The chromaticity of skin and wood.
    skin: [u32; 2],
    last: Option<f64>,
}

impl Colours {
    pub(crate) fn add(&mut self, stamp: f64, image: &ColourImage) {
        if self.last.is_some_and(|last| (stamp - last).abs() < EVERY) {
            return;
        }
        self.last = Some(stamp);
        for y in (0..image.height().saturating_sub(SQUARE)).step_by(STRIDE) {
            for x in (0..image.width().saturating_sub(SQUARE)).step_by(STRIDE) {
                self.count(mean(image, x, y));
            }
        }
    }

    fn count(&mut self, rgb: [f64; 3]) {
        self.seen += 1;
        let [_, g, _] = rgb;
        let most = rgb.iter().copied().fold(0.0, f64::max);
        // Neither clipped nor lost in the dark.
        if !(30.0..250.0).contains(&most) {
            return;
        }
        for (k, [r, b]) in [[rgb[0], rgb[2]], [rgb[2], rgb[0]]].into_iter().enumerate() {
            let sum = r + g + b;
            self.tinted[k] += u32::from(r > TINTED * g && g > TINTED * b);
            self.vivid[k] += u32::from(r > VIVID * g && r > VIVID * b);
            let near = |v: f64, low: f64, high: f64| v > low * sum && v < high * sum;
            let skin = near(r, 0.38, 0.48) && near(g, 0.28, 0.35) && near(b, 0.17, 0.31);
            self.skin[k] += u32::from(skin);
        }
    }

    /// Warm surfaces for each cool one; none where there are no colours.
    fn warmth(&self) -> Option<f64> {
        let share = |n: u32| f64::from(n) / f64::from(self.seen.max(1));
        let all = [self.tinted, self.vivid, self.skin];
        let coloured = self.tinted.iter().chain(&self.vivid);
        if share(coloured.sum()) < MIN_COLOURED {
            return None;
        }
        let log = |c: [u32; 2]| libm::log((share(c[0]) + FLOOR) / (share(c[1]) + FLOOR));
        Some(libm::exp(all.into_iter().map(log).sum::<f64>() / 3.0))
    }
}

fn mean(image: &ColourImage, x: usize, y: usize) -> [f64; 3] {
    let mut sum = [0_u32; 3];
    for row in y..y + SQUARE {
        let first = 3 * (row * image.width() + x);
        for pixel in image.data()[first..first + 3 * SQUARE].chunks_exact(3) {
            (0..3).for_each(|c| sum[c] += u32::from(pixel[c]));
        }
    }
    sum.map(|s| f64::from(s) / (SQUARE * SQUARE) as f64)
}

pub(crate) fn judge(colours: &Colours, report: &mut Report) {
    let Some(warmth) = colours.warmth() else {
        report.pass_over(if colours.seen == 0 {
            "whether red and blue are exchanged: there are no colour images"
        } else {
            "whether red and blue are exchanged: there are no colours"
        });
        return;
    };
    let figure = Figure::new("warm surfaces for each cool one", warmth, "");
    report.measure(figure.clone());
    if warmth * COOL < 1.0 {
        report.find(Finding {
            symptom: Symptom::RedAndBlue,
            message: "red and blue seem to be exchanged: surfaces are blue where rooms are brown".into(),
            remedy: "record with the encoding that the images have (bgr8 for rgb8, or the other way round); poses hardly change, detections of people do".into(),
            evidence: vec![figure],
        });
    }
}
