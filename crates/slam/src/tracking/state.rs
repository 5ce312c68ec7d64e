//! The tracker's state machine.
//!
//! ```text
//!  Waiting --- a map begins, or a place is recognised ---> Tracking <--- the camera is found again ---+
//!     ^                                                       |                                       |
//!     |                                                       +--- a frame has no pose ------------> Lost
//!     +--- the submap is left ------------------------------------------------------------------------+
//! ```

use super::momentum::Momentum;
use super::motion::CameraMotion;
use crate::anchored_pose::AnchoredPose;
use crate::pace::RATE;
use std::sync::Arc;
use stillpoint_geometry::{Se3, Vec6};
use stillpoint_imaging::FrameId;
use stillpoint_map::{KeyframeData, KeyframeId, LandmarkId, MapView};

/// The last frame with a pose.
pub(super) struct LastFrame {
    pub(super) stamp: f64,
    /// Exposure time, s, on the frames' clock.
    pub(super) time: f64,
    pub(super) data: Arc<KeyframeData>,
    pub(super) matches: Vec<Option<LandmarkId>>,
    /// Pose relative to keyframes.
    pub(super) pose: AnchoredPose,
    /// Pose in the newest view used.
    pub(super) world_from_camera: Se3,
}

#[expect(
    clippy::large_enum_variant,
    reason = "there is one of it, and a box would be made anew at every frame"
)]
pub(super) enum State {
    /// No frame of the current submap has a pose: it does not exist yet, was left, or no place in it was recognised.
    Waiting {
        /// The first frame without a pose.
        since: Option<FrameId>,
        /// Frames with enough features but no match to the map, in frames of 30 Hz.
        unplaced: f32,
    },
    /// The last frame has a pose.
    Tracking {
        last: LastFrame,
        motion: CameraMotion,
    },
    /// Tracking was lost.
    Lost {
        since: FrameId,
        /// The last one with a pose.
        last: LastFrame,
        /// Frames with enough features but no match to the map, in frames of 30 Hz.
        unplaced: f32,
    },
}

impl Default for State {
    fn default() -> Self {
        Self::Waiting {
            since: None,
            unplaced: 0.0,
        }
    }
}

impl State {
    /// The last frame with a pose, however old.
    pub(super) fn last(&self) -> Option<&LastFrame> {
        match self {
            Self::Waiting { .. } => None,
            Self::Tracking { last, .. } | Self::Lost { last, .. } => Some(last),
        }
    }

    pub(super) fn last_mut(&mut self) -> Option<&mut LastFrame> {
        match self {
            Self::Waiting { .. } => None,
            Self::Tracking { last, .. } | Self::Lost { last, .. } => Some(last),
        }
    }

    pub(super) fn tracked(&self) -> Option<&LastFrame> {
        match self {
            Self::Tracking { last, .. } => Some(last),
            Self::Waiting { .. } | Self::Lost { .. } => None,
        }
    }

    /// Camera velocity at the last frame, twist per second; known from the second consecutive pose.
    pub(super) fn velocity(&self) -> Option<Vec6> {
        match self {
            Self::Tracking { motion, .. } => motion.at_last(),
            Self::Waiting { .. } | Self::Lost { .. } => None,
        }
    }

    /// Motion model state at the last pose; `None` if lost.
    pub(super) fn momentum(&self) -> Option<&Momentum> {
        match self {
            Self::Tracking { motion, .. } => Some(motion.momentum()),
            Self::Waiting { .. } | Self::Lost { .. } => None,
        }
    }

    /// The first frame of the current loss.
    pub(super) fn lost_since(&self) -> Option<FrameId> {
        match self {
            Self::Waiting { since, .. } => *since,
            Self::Tracking { .. } => None,
            Self::Lost { since, .. } => Some(*since),
        }
    }

    /// The motion to a new pose `camera_from_world` at `time`; unknown unless the last frame has a pose.
    pub(super) fn motion_to(&self, camera_from_world: &Se3, time: f64) -> CameraMotion {
        match self {
            Self::Tracking { last, motion } => {
                let last_from_world = last.world_from_camera.inverse();
                motion.followed_by(&last_from_world, camera_from_world, time - last.time)
            }
            Self::Waiting { .. } | Self::Lost { .. } => CameraMotion::default(),
        }
    }

    /// Updates the last pose from the map view, then predicts the pose at `time`. Returns the reference keyframe and
    /// `camera_from_world`; if lost, the last pose.
    pub(super) fn predict(&mut self, view: &MapView, time: f64) -> (KeyframeId, Se3) {
        let Some(last) = self.last_mut() else {
            return (KeyframeId(0), Se3::identity());
        };
        // After a map correction the last pose moves with its keyframe.
        if let Some(pose) = last.pose.world_from_camera_in(view) {
            last.world_from_camera = pose;
        }
        let reference = view.resolve_keyframe(last.pose.reference);
        let reference = reference.unwrap_or(last.pose.reference);
        let (last_from_world, dt) = (last.world_from_camera.inverse(), time - last.time);
        let predicted = match self {
            Self::Tracking { motion, .. } => motion.predict(&last_from_world, dt),
            Self::Waiting { .. } | Self::Lost { .. } => last_from_world,
        };
        (reference, predicted)
    }

