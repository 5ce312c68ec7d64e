//! Messages to the tracker between frames, and its queries.

use super::Tracker;
use crate::messages::MapperMsg;
use crate::timing::Timing;
use crate::trajectory::Trajectory;
use std::sync::Arc;
use stillpoint_detection::Detections;
use stillpoint_imaging::FrameId;
use stillpoint_map::{KeyframeId, MapView};
use stillpoint_place::PlaceIndex;

impl Tracker {
    /// Takes detections of the next frame `next`, or late ones. Returns the message to the mapper about an earlier
    /// keyframe, if any; `None` in a read-only map.
    pub fn receive_detections(
        &mut self,
        detections: Detections,
        next: FrameId,
    ) -> Option<MapperMsg> {
        if detections.frame >= next {
            self.filter.receive(detections);
            return None;
        }
        let id = self.map.keyframe_id(detections.frame);
        let known = self.map.view.keyframe(id).map(|k| &k.data);
        let waiting = self.keyframes.first.as_ref().filter(|k| k.id == id);
        let data = known.or(waiting.map(|k| &k.data)).map(Arc::clone);
        let rejudged = self.filter.take_late(&detections, &self.map.view, data)?;
        if let Some(waiting) = self.keyframes.first.as_mut().filter(|k| k.id == id) {
            waiting.keep_out(&rejudged.features);
            return None;
        }
        self.map.grows.then(|| MapperMsg::Rejudge {
            keyframe: self.map.keyframe_id(rejudged.frame),
            features: rejudged.features,
        })
    }

    /// Number of keypoints requested from the last image, which grows when few match the map.
    #[must_use]
    pub fn features(&self) -> u32 {
        self.front_end.asked() as u32
    }

    /// Sets the usual number of keypoints per image, limited to the configured number and the minimum of a
    /// configuration.
    pub fn set_features(&mut self, features: u32) {
        let most = self.setup.features.features;
        let wanted = (features as usize).clamp(100.min(most), most);
        self.front_end.want(wanted);
    }

    /// Takes a newer view of the map.
    pub fn receive(&mut self, view: Arc<MapView>) {
        self.map.view = view;
        let reference = self.state.last().map(|l| l.pose.reference);
        let submap = reference.and_then(|r| self.map.view.submap_of(r));
        if let Some(id) = submap.filter(|id| self.beginning.submap != Some(*id)) {
            // The submap was joined to another: the filter's history refers to a reference frame that no longer exists.
            self.filter.forget();
            self.beginning.submap = Some(id);
            self.forget_world();
        }
    }

    /// Takes a newer place index.
    pub fn receive_places(&mut self, index: PlaceIndex<KeyframeId>) {
        self.map.places.index = index;
    }

    /// All tracked frames.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        &self.trajectory
    }

    /// Keeps only the newest `most` frames of the trajectory, for endless runs. Their poses are unaffected; dropped
    /// first frames are not tracked again.
    pub fn forget_frames_but(&mut self, most: usize) {
        self.trajectory.keep_newest(most);
    }

    /// Estimated exposure timing.
    #[must_use]
    pub fn timing(&self) -> Timing {
        self.front_end.timing()
    }

    /// The map view in use.
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        Arc::clone(&self.map.view)
    }

    /// After the clock was set back, drops the velocity and shifts or drops stored stamps.
    pub(super) fn handle_clock(&mut self, stamp: f64) {
        let before = self.images.previous.as_ref().map(|f| f.stamp);
        if let Some(before) = before.filter(|before| stamp <= *before) {
            self.filter.forget_times();
            self.state.set_clock(stamp - before);
            self.beginning.stamp += stamp - before;
            self.forget_motions();
            if let Some(inertial) = &mut self.sensors.inertial {
                inertial.forget_times();
            }
            if let Some(odometry) = &mut self.sensors.odometry {
                odometry.forget_times();
            }
        }
    }
}
