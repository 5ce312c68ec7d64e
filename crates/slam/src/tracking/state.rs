//! What is known of the camera from the frames before: the tracker's state machine.
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

/// The last frame whose pose is known.
pub(super) struct LastFrame {
    pub(super) stamp: f64,
    /// When it was taken, s, by the frames' clock.
    pub(super) time: f64,
    pub(super) data: Arc<KeyframeData>,
    pub(super) matches: Vec<Option<LandmarkId>>,
    /// Its pose, by keyframes.
    pub(super) pose: AnchoredPose,
    /// Its pose in the newest view that was looked at.
    pub(super) world_from_camera: Se3,
}

/// Where the camera is, as far as it is known.
#[expect(
    clippy::large_enum_variant,
    reason = "there is one of it, and a box would be made anew at every frame"
)]
pub(super) enum State {
    /// No frame had a pose in the submap that is to come: there is none yet, it was left, or it is there and no place in it was
    /// recognised.
    Waiting {
        /// The first frame without a pose.
        since: Option<FrameId>,
        /// Frames that showed enough to begin a submap, and nothing that is known, in frames of 30 Hz.
        unplaced: f32,
    },
    /// The frame before has a pose.
    Tracking {
        last: LastFrame,
        motion: CameraMotion,
    },
    /// The camera was tracked, and is not any more.
    Lost {
        /// The first frame without a pose.
        since: FrameId,
        /// The last one with a pose.
        last: LastFrame,
        /// Frames that showed enough to begin a submap, and nothing that is known, in frames of 30 Hz.
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
    /// The last frame with a pose, however long ago.
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

    /// The frame before, if it has a pose.
    pub(super) fn tracked(&self) -> Option<&LastFrame> {
        match self {
            Self::Tracking { last, .. } => Some(last),
            Self::Waiting { .. } | Self::Lost { .. } => None,
        }
    }

    /// The camera's velocity at the last frame, twist per second: known from the second tracked frame in a row on.
    pub(super) fn velocity(&self) -> Option<Vec6> {
        match self {
            Self::Tracking { motion, .. } => motion.at_last(),
            Self::Waiting { .. } | Self::Lost { .. } => None,
        }
    }

    /// What is known of the camera's momentum at the last pose; nothing of a camera that is lost.
    pub(super) fn momentum(&self) -> Option<&Momentum> {
        match self {
            Self::Tracking { motion, .. } => Some(motion.momentum()),
            Self::Waiting { .. } | Self::Lost { .. } => None,
        }
    }

    /// The first frame of the present loss.
    pub(super) fn lost_since(&self) -> Option<FrameId> {
        match self {
            Self::Waiting { since, .. } => *since,
            Self::Tracking { .. } => None,
            Self::Lost { since, .. } => Some(*since),
        }
    }

    /// The motion that a new pose `camera_from_world` at `time` amounts to; unknown unless the frame before has a pose.
    pub(super) fn motion_to(&self, camera_from_world: &Se3, time: f64) -> CameraMotion {
        match self {
            Self::Tracking { last, motion } => {
                let last_from_world = last.world_from_camera.inverse();
                motion.followed_by(&last_from_world, camera_from_world, time - last.time)
            }
            Self::Waiting { .. } | Self::Lost { .. } => CameraMotion::default(),
        }
    }

    /// Expresses the last pose in a view of the map, then predicts that at `time`. Returns the reference keyframe, and
    /// `camera_from_world`: of a camera that is lost where it was last.
    pub(super) fn predict(&mut self, view: &MapView, time: f64) -> (KeyframeId, Se3) {
        let Some(last) = self.last_mut() else {
            return (KeyframeId(0), Se3::identity());
        };
        // The map may have been corrected since, and then the last pose moves with its keyframe.
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

    /// The expected pose `dt` seconds after the last one, without turning; none of a camera that is lost.
    pub(super) fn continued(&self, dt: f64) -> Option<Se3> {
        match self {
            Self::Tracking { last, motion } => {
                Some(motion.predict(&last.world_from_camera.inverse(), dt))
            }
            Self::Waiting { .. } | Self::Lost { .. } => None,
        }
    }

    /// A frame has no pose. Returns the first frame of the loss that it belongs to.
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

    /// Counts a frame without a pose that is `worth` so many of 30 Hz, if it shows enough to begin a submap. Returns the time that such frames
    /// stand for, s.
    pub(super) fn count_unplaced(&mut self, shows_enough: bool, worth: f32) -> f64 {
        match self {
            Self::Tracking { .. } => 0.0,
            Self::Waiting { unplaced, .. } | Self::Lost { unplaced, .. } => {
                *unplaced += if shows_enough { worth } else { 0.0 };
                f64::from(*unplaced) / RATE
            }
        }
    }

    /// The submap is left: where the camera was in it means nothing any more.
    pub(super) fn leave_submap(&mut self) {
        let since = self.lost_since();
        let unplaced = match self {
            Self::Tracking { .. } => 0.0,
            Self::Waiting { unplaced, .. } | Self::Lost { unplaced, .. } => *unplaced,
        };
        *self = Self::Waiting { since, unplaced };
    }

    /// The clock was set by `by`, s: nothing is known of the time in between.
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

    /// Tracked at 0 s and 1 s, 1 m farther.
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
    fn a_tracked_camera_moves_on_and_a_lost_one_stays() {
        let mut state = tracking();
        assert!((predicted_x(&mut state, 1.25) - 1.25).abs() < 1e-9);
        assert!(state.velocity().is_some() && state.lost_since().is_none());
        assert_eq!(state.lose(FrameId(7)), FrameId(7));
        assert!((predicted_x(&mut state, 1.25) - 1.0).abs() < 1e-9);
        assert!(state.velocity().is_none() && state.tracked().is_none());
        // Found again, it has no velocity before the second frame.
        let motion = state.motion_to(&at(2.0).inverse(), 2.0);
        assert!(motion.mean().is_none());
    }

    #[test]
    fn a_loss_keeps_its_first_frame() {
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
    fn a_clock_that_was_set_takes_the_velocity() {
        let mut state = tracking();
        state.set_clock(-100.0);
        assert!(state.velocity().is_none() && state.tracked().is_some());
        assert!((state.last().map_or(0.0, |l| l.stamp) + 99.0).abs() < 1e-9);
    }
}
