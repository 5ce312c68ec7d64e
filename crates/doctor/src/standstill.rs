//! Checks for frozen images.
//!
//! Answers: how many frames repeat the image of the frame before, and for how long. Frames of a source without noise, such as a simulator,
//! repeat while its camera is at rest, so they are only counted.

use crate::finding::{Figure, Finding, Report, Symptom};
use std::sync::Arc;
use stillpoint_imaging::{RgbdFrame, Standstill, Still, StillWatch};

/// Number of consecutive frames from which a stream is frozen: after a dropped frame, its neighbour is paired twice.
const FEW: u32 = 3;
/// Fraction of frames from which single repeats are reported, too: such a stream is slower than its stamps say.
const OFTEN: f64 = 0.1;

#[derive(Default)]
pub(crate) struct Standstills {
    watch: StillWatch,
    /// Frames that repeat an image, by the repeated part, and the longest time of each.
    depth: Seen,
    colour: Seen,
    frame: Seen,
    rest: Seen,
}

#[derive(Clone, Copy, Default)]
struct Seen {
    frames: u32,
    seconds: f64,
    most: u32,
}

impl Seen {
    fn add(&mut self, still: &Standstill) {
        self.frames += 1;
        self.seconds = self.seconds.max(still.seconds);
        self.most = self.most.max(still.frames);
    }
}

impl Standstills {
    pub(crate) fn add(&mut self, frame: &RgbdFrame) {
        let frame = RgbdFrame {
            colour: None,
            ..frame.clone()
        };
        if let Some(still) = self.watch.look(&Arc::new(frame)) {
            match still.what {
                Still::Depth => self.depth.add(&still),
                Still::Colour => self.colour.add(&still),
                Still::Frame => self.frame.add(&still),
                Still::Rest => self.rest.add(&still),
            }
        }
    }
}

pub(crate) fn judge(seen: &Standstills, report: &mut Report) {
    for (what, other, seen) in [
        (Still::Depth, "the colour image goes on", seen.depth),
        (Still::Colour, "depth goes on", seen.colour),
        (Still::Frame, "its stamps go on", seen.frame),
    ] {
        let often = f64::from(seen.frames) >= OFTEN * report.frames.max(1) as f64;
        if seen.frames == 0 || (seen.most < FEW && !often) {
            continue;
        }
        report.find(Finding {
            symptom: Symptom::Standstill,
            message: format!(
                "{} stands still while {other}: {} frames repeat the one before, for {:.2} s ({} frames) at most",
                what.name(),
                seen.frames,
                seen.seconds,
                seen.most
            ),
            remedy: "restart the camera or its driver, use another cable or USB port, and record again; such depth is not used, and frames whose colour image stands still have no pose".into(),
            evidence: vec![Figure::new("frames that repeat an image", f64::from(seen.frames), "")],
        });
    }
    if seen.rest.frames > 0 {
        let share = f64::from(seen.rest.frames) / report.frames.max(1) as f64;
        report.measure(Figure::new(
            "share of frames that repeat the one before, without noise",
            share,
            "",
        ));
    }
}
