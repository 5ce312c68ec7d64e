//! Images of both passes of the demo, and the filter's verdicts against the simulator's masks.

use crate::failure::Failure;
use crate::sink::{Ended, Sink, Subscription};
use crate::sinks::overlay::{Style, picture};
use std::sync::Arc;
use stillpoint::detection::MotionWeights;
use stillpoint::imaging::{FrameId, RgbdFrame};
use stillpoint::live::Watch;
use stillpoint::map::MapView;
use stillpoint::simulator::Simulator;
use stillpoint::slam::{Event, FeatureVerdict, FrameReport, Reasons};
use stillpoint::view::{Animation, AnimationOptions, Picture, side_by_side, write_png};

/// Maximum number of images per pass: some 20 MB.
const MOST: usize = 50;
const RATE: f64 = 30.0;

/// Keeps every n-th frame of a pass.
pub(crate) struct Shots {
    every: usize,
    seen: usize,
    style: Style,
    taken: Vec<Shot>,
}

impl Sink for Shots {
    fn subscribe(&mut self, _: &Arc<MapView>, _: Option<&Watch>) -> Option<Subscription> {
        Some(Subscription::to_images("shots", self.every))
    }

    fn receive(&mut self, event: &Event) -> Result<(), Failure> {
        if let Some(tracked) = event.as_frame()
            && self.wants_next()
            && let Some(frame) = &tracked.frame
        {
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

struct Shot {
    frame: FrameId,
    picture: Picture,
    verdicts: Arc<[FeatureVerdict]>,
}

impl Shot {
    fn rejected(&self) -> usize {
        self.verdicts.iter().filter(|v| v.dynamic).count()
    }
}

impl Shots {
    pub(crate) fn new(frames: usize, weights: &MotionWeights) -> Self {
        Self {
            every: frames.div_ceil(MOST).max(1),
            seen: 0,
            style: Style {
                weights: weights.clone(),
                ..Style::default()
            },
            taken: Vec::new(),
        }
    }

    /// Counts a frame; true if it will be kept.
    fn wants_next(&mut self) -> bool {
        self.seen += 1;
        (self.seen - 1).is_multiple_of(self.every)
    }

    fn add(&mut self, frame: &RgbdFrame, report: &FrameReport) {
        self.taken.push(Shot {
            frame: report.frame,
            picture: picture(frame, report, &self.style),
            verdicts: report.verdicts.clone(),
        });
    }

    /// Counts the filter's verdicts in the kept frames against the simulator's masks.
    pub(crate) fn against_truth(&self, simulator: &Simulator) -> Hits {
        let mut hits = Hits::default();
        for shot in &self.taken {
            let mask = simulator.truth(shot.frame.0 as usize).mask;
            for v in shot.verdicts.iter() {
                let [x, y] = v.pixel.map(|c| c.round().max(0.0) as usize);
                let inside = x < mask.width() && y < mask.height();
                if inside && mask.data()[y * mask.width() + x] > 0 {
                    hits.people += 1;
                    hits.people_rejected += usize::from(v.dynamic);
                    let parked = !v.dynamic && v.reasons.has(Reasons::PARKED);
                    hits.people_parked += usize::from(parked);
                } else {
                    hits.others += 1;
                    hits.others_rejected += usize::from(v.dynamic);
                }
            }
        }
        hits
    }
}

/// Verdicts in the kept frames by the simulator's masks: on people with their belongings, moving or not, and elsewhere.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Hits {
    pub(crate) people: usize,
    pub(crate) people_rejected: usize,
    /// Kept because they were seen to stand still.
    pub(crate) people_parked: usize,
    pub(crate) others: usize,
    pub(crate) others_rejected: usize,
}

/// Both passes side by side: a PNG of the frame with most rejected keypoints, and a GIF animation. Frames that only one pass has are left
/// out.
///
/// # Errors
/// Passes without any common frame.
pub(crate) fn beside(
    off: &Shots,
    on: &Shots,
    titles: [&str; 2],
) -> Result<(Vec<u8>, Vec<u8>), Failure> {
    let options = AnimationOptions {
        every: 1,
        halve: true,
        frames_per_second: RATE / on.every as f64,
    };
    let mut animation = Animation::new(Vec::new(), options);
    let mut best: Option<(usize, Picture)> = None;
    for (a, b) in off.taken.iter().zip(&on.taken) {
        let both = side_by_side(&a.picture, &b.picture, titles);
        animation.push(&both).map_err(Failure::input)?;
        let rejected = b.rejected();
        if best.as_ref().is_none_or(|(most, _)| rejected > *most) {
            best = Some((rejected, both));
        }
    }
    let animation = animation.finish().map_err(Failure::input)?;
    let mut still = Vec::new();
    if let Some((_, picture)) = best {
        write_png(&picture, &mut still).map_err(Failure::input)?;
    }
    Ok((still, animation))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn number_of_pictures_is_bounded() {
        for (frames, every) in [(0, 1), (1, 1), (50, 1), (51, 2), (300, 6), (100_000, 2000)] {
            let mut shots = Shots::new(frames, &MotionWeights::default());
            assert_eq!(shots.every, every);
            let wanted = (0..frames).filter(|_| shots.wants_next()).count();
            assert!(wanted <= MOST && wanted >= frames.min(MOST / 2), "{wanted}");
        }
    }
}
