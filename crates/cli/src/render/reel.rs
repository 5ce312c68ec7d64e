//! Keeps some images of a run, with their depth.

use crate::failure::Failure;
use crate::sink::{Ended, Sink, Subscription};
use std::sync::Arc;
use stillpoint::imaging::{DepthImage, FrameId, RgbdFrame};
use stillpoint::live::Watch;
use stillpoint::map::MapView;
use stillpoint::slam::{Event, FrameReport};
use stillpoint::view::Picture;
use stillpoint::view::film::{Film, view};

/// Maximum number of images: some 60 MB while they are made. Longer runs are shown faster.
const MOST: usize = 120;
/// Images per second: smooth enough.
pub(crate) const RATE: f64 = 10.0;
/// Frames per second of most cameras: every third one is shown.
const USUAL: f64 = 30.0;
/// Width of the kept depth, px: it only determines when each part of the surface was seen.
const DEPTH_COLUMNS: usize = 160;

pub(crate) struct Reel {
    every: usize,
    seen: usize,
    pub(super) taken: Vec<Taken>,
}

pub(super) struct Taken {
    pub(super) frame: FrameId,
    pub(super) stamp: f64,
    pub(super) view: Picture,
    pub(super) depth: DepthImage,
}

impl Reel {
    pub(crate) fn new(frames: usize) -> Self {
        let smooth = (USUAL / RATE) as usize;
        Self {
            every: frames.div_ceil(MOST).max(smooth),
            seen: 0,
            taken: Vec::new(),
        }
    }

    fn add(&mut self, frame: &RgbdFrame, report: &FrameReport) {
        self.taken.push(Taken {
            frame: report.frame,
            stamp: report.stamp,
            view: view(frame, report, Film::VIEW),
            depth: thinned(&frame.depth),
        });
    }
}

impl Sink for Reel {
    fn subscribe(&mut self, _: &Arc<MapView>, _: Option<&Watch>) -> Option<Subscription> {
        Some(Subscription::to_images("reel", self.every))
    }

    fn receive(&mut self, event: &Event) -> Result<(), Failure> {
        let Some(tracked) = event.as_frame() else {
            return Ok(());
        };
        let turn = self.seen.is_multiple_of(self.every);
        self.seen += 1;
        if let Some(frame) = tracked.frame.as_ref().filter(|_| turn) {
            let _span = tracing::info_span!("overlay").entered();
            self.add(frame, &tracked.report);
        }
        Ok(())
    }

    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure> {
        ended.found.shelf.put(*self);
        Ok(())
    }
}

fn thinned(depth: &DepthImage) -> DepthImage {
    let step = depth.width().div_ceil(DEPTH_COLUMNS).max(1);
    let (w, h) = (depth.width() / step, depth.height() / step);
    let at = |i: usize| depth.at(i % w * step + step / 2, i / w * step + step / 2);
    let data = (0..w * h).map(at).collect();
    // The data match width and height.
    DepthImage::from_vec(w, h, data).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn number_of_kept_pictures_is_bounded() {
        for (frames, every) in [(0, 3), (300, 3), (360, 3), (361, 4), (100_000, 834)] {
            assert_eq!(Reel::new(frames).every, every);
            assert!(frames.div_ceil(every) <= MOST);
        }
    }

    #[test]
    fn depth_is_downsampled() {
        let data = (0..640 * 480).map(|i| (i % 640) as f32 + 1.0).collect();
        let thin = thinned(&DepthImage::from_vec(640, 480, data).unwrap());
        assert_eq!((thin.width(), thin.height()), (160, 120));
        assert_eq!((thin.at(0, 0), thin.at(159, 7)), (3.0, 639.0));
    }
}
