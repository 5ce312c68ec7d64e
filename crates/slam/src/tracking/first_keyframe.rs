//! The first keyframe of a map or a submap: measured once it is known how the camera moved while it was taken.
//!
//! The frame that begins a map has none before it, so nothing tells how fast the camera turns. At 100 degrees per second the first and last rows
//! of a rolling shutter's image are 10 px aside of where they belong, and late depth is read as far from its pixels; all of the map would rest
//! on that. So this keyframe waits for the next frame, and the flow between both says it.

use super::Tracker;
use super::motion::CameraMotion;
use crate::messages::{Exposure, NewKeyframe};
use std::sync::Arc;
use stillpoint_imaging::FrameId;

/// A mean velocity over longer is not that of its beginning, s.
const LONGEST: f64 = 0.1;
/// The mapper is told of a readout that moves what the keyframes measured by this, px.
const LEARNED_PX: f64 = 2.0;

impl Tracker {
    /// Measures the keyframe that waits again, now that the camera is known to have moved like this since.
    pub(super) fn measure_first_keyframe(&mut self, motion: &CameraMotion) {
        let Some(keyframe) = &mut self.first_keyframe else {
            return;
        };
        let (Some(last), Some(frame)) = (self.state.last_mut(), &self.previous) else {
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
        self.note_exposure(&exposure);
    }

    /// Notes with what a keyframe was measured.
    pub(super) fn note_exposure(&mut self, exposure: &Exposure) {
        self.since_keyframe.readout = exposure.readout;
        if let Some(velocity) = &exposure.velocity {
            let per_second = self.front_end.shutter_of(1.0).reach_px(velocity);
            self.fastest_keyframe = self.fastest_keyframe.max(per_second);
        }
    }

    /// Whether so much was learned about the shutter since the last keyframe that the mapper is to hear of it: with the next keyframe it measures the others
    /// again.
    pub(super) fn knows_shutter_better(&self) -> bool {
        let learned = self.front_end.timing().readout - self.since_keyframe.readout;
        learned.abs() * self.fastest_keyframe >= LEARNED_PX
    }

    /// The keyframe that waited for the frame `next`, whatever became of that.
    pub(super) fn release_first_keyframe(&mut self, next: FrameId) -> Option<NewKeyframe> {
        let own = self.map.keyframe_id(next);
        self.first_keyframe.take_if(|k| k.id != own)
    }
}
