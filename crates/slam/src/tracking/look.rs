//! Tracking without a map, for [`DynamicMask`](crate::DynamicMask).

use super::config::MIN_INITIAL_POINTS;
use super::ego_motion::EgoMotion;
use super::pose::PosePrior;
use super::state::{LastFrame, State};
use super::{Notes, Tracker};
use crate::anchored_pose::AnchoredPose;
use crate::static_filter::{CapturePose, FeatureVerdict, Judgement};
use std::sync::Arc;
use stillpoint_detection::{Detections, Object};
use stillpoint_geometry::Se3;
use stillpoint_imaging::{FrameId, RgbdFrame};
use stillpoint_map::{KeyframeData, KeyframeId};

/// Duration of well-textured frames without a pose after which tracking restarts, s: a hand in front of the camera or a
/// jerk may last as long. Chosen: ten frames of 30 Hz.
const PATIENCE: f64 = 0.33;

pub(crate) struct Look {
    /// Camera pose, if known.
    pub(crate) world_from_camera: Option<Se3>,
    pub(crate) judgement: Judgement,
}

impl Tracker {
    /// Judges a frame, with the given camera pose or else the motion estimated since the last frame.
    pub(crate) fn look(&mut self, frame: &Arc<RgbdFrame>, given: Option<&Se3>) -> Look {
        let _span = tracing::info_span!("frame").entered();
        self.handle_clock(frame.stamp);
        self.pace.next(frame);
        self.front_end.clock.take(frame);
        let mut notes = Notes::default();
        let data = self.observe(frame, &mut notes);
        let world_from_camera = match self.motion_without_map(frame, &data, given, &mut notes) {
            Some(motion) => {
                self.judge(frame, &motion, &mut notes);
                Some(self.settle_without_map(frame, &motion, given, &notes))
            }
            None => {
                self.lose_without_map(frame, data.len());
                None
            }
        };
        self.images.previous = Some(Arc::clone(frame));
        if let Some(filter) = notes.filter {
            let before = std::mem::replace(&mut self.filter, filter);
            self.memory.filter.give(before);
        }
        if let State::Tracking { last, motion } = &self.state
            && world_from_camera.is_some()
        {
            let place = CapturePose {
                anchored: last.pose,
                camera_from_depth: self
                    .front_end
                    .camera_from_depth(frame, motion.at_last().as_ref()),
            };
            self.filter.remember(&place, &mut self.memory.filter);
        }
        self.keep_all_unless_judged(&mut notes.judgement);
        self.filter.end_frame();
        Look {
            world_from_camera,
            judgement: notes.judgement,
        }
    }

    /// Takes detections of the next frame `next`, or of an earlier one.
    pub(crate) fn take_detections(&mut self, detections: Detections, next: FrameId) {
        if detections.frame >= next {
            self.filter.receive(detections);
        } else {
            // There are no keyframes to judge again.
            self.filter.take_late(&detections, &self.map.view, None);
        }
    }

    pub(crate) fn judge_pixels(
        &self,
        frame: &RgbdFrame,
        objects: &[Object],
        pixels: &[[f32; 2]],
    ) -> Vec<FeatureVerdict> {
        self.filter.judge_pixels(frame, objects, pixels)
    }

    fn motion_without_map(
        &mut self,
        frame: &RgbdFrame,
        data: &Arc<KeyframeData>,
        given: Option<&Se3>,
        notes: &mut Notes,
    ) -> Option<EgoMotion> {
        if let Some(world_from_camera) = given {
            let camera_from_world = world_from_camera.inverse();
            let (pairs, rest) = self.flow(data, &camera_from_world);
            let velocity = self.motion_to(&camera_from_world).at_last();
            let data = self.front_end.measure(frame, velocity.as_ref());
            return Some(EgoMotion {
                follows: true,
                camera_from_world,
                velocity,
                pairs,
                rest,
                ..EgoMotion::unknown(data)
            });
        }
        if self.state.last().is_none() {
            self.beginning.stamp = frame.stamp;
            let begins = notes.counts.with_depth as usize >= MIN_INITIAL_POINTS;
            return begins.then(|| EgoMotion::unknown(Arc::clone(data)));
        }
        let now = self.front_end.clock.now();
        let (reference, predicted) = self.state.predict(&self.map.view, now);
        self.estimate_motion(frame, data, reference, &predicted, notes)
            .ok()
    }

    /// Optimises the pose with static features, unless it is given, and stores it for the next frame. Returns the pose.
    fn settle_without_map(
        &mut self,
        frame: &RgbdFrame,
        motion: &EgoMotion,
        given: Option<&Se3>,
        notes: &Notes,
    ) -> Se3 {
        let (data, matches) = self.keep_static(motion, notes);
        let enough = self.setup.tracking.min_inliers;
        let mut information = None;
        let world_from_camera = match given {
            Some(pose) => *pose,
            None if matches.count >= enough => {
                let start = &motion.camera_from_world;
                let prior = PosePrior {
                    turn: None,
                    place: self.known_place(start),
                };
                let solver = &mut self.memory.solver;
                let (matches, pose, found) =
                    solver.solve_with_precision(&data, start, matches, prior);
                let fits = matches.count >= enough;
                information = fits.then_some(found.information);
                let pose = if fits { pose } else { motion.camera_from_world };
                pose.inverse()
            }
            None => motion.camera_from_world.inverse(),
        };
        let since = self.moved_to(&world_from_camera.inverse(), information);
        self.state = State::Tracking {
            last: LastFrame {
                stamp: frame.stamp,
                time: self.front_end.clock.times(frame).colour,
                matches: vec![None; data.len()],
                data,
                // Without a map, the anchor is nominal.
                pose: AnchoredPose {
                    keyframe: None,
                    reference: KeyframeId(0),
                    reference_from_camera: world_from_camera,
                    online_world_from_camera: world_from_camera,
                },
                world_from_camera,
            },
            motion: since,
        };
        world_from_camera
    }

    /// Handles a frame without a pose. After too many in a row tracking restarts at the origin, since poses before and
    /// after are not comparable.
    fn lose_without_map(&mut self, frame: &RgbdFrame, features: usize) {
        self.state.lose(frame.id);
        let shows_enough = features >= MIN_INITIAL_POINTS;
        let unplaced = self.state.count_unplaced(shows_enough, self.pace.worth());
        if unplaced >= PATIENCE && self.state.last().is_some() {
            self.state = State::default();
            self.filter.forget();
        }
    }
}
