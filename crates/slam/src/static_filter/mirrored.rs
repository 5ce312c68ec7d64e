//! The filter for tracking backwards in time.

use super::{Preset, StaticFilter, Unused};
use crate::anchored_pose::AnchoredPose;
use std::sync::Arc;
use stillpoint_imaging::FrameId;

impl StaticFilter {
    /// The filter for frames whose stamps run backwards from `stamp`. Keeps which surfaces of the last frame move; that
    /// frame is relabelled `frame`, taken at `pose`.
    pub(crate) fn mirrored(&self, frame: FrameId, stamp: f64, pose: AnchoredPose) -> Self {
        let mut mirrored = self.clone();
        mirrored.objects.forget();
        mirrored.waiting = None;
        mirrored.movers = Arc::default();
        mirrored.present = None;
        mirrored.unused = Unused::default();
        mirrored.surfaces = Arc::new(self.surfaces.mirrored(stamp));
        mirrored.history = self.history.only_last(frame, stamp, pose);
        mirrored
    }

    /// Whether the preset detects motion per surface, so that it learns in time which surfaces move.
    pub(crate) fn learns_who_moves(&self) -> bool {
        self.rules.config.preset == Preset::Default
    }
}
