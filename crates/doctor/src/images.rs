//! Checks the images: exposure, blur, and the fraction of depth.

use crate::finding::{Figure, Finding, Report, Symptom};
use crate::gradient::Gradient;
use crate::median::median;
use stillpoint_imaging::{DepthImage, GrayImage, RgbdFrame};

/// Grey levels that count as black and as white, and the fraction of an image from which it is too dark or too bright.
const BLACK: u8 = 12;
const WHITE: u8 = 250;
const MOST: f64 = 0.6;
/// Width of contours, px, of a lens that is out of focus or dirty.
const WIDE: f64 = 5.0;
/// Minimum fraction of depth: with less, most features have none.
const MIN_DEPTH: f64 = 0.3;

#[derive(Default)]
pub(crate) struct Images {
    black: Vec<f64>,
    white: Vec<f64>,
    width: Vec<f64>,
    depth: Vec<f64>,
}

impl Images {
    pub(crate) fn add(&mut self, frame: &RgbdFrame, gradient: &Gradient) {
        let pixels = frame.gray.data().len().max(1) as f64;
        let share = |is: fn(u8) -> bool| {
            let count = frame.gray.data().iter().filter(|v| is(**v)).count();
            count as f64 / pixels
        };
        self.black.push(share(|v| v <= BLACK));
        self.white.push(share(|v| v >= WHITE));
        self.width.extend(contour_width(&frame.gray, gradient));
        self.depth.push(measured(&frame.depth));
    }
}

fn measured(depth: &DepthImage) -> f64 {
    let count = depth.data().iter().filter(|z| **z > 0.0).count();
    count as f64 / depth.data().len().max(1) as f64
}

/// Mean width of contours, px: the distance of two pixels that see a whole step, from the energies of differences over 2 px and over
/// [`FAR`] px. A step of any height that is blurred to width `w` has `4 / w` of its squared height in the first, and `FAR - w / 3` in the
/// second.
fn contour_width(image: &GrayImage, gradient: &Gradient) -> Option<f64> {
    const FAR: usize = 24;
    let (w, h) = (image.width(), image.height());
    if w <= FAR || h <= FAR {
        return None;
    }
    let mut sum = 0.0;
    let mut count = 0.0;
    for y in (0..h - FAR).step_by(2) {
        let (row, lower) = (image.row(y), image.row(y + FAR));
        let pixels = row.iter().zip(&row[FAR..]).zip(lower).step_by(2);
        for ((here, right), below) in pixels {
            let difference = |v: &u8| f64::from(i32::from(*v) - i32::from(*here));
            let (right, below) = (difference(right), difference(below));
            sum += right * right + below * below;
            count += 1.0;
        }
    }
    let far = sum / count;
    let near = gradient.energy();
    // In an image without contours both are noise.
    (far > 50.0).then(|| 4.0 * far / (FAR as f64 * near.max(1e-3)))
}

pub(crate) fn judge(images: &mut Images, report: &mut Report) {
    let medians = [
        median(&mut images.black),
        median(&mut images.white),
        median(&mut images.width),
        median(&mut images.depth),
    ];
    if let [Some(black), Some(white), ..] = medians {
        exposure(black, white, report);
    }
    if let Some(width) = medians[2] {
        let figure = Figure::new("width of contours", width, "px");
        report.measure(figure.clone());
        if width > WIDE {
            report.find(Finding {
                symptom: Symptom::Blur,
                message: format!("images are blurred: contours are about {width:.0} px wide"),
                remedy: "focus and clean the lens; with motion blur, shorten the exposure (more light, more gain) or move slower".into(),
                evidence: vec![figure],
            });
        }
    }
    let Some(depth) = medians[3] else { return };
    let figure = Figure::new("share of pixels with depth", depth, "");
    report.measure(figure.clone());
    if depth < MIN_DEPTH {
        report.find(Finding {
            symptom: Symptom::DepthHoles,
            message: format!("only {:.0} % of the pixels have depth", 100.0 * depth),
            remedy: "keep to the camera's range, out of sunlight, off glass and black surfaces; switch the emitter on; check that the depth topic is the one of this camera".into(),
            evidence: vec![figure],
        });
    }
}

fn exposure(black: f64, white: f64, report: &mut Report) {
    report.measure(Figure::new("share of black pixels", black, ""));
    report.measure(Figure::new("share of white pixels", white, ""));
    let (share, what, remedy) = if black > MOST {
        (
            black,
            "dark",
            "more light, a longer exposure or more gain; is the lens covered?",
        )
    } else if white > MOST {
        (
            white,
            "bright",
            "a shorter exposure or less gain; switch automatic exposure on",
        )
    } else {
        return;
    };
    report.find(Finding {
        symptom: Symptom::Exposure,
        message: format!(
            "images are too {what}: {:.0} % of the pixels show nothing",
            100.0 * share
        ),
        remedy: remedy.into(),
        evidence: vec![Figure::new("share of such pixels", share, "")],
    });
}
