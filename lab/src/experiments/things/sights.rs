//! Visibility of each true object, and its detections and tracks.

use super::noise;
use stillpoint::detection::{BoundingBox, Motion, ObjectState, ScriptRow};
use stillpoint::simulator::{MoverBox, Simulator, ThingBox};
use stillpoint::slam::Event;

/// Minimum visible share of an object that has to be found.
const LEAST_SHARE: f64 = 0.5;
/// Minimum share of an object's visible pixels with depth for it to be located.
const LEAST_DEPTH: f64 = 0.5;
/// Minimum overlap of boxes of the same object.
const SAME: f64 = 0.5;
/// Interval of frames in which visibility is counted.
const EVERY: usize = 3;

/// Frame counts of one object.
#[derive(Clone, Copy, Default)]
pub(crate) struct Sight {
    /// Frames with enough visible pixels for a detector.
    pub(crate) large: usize,
    /// Of these, frames in which at least half of the unoccluded, uncropped object is visible.
    pub(crate) half: usize,
    /// Of these, frames with depth on half of the visible part: black or distant surfaces have none.
    pub(crate) measured: usize,
    pub(crate) detected: usize,
    /// Frames in which a confirmed, static track was on it.
    pub(crate) tracked: usize,
}

impl Sight {
    pub(crate) fn said(&self, thing: &ThingBox, found: bool) -> String {
        format!(
            "true {} at {:.2?}: {} frames large enough, {} half in sight, {} with depth, detected in {}, tracked in {}: {}",
            thing.class,
            thing.centre,
            self.large,
            self.half,
            self.measured,
            self.detected,
            self.tracked,
            if found { "found" } else { "not found" }
        )
    }
}

pub(crate) struct Sights {
    pub(crate) counts: Vec<Sight>,
}

impl Sights {
    pub(crate) fn new(simulator: &Simulator) -> Self {
        Self {
            counts: vec![Sight::default(); simulator.things().len()],
        }
    }

    /// Adds a frame, with its detections and the run's events.
    pub(crate) fn take(
        &mut self,
        simulator: &Simulator,
        index: usize,
        rows: &[ScriptRow],
        said: &[Event],
    ) {
        let truth = simulator.truth(index).things;
        let stamp = simulator.stamp(index);
        let detected: Vec<(&str, BoundingBox)> = rows
            .iter()
            .filter(|r| r.stamp == stamp)
            .map(|r| (r.detection.class.name(), r.detection.bounds))
            .collect();
        let tracked: Vec<(&str, BoundingBox)> = said
            .iter()
            .filter_map(|e| match e {
                Event::Frame(frame) => Some(frame),
                _ => None,
            })
            .flat_map(|f| f.report.objects.iter())
            .filter(|o| o.state == ObjectState::Confirmed && o.motion != Motion::Moving)
            .map(|o| (o.class.name(), o.bounds))
            .collect();
        for seen in &truth {
            let counts = &mut self.counts[seen.mover as usize - 1];
            counts.detected += usize::from(is_among(seen, &detected));
            counts.tracked += usize::from(is_among(seen, &tracked));
        }
        if index.is_multiple_of(EVERY) {
            self.look(simulator, index, &truth);
        }
    }

    fn look(&mut self, simulator: &Simulator, index: usize, truth: &[MoverBox]) {
        let least = noise(0).min_visible_px;
        let depth = simulator.depth_px(index);
        for seen in truth.iter().filter(|t| t.visible_px >= least) {
            let counts = &mut self.counts[seen.mover as usize - 1];
            counts.large += EVERY;
            let whole = simulator.whole_px(index, seen.mover) as f64;
            if (seen.visible_px as f64) < LEAST_SHARE * whole {
                continue;
            }
            counts.half += EVERY;
            let [all, with] = depth[seen.mover as usize - 1];
            let enough = all > 0 && with as f64 >= LEAST_DEPTH * all as f64;
            counts.measured += if enough { EVERY } else { 0 };
        }
    }
}

fn is_among(seen: &MoverBox, boxes: &[(&str, BoundingBox)]) -> bool {
    let own = BoundingBox {
        x0: seen.x0,
        y0: seen.y0,
        x1: seen.x1,
        y1: seen.y1,
    };
    boxes
        .iter()
        .any(|(class, b)| *class == seen.class && b.iou(&own) >= SAME)
}
