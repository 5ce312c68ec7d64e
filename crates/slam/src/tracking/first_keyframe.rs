//! The first keyframe of a map or a submap: measured once it is known how the camera moved while it was taken.
//!
//! The frame that begins a map has none before it, so nothing tells how fast the camera turns. At 100 degrees per second the first and last rows
//! of a rolling shutter's image are 10 px aside of where they belong, and late depth is read as far from its pixels; all of the map would rest
//! on that. So this keyframe waits for the next frame, and the flow between both says it.

use super::Tracker;
use super::motion::CameraMotion;
use crate::messages::NewKeyframe;
use std::sync::Arc;
use stillpoint_imaging::FrameId;

/// A mean velocity over longer is not that of its beginning, s: chosen, three frames of 30 Hz, as long as a frame may stand for (`pace::MOST`).
const LONGEST: f64 = 0.1;

impl Tracker {
    /// Measures the keyframe that waits again, now that the camera is known to have moved like this since.
    pub(super) fn measure_first_keyframe(&mut self, motion: &CameraMotion) {
        let Some(keyframe) = &mut self.keyframes.first else {
            return;
        };
        let (Some(last), Some(frame)) = (self.state.last_mut(), &self.images.previous) else {
            return;
        };
        let seconds = self.front_end.clock.now() - last.time;
        let Some(velocity) = motion.at_before().filter(|_| seconds <= LONGEST) else {
            return;
        };
        let data = self
            .front_end
            .measure_again(frame, &keyframe.data, &velocity);
        let exposure = self.front_end.exposure(Some(velocity));
        keyframe.data = Arc::new(data);
        keyframe.exposure = exposure;
        last.data = Arc::clone(&keyframe.data);
    }

    /// The keyframe that waited for the frame `next`, whatever became of that.
    pub(super) fn release_first_keyframe(&mut self, next: FrameId) -> Option<NewKeyframe> {
        let own = self.map.keyframe_id(next);
        self.keyframes.first.take_if(|k| k.id != own)
    }
}
