//! What the tracker hears between frames: detections, views of the map, how much to do, and that a clock was set back.

use super::Tracker;
use crate::messages::MapperMsg;
use std::sync::Arc;
use stillpoint_detection::Detections;
use stillpoint_imaging::FrameId;
use stillpoint_map::{KeyframeId, MapView};

impl Tracker {
    /// Takes detections of the frame `next` to come, or late ones. Returns what the mapper is to be told of an earlier keyframe;
    /// nothing in a map that is only read.
    pub fn receive_detections(
        &mut self,
        detections: Detections,
        next: FrameId,
    ) -> Option<MapperMsg> {
        if detections.frame >= next {
            self.filter.receive(detections);
            return None;
        }
        let keyframe = self.view.keyframe(self.keyframe_id(detections.frame));
        let data = keyframe.map(|k| Arc::clone(&k.data));
        let rejudged = self.filter.take_late(&detections, &self.view, data)?;
        self.grows.then(|| MapperMsg::Rejudge {
            keyframe: self.keyframe_id(rejudged.frame),
            features: rejudged.features,
        })
    }

    /// The id of the keyframe that a frame of this run may become.
    pub(super) fn keyframe_id(&self, frame: FrameId) -> KeyframeId {
        KeyframeId(self.first_keyframe.saturating_add(frame.0))
    }

    /// Keypoints that the last image was asked for: as many as are wanted, and more where few of the image before held on to the map.
    #[must_use]
    pub fn features(&self) -> u32 {
        self.observer.extractor.wanted() as u32
    }

    /// From now on so many keypoints are wanted per image: what is configured at most, and what a configuration may say at least.
    pub fn set_features(&mut self, features: u32) {
        let most = self.config.features.features;
        self.demand
            .set((features as usize).clamp(100.min(most), most));
    }

    /// Takes a newer view of the map.
    pub fn receive(&mut self, view: Arc<MapView>) {
        self.view = view;
        let reference = self.last.as_ref().map(|l| l.reference);
        let piece = reference.and_then(|r| self.view.piece_of(r));
        if piece.is_some() && piece != self.piece {
            // The piece became part of another: what moves was seen in a frame of reference that is no more.
            self.filter.forget();
            (self.piece, self.young) = (piece, None);
        }
    }

    /// After a clock was set back nothing is known of the time since the frame before: there is no velocity, and what is known
    /// of earlier stamps is brought to the new time, or forgotten where that cannot be done.
    pub(super) fn heed_clock(&mut self, stamp: f64) {
        let Some(before) = self.previous.as_ref().map(|f| f.stamp) else {
            return;
        };
        if stamp > before {
            return;
        }
        self.motion.forget();
        self.filter.forget_times();
        if let Some(last) = &mut self.last {
            last.stamp += stamp - before;
        }
    }
}
