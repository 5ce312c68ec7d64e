//! A tracker that runs backwards over frames already tracked, from one at which it was known which surfaces move.
//!
//! Frames come newest first, with stamps mirrored at that frame's.

use super::Tracker;
use super::motion::CameraMotion;
use super::state::{LastFrame, State};
use crate::anchored_pose::AnchoredPose;
use crate::static_filter::StaticFilter;
use crate::trajectory::TrajectoryEntry;
use std::sync::Arc;
use stillpoint_geometry::Se3;
use stillpoint_imaging::{FrameId, RgbdFrame};
use stillpoint_map::{KeyframeData, KeyframeId, LandmarkId, MapView, SubmapId};

/// State of the tracker at a keyframe from which to track backwards.
pub(crate) struct TurningPoint {
    pub(crate) keyframe: KeyframeId,
    pub(crate) frame: FrameId,
    /// s.
    pub(crate) stamp: f64,
    pub(crate) submap: Option<SubmapId>,
    filter: StaticFilter,
    motion: CameraMotion,
    data: Arc<KeyframeData>,
    matches: Vec<Option<LandmarkId>>,
}

impl Tracker {
    /// Whether retracing applies: the filter learns in time which surfaces move, and the map is not read-only.
    pub(crate) fn learns_who_moves(&self) -> bool {
        self.filter.learns_who_moves() && self.map.grows
    }

    pub(crate) fn want_keyframe(&mut self) {
        self.keyframes.wanted = true;
    }

    /// State at the last frame; `None` if it has no pose or did not become a keyframe.
    pub(crate) fn turning_point(&self) -> Option<TurningPoint> {
        let State::Tracking { last, motion } = &self.state else {
            return None;
        };
        Some(TurningPoint {
            keyframe: last.pose.keyframe?,
            frame: self.trajectory.entries().last()?.frame,
            stamp: last.stamp,
            submap: self.beginning.submap,
            filter: self.filter.clone(),
            motion: *motion,
            data: Arc::clone(&last.data),
            matches: last.matches.clone(),
        })
    }

    /// A tracker for the frames before a turning point, in a map that holds its keyframe, with this tracker's shutter
    /// estimate and the filter state of the turning point. `image` is that of the turning point. `None` if the map does
    /// not hold the keyframe.
    pub(crate) fn mirrored(
        &self,
        point: &TurningPoint,
        image: &Arc<RgbdFrame>,
        view: Arc<MapView>,
    ) -> Option<Self> {
        // Mirrored like all frames of the backward pass.
        let image = &Arc::new(RgbdFrame {
            id: FrameId(0),
            depth_stamp: 2.0 * point.stamp - image.depth_stamp,
            ..RgbdFrame::clone(image)
        });
        let world_from_camera = view.world_from_keyframe(point.keyframe)?;
        let camera = self.front_end.observer.camera;
        let mut mirrored =
            Self::new(self.setup.clone(), camera, self.front_end.simd).in_map(view, true);
        mirrored.front_end = self
            .front_end
            .mirrored(&self.setup, point.stamp, self.front_end.simd);
        mirrored.front_end.clock.take(image);
        // Flow of the next frame refers to this image.
        mirrored.front_end.observe(image);
        let pose = AnchoredPose {
            keyframe: Some(point.keyframe),
            reference: point.keyframe,
            reference_from_camera: Se3::identity(),
            online_world_from_camera: world_from_camera,
        };
        mirrored.filter = point.filter.mirrored(FrameId(0), point.stamp, pose);
        mirrored.state = State::Tracking {
            last: LastFrame {
                stamp: point.stamp,
                time: mirrored.front_end.clock.times(image).colour,
                data: Arc::clone(&point.data),
                matches: point.matches.clone(),
                pose,
                world_from_camera,
            },
            motion: point.motion.reversed(),
        };
        // Much of the first frames was not seen later: the beginning counts as undecided here as well.
        mirrored.beginning.stamp = point.stamp;
        mirrored.sensors.inertial = self
            .sensors
            .inertial
            .as_ref()
            .map(|i| i.mirrored(point.stamp));
        mirrored.sensors.odometry = self
            .sensors
            .odometry
            .as_ref()
            .map(|o| o.mirrored(point.stamp));
        mirrored.beginning.submap = point.submap;
        mirrored.images.previous = Some(Arc::clone(image));
        mirrored.goes_back = true;
        Some(mirrored)
    }

    /// Id of the keyframe that a frame of this run may have become.
    pub(crate) fn keyframe_id(&self, frame: FrameId) -> KeyframeId {
        self.map.keyframe_id(frame)
    }

    pub(crate) fn repose(&mut self, first: FrameId, last: FrameId, entries: Vec<TrajectoryEntry>) {
        self.trajectory.replace(first, last, entries);
    }
}
