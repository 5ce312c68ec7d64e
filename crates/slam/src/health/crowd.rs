//! Share of the image covered by people or moving objects, known even for frames lost before the static filter ran.

use crate::static_filter::{FeatureVerdict, MOVER};
use stillpoint_detection::{BoundingBox, Detections, MotionWeights};

/// Maximum age of observations, s: chosen, as a person who walks at 1.3 m/s (Bohannon, Age and Ageing 1997) moves 2.6 m
/// meanwhile, about the width of a view at 2 m.
const RECENT: f64 = 2.0;

#[derive(Clone, Debug, Default)]
pub(super) struct Crowd {
    /// Boxes of self-moving classes in the newest detections.
    boxes: Vec<BoundingBox>,
    detected: Option<f64>,
    /// Stamp, and share of moving keypoints, of the last frame judged by the static filter.
    judged: Option<(f64, f64)>,
}

impl Crowd {
    pub(super) fn detected(&self) -> Option<f64> {
        self.detected
    }

    pub(super) fn observe(&mut self, detections: &Detections, weights: &MotionWeights) {
        // Late detections may arrive in any order.
        if self.detected.is_some_and(|s| s > detections.stamp) {
            return;
        }
        self.detected = Some(detections.stamp);
        let movers = detections.items.iter();
        let movers = movers.filter(|d| weights.get(d.class) >= MOVER);
        self.boxes = movers.map(|d| d.bounds).collect();
    }

    pub(super) fn judge(&mut self, stamp: f64, share: f64) {
        self.judged = Some((stamp, share));
    }

    /// Share of the keypoints on moving objects, as far as known.
    pub(super) fn share(&self, stamp: f64, verdicts: &[FeatureVerdict]) -> f64 {
        let is_recent = |seen: f64| (0.0..=RECENT).contains(&(stamp - seen));
        let judged = self.judged.filter(|(seen, _)| is_recent(*seen));
        let judged = judged.map_or(0.0, |(_, share)| share);
        if verdicts.is_empty() || !self.detected.is_some_and(is_recent) {
            return judged;
        }
        let in_box = |v: &&FeatureVerdict| {
            let [u, v] = v.pixel.map(f64::from);
            self.boxes.iter().any(|b| b.contains(u, v))
        };
        let held = verdicts.iter().filter(in_box).count();
        judged.max(held as f64 / verdicts.len() as f64)
    }

    /// Shifts stamps after the clock was set by `by`, s. Boxes are dropped, since the detector may still use the old
    /// clock.
    pub(super) fn set_clock(&mut self, by: f64) {
        self.boxes.clear();
        self.detected = None;
        if let Some((stamp, _)) = &mut self.judged {
            *stamp += by;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_detection::{ClassId, Detection};
    use stillpoint_imaging::FrameId;

    fn seen(stamp: f64, class: &str) -> Detections {
        let item = Detection {
            class: ClassId::from_name(class).unwrap(),
            score: 0.9,
            bounds: BoundingBox {
                x0: 0.0,
                y0: 0.0,
                x1: 100.0,
                y1: 100.0,
            },
        };
        Detections {
            frame: FrameId(0),
            stamp,
            items: vec![item],
        }
    }

    /// Four keypoints, three of them in the box.
    fn verdicts() -> Vec<FeatureVerdict> {
        let at = |i: u32| FeatureVerdict::kept([40.0 * i as f32, 50.0]);
        (0..4).map(at).collect()
    }

    #[test]
    fn boxes_of_movers_count_for_a_limited_time() {
        let (mut crowd, weights) = (Crowd::default(), MotionWeights::default());
        assert!(crowd.share(1.0, &verdicts()) == 0.0);
        crowd.observe(&seen(1.0, "person"), &weights);
        assert!(crowd.share(1.5, &verdicts()) == 0.75);
        assert!(crowd.share(3.5, &verdicts()) == 0.0);
        // Neither a late older detection nor a frame without keypoints changes anything.
        crowd.observe(&seen(0.5, "chair"), &weights);
        assert!(crowd.share(1.5, &verdicts()) == 0.75 && crowd.share(1.5, &[]) == 0.0);
        // A chair does not move by itself.
        crowd.observe(&seen(2.0, "chair"), &weights);
        assert!(crowd.share(2.0, &verdicts()) == 0.0);
        assert_eq!(crowd.detected(), Some(2.0));
    }

    #[test]
    fn judged_dynamic_share_expires_and_follows_the_clock() {
        let mut crowd = Crowd::default();
        crowd.judge(1.0, 0.8);
        assert!(crowd.share(2.0, &verdicts()) == 0.8);
        assert!(crowd.share(4.0, &verdicts()) == 0.0);
        crowd.set_clock(-100.0);
        assert!(crowd.share(-98.0, &verdicts()) == 0.8);
        assert!(crowd.share(2.0, &verdicts()) == 0.0);
    }
}