    /// The pose `dt` seconds after the last one by constant velocity; `None` if lost.
    pub(super) fn continued(&self, dt: f64) -> Option<Se3> {
        match self {
            Self::Tracking { last, motion } => {
                Some(motion.predict(&last.world_from_camera.inverse(), dt))
            }
            Self::Waiting { .. } | Self::Lost { .. } => None,
        }
    }

    /// Records a frame without pose. Returns the first frame of the loss.
    pub(super) fn lose(&mut self, frame: FrameId) -> FrameId {
        if let Self::Waiting { since, .. } = self {
            return *since.get_or_insert(frame);
        }
        *self = match std::mem::take(self) {
            Self::Tracking { last, .. } => Self::Lost {
                since: frame,
                last,
                unplaced: 0.0,
            },
            same => same,
        };
        self.lost_since().unwrap_or(frame)
    }

    /// Counts a frame without pose with weight `worth` (in frames of 30 Hz), if it has enough features to start a
    /// submap. Returns their total time, s.
    pub(super) fn count_unplaced(&mut self, shows_enough: bool, worth: f32) -> f64 {
        match self {
            Self::Tracking { .. } => 0.0,
            Self::Waiting { unplaced, .. } | Self::Lost { unplaced, .. } => {
                *unplaced += if shows_enough { worth } else { 0.0 };
                f64::from(*unplaced) / RATE
            }
        }
    }

    /// Leaves the submap, and drops the last pose in it.
    pub(super) fn leave_submap(&mut self) {
        let since = self.lost_since();
        let unplaced = match self {
            Self::Tracking { .. } => 0.0,
            Self::Waiting { unplaced, .. } | Self::Lost { unplaced, .. } => *unplaced,
        };
        *self = Self::Waiting { since, unplaced };
    }

    /// Handles a clock set by `by`, s: the velocity is unknown.
    pub(super) fn set_clock(&mut self, by: f64) {
        if let Self::Tracking { motion, .. } = self {
            *motion = CameraMotion::default();
        }
        if let Some(last) = self.last_mut() {
            last.stamp += by;
            last.time += by;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::Vec3;

    fn at(x: f64) -> Se3 {
        Se3 {
            translation: Vec3::new(x, 0.0, 0.0),
            ..Se3::identity()
        }
    }

    fn last(stamp: f64, x: f64) -> LastFrame {
        let data = crate::synthetic::blank_keyframe(stamp);
        LastFrame {
            stamp,
            time: stamp,
            data: Arc::new(data),
            matches: Vec::new(),
            pose: AnchoredPose {
                keyframe: None,
                reference: KeyframeId(3),
                reference_from_camera: at(x),
                online_world_from_camera: at(x),
            },
            world_from_camera: at(x),
        }
    }

    /// Tracked at 0 s, and 1 m farther at 1 s.
    fn tracking() -> State {
        let before = State::Tracking {
            last: last(0.0, 0.0),
            motion: CameraMotion::default(),
        };
        State::Tracking {
            motion: before.motion_to(&at(1.0).inverse(), 1.0),
            last: last(1.0, 1.0),
        }
    }

    fn predicted_x(state: &mut State, stamp: f64) -> f64 {
        let (reference, pose) = state.predict(&MapView::default(), stamp);
        assert_eq!(reference, KeyframeId(3));
        pose.inverse().translation.x
    }

    #[test]
    fn prediction_uses_velocity_only_while_tracked() {
        let mut state = tracking();
        assert!((predicted_x(&mut state, 1.25) - 1.25).abs() < 1e-9);
        assert!(state.velocity().is_some() && state.lost_since().is_none());
        assert_eq!(state.lose(FrameId(7)), FrameId(7));
        assert!((predicted_x(&mut state, 1.25) - 1.0).abs() < 1e-9);
        assert!(state.velocity().is_none() && state.tracked().is_none());
        // After relocalisation there is no velocity until the second frame.
        let motion = state.motion_to(&at(2.0).inverse(), 2.0);
        assert!(motion.mean().is_none());
    }

    #[test]
    fn loss_keeps_its_first_frame() {
        for mut state in [State::default(), tracking()] {
            assert_eq!(state.lose(FrameId(7)), FrameId(7));
            assert_eq!(state.lose(FrameId(8)), FrameId(7));
            assert_eq!(state.count_unplaced(true, 1.0), 1.0 / RATE);
            assert_eq!(state.count_unplaced(false, 1.0), 1.0 / RATE);
            assert_eq!(state.count_unplaced(true, 2.0), 3.0 / RATE);
            // Also beyond the submap.
            state.leave_submap();
            assert!(state.last().is_none());
            assert_eq!(state.lost_since(), Some(FrameId(7)));
            assert_eq!(state.lose(FrameId(9)), FrameId(7));
            assert_eq!(state.count_unplaced(false, 1.0), 3.0 / RATE);
        }
    }

    #[test]
    fn clock_change_clears_the_velocity() {
        let mut state = tracking();
        state.set_clock(-100.0);
        assert!(state.velocity().is_none() && state.tracked().is_some());
        assert!((state.last().map_or(0.0, |l| l.stamp) + 99.0).abs() < 1e-9);
    }
}
