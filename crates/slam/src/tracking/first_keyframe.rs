//! The first keyframe of a map or submap is measured again once the camera's velocity during its exposure is known.
//!
//! There is no earlier frame to give the velocity. At 100 degrees per second the outer rows of a rolling-shutter image
//! are displaced by 10 px, and late depth is read as far from its pixels; the whole map would inherit that. So this
//! keyframe waits for the next frame, and the flow between both.

use super::Tracker;
use super::motion::CameraMotion;
use crate::messages::NewKeyframe;
use std::sync::Arc;
use stillpoint_imaging::FrameId;

/// Longest interval over which a mean velocity is used, s: chosen, three frames of 30 Hz, the maximum weight of a frame
/// (`pace::MOST`).
const LONGEST: f64 = 0.1;

impl Tracker {
    /// Measures the waiting keyframe again with the camera motion since.
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

    /// Releases the waiting keyframe at frame `next`, whether that was tracked or not.
    pub(super) fn release_first_keyframe(&mut self, next: FrameId) -> Option<NewKeyframe> {
        let own = self.map.keyframe_id(next);
        self.keyframes.first.take_if(|k| k.id != own)
    }
}
