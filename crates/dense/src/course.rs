//! Tracks the map version that each frame used, and the frames' anchors to keyframes.

use crate::kept::Anchor;
use std::collections::VecDeque;
use std::sync::Arc;
use stillpoint_geometry::Se3;
use stillpoint_imaging::FrameId;
use stillpoint_map::{KeyframeId, MapView};
use stillpoint_slam::FrameReport;

/// Follows a run: uses the map version with which each frame was tracked.
#[derive(Default)]
pub(crate) struct Course {
    /// Number of keyframe ids before the first frame.
    first_keyframe: u32,
    /// Map versions that tracking does not use yet.
    coming: VecDeque<Arc<MapView>>,
    view: Option<Arc<MapView>>,
    last_keyframe: Option<(KeyframeId, Se3)>,
}

impl Course {
    pub(crate) fn begin_with(&mut self, ids: usize) {
        self.first_keyframe = u32::try_from(ids).unwrap_or(u32::MAX);
    }

    pub(crate) fn expect(&mut self, view: &Arc<MapView>) {
        self.coming.push_back(Arc::clone(view));
    }

    /// Switches to the version with which a frame was tracked, and records the frame if it became a keyframe. Returns whether the version
    /// changed.
    pub(crate) fn follow(&mut self, report: &FrameReport) -> bool {
        let before = self.view.as_ref().map(|v| v.version());
        let version = report.map_version;
        while let Some(view) = self.coming.pop_front_if(|v| v.version() <= version) {
            self.view = Some(view);
        }
        if let (true, Some(pose)) = (report.is_keyframe, report.world_from_camera) {
            self.last_keyframe = Some((self.keyframe(report.frame), pose));
        }
        self.view.as_ref().map(|v| v.version()) != before
    }

    pub(crate) fn view(&self) -> Option<&MapView> {
        self.view.as_deref()
    }

    fn keyframe(&self, frame: FrameId) -> KeyframeId {
        KeyframeId(frame.0.saturating_add(self.first_keyframe))
    }

    /// The anchor of a frame tracked at `online`.
    pub(crate) fn anchor(&self, report: &FrameReport, online: Se3) -> Anchor {
        let reference = self.last_keyframe.map(|(id, tracked)| {
            // Relative to the keyframe's current pose in the map, as in tracking.
            let known = self.view.as_ref().and_then(|v| v.world_from_keyframe(id));
            (id, known.unwrap_or(tracked).inverse() * online)
        });
        Anchor {
            own: report.is_keyframe.then(|| self.keyframe(report.frame)),
            reference,
            online,
            submap: report.submap,
        }
    }
}
