//! Observes a frame and applies the static filter.

use super::ego_motion::EgoMotion;
use super::known::FEW;
use super::{Notes, Tracker};
use crate::association::Matches;
use crate::static_filter::{FeatureVerdict, FrameInput, Judgement};
use std::sync::Arc;
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::KeyframeData;

impl Tracker {
    pub(super) fn observe(&mut self, frame: &RgbdFrame, notes: &mut Notes) -> Arc<KeyframeData> {
        let data = self.front_end.observe(frame);
        notes.counts.keypoints = data.len() as u32;
        notes.counts.with_depth = data.depths.iter().filter(|z| **z > 0.0).count() as u32;
        data
    }

    /// Keeps all features if the filter did not run.
    pub(super) fn keep_all_unless_judged(&self, judgement: &mut Judgement) {
        if judgement.verdicts.is_empty() {
            let keypoints = &self.front_end.observer.features.keypoints;
            let kept = keypoints.iter().map(|k| FeatureVerdict::kept([k.x, k.y]));
            judgement.verdicts = kept.collect();
        }
    }

    /// Runs the static filter on the features of a frame.
    pub(super) fn judge(&mut self, frame: &RgbdFrame, motion: &EgoMotion, notes: &mut Notes) {
        let data = &motion.data;
        let features = &mut self.memory.pixels;
        features.clear();
        features.extend(data.keypoints.iter().map(|k| [k.x, k.y]));
        let last = self.state.last().map(|l| l.world_from_camera);
        let world_from_camera = motion.camera_from_world.inverse();
        // If the frame was judged before with a rejected pose, continues from that state.
        let filter = notes.filter.as_ref().unwrap_or(&self.filter);
        let input = FrameInput {
            frame,
            view: &self.map.view,
            world_from_camera,
            camera_from_depth: self
                .front_end
                .camera_from_depth(frame, motion.velocity.as_ref()),
            features,
            depths: &data.depths,
            pairs: &motion.pairs,
            last_from_now: last.unwrap_or_default().inverse() * world_from_camera,
            few: motion.matches.count < FEW,
        };
        let (judgement, next) = filter.judge(&input, &mut self.memory.filter);
        (notes.judgement, notes.filter) = (judgement, Some(next));
        let verdicts = &notes.judgement.verdicts;
        notes.counts.dynamic = verdicts.iter().filter(|v| v.dynamic).count() as u32;
        notes.counts.released = notes.judgement.released;
        notes.evidence.judged = true;
    }

    /// The static features, and their matches.
    pub(super) fn keep_static(
        &mut self,
        motion: &EgoMotion,
        notes: &Notes,
    ) -> (Arc<KeyframeData>, Matches) {
        let verdicts = &notes.judgement.verdicts;
        let data = self.front_end.observer.select(&motion.data, verdicts);
        let kept = verdicts.iter().map(|v| !v.dynamic);
        let targets = self.memory.matching.targets.take();
        (data, motion.matches.select(kept, targets))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A failed helper is a failed test.

    use super::*;
    use crate::config::Config;
    use crate::synthetic::{blocks, wall, wall_camera};
    use stillpoint_features::{Window, best_two};
    use stillpoint_geometry::Vec3;
    use stillpoint_imaging::Simd;

    #[test]
    fn dynamic_features_are_removed_with_their_matches() {
        let mut tracker = Tracker::new(Config::default(), wall_camera(), Simd::detect());
        let frame = wall(0, |x, y| blocks(1, x, y));
        tracker.front_end.clock.take(&frame);
        let mut notes = Notes::default();
        let all = tracker.observe(&frame, &mut notes);
        assert!(all.len() > 300, "{}", all.len());
        let mut motion = EgoMotion::unknown(Arc::clone(&all));
        for i in (0..all.len()).step_by(2) {
            motion.matches.assign_point(i as u32, Vec3::z());
        }
        tracker.keep_all_unless_judged(&mut notes.judgement);
        // Control: without dynamic features nothing is removed.
        assert_eq!(tracker.keep_static(&motion, &notes).0.len(), all.len());
        let mut verdicts = notes.judgement.verdicts.to_vec();
        for verdict in verdicts.iter_mut().step_by(3) {
            verdict.dynamic = true;
        }
        notes.judgement.verdicts = verdicts.into();
        let (kept, matches) = tracker.keep_static(&motion, &notes);
        let numbers: Vec<usize> = (0..all.len()).filter(|i| i % 3 != 0).collect();
        assert_eq!(kept.len(), numbers.len());
        assert_eq!(
            matches.count,
            numbers.iter().filter(|i| **i % 2 == 0).count()
        );
        for (k, i) in numbers.into_iter().enumerate() {
            assert_eq!(kept.positions[k], all.positions[i]);
            assert_eq!(kept.depths[k], all.depths[i]);
            assert_eq!(matches.targets[k].is_some(), i % 2 == 0);
            // Its grid holds the new numbers.
            let level = kept.keypoints[k].level;
            let window = Window {
                x: kept.positions[k][0],
                y: kept.positions[k][1],
                radius: 0.1,
                min_level: level,
                max_level: level,
            };
            let found = best_two(&kept.searched(), &window, &all.descriptors[i], |_| true);
            assert_eq!(found.unwrap().distance, 0);
            assert_eq!(
                kept.descriptors[found.unwrap().index as usize],
                all.descriptors[i]
            );
        }
    }
}
