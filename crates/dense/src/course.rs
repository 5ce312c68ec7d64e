//! Which version of the map a run uses, and how frames hang on its keyframes.

use crate::kept::Anchor;
use std::collections::VecDeque;
use std::sync::Arc;
use stillpoint_geometry::Se3;
use stillpoint_imaging::FrameId;
use stillpoint_map::{KeyframeId, MapView};
use stillpoint_slam::FrameReport;

/// Follows a run: of the map it uses the version that each frame's own tracking used.
#[derive(Default)]
pub(crate) struct Course {
    /// Ids that the map had before the first frame.
    first_keyframe: u32,
    /// Versions of the map that tracking does not use yet.
    coming: VecDeque<Arc<MapView>>,
    /// The version that tracking used last.
    view: Option<Arc<MapView>>,
    last_keyframe: Option<(KeyframeId, Se3)>,
}

impl Course {
    /// Of a run that begins with a map of so many keyframe ids.
    pub(crate) fn begin_with(&mut self, ids: usize) {
        self.first_keyframe = u32::try_from(ids).unwrap_or(u32::MAX);
    }

    /// A version that tracking will use.
    pub(crate) fn expect(&mut self, view: &Arc<MapView>) {
        self.coming.push_back(Arc::clone(view));
    }

    /// Takes the version that tracking used for a frame, and notes the frame where it became a keyframe. Says whether the version is another one than
    /// before.
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

    /// The version in use.
    pub(crate) fn view(&self) -> Option<&MapView> {
        self.view.as_deref()
    }

    fn keyframe(&self, frame: FrameId) -> KeyframeId {
        KeyframeId(frame.0.saturating_add(self.first_keyframe))
    }

    /// What a frame that was tracked at `online` hangs on.
    pub(crate) fn anchor(&self, report: &FrameReport, online: Se3) -> Anchor {
        let reference = self.last_keyframe.map(|(id, tracked)| {
            // Relative to where the map has it by now, as tracking did.
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
