//! The first frames of a map, kept until it is known which surfaces move.

use crate::messages::Tracked;
use crate::tracking::{SOME_MOVE, TurningPoint};
use std::collections::BTreeMap;
use std::sync::Arc;
use stillpoint_detection::Detections;
use stillpoint_imaging::{FrameId, RgbdFrame};
use stillpoint_map::MapView;

/// Time without motion after the start of a map from which the scene counts as static, s: chosen on the recordings of
/// decision 25; starts 80 and 90 of fr1_rpy_walkers are rightly decided by it.
const QUIET: f64 = 0.8;
/// Time after the start of a map from which motion is detectable, s: depths are compared with those of 0.2 s before,
/// and three frames of 30 Hz come to it.
const SEEN: f64 = 0.3;

/// Maximum memory of kept frames, bytes: 174 of 640x480, at five bytes per pixel. Larger or faster cameras go without.
/// Chosen: the three seconds of `MOST` at 58 Hz.
const ROOM: usize = 256 << 20;

/// The frames since a map was started.
pub(super) struct Beginning {
    begun: f64,
    newest: f64,
    /// Largest share of moving keypoints in a frame.
    moved: f64,
    /// Frames before the turning point, without colour.
    frames: Vec<RgbdFrame>,
    /// Their size, bytes.
    taken: usize,
    detections: BTreeMap<FrameId, Detections>,
    /// The frame from which to track backwards, once it is known which surfaces move.
    turn: Option<(TurningPoint, Arc<RgbdFrame>)>,
}

pub(super) struct Kept {
    pub(super) frames: Vec<RgbdFrame>,
    pub(super) detections: BTreeMap<FrameId, Detections>,
    pub(super) point: TurningPoint,
    pub(super) image: Arc<RgbdFrame>,
}

impl Beginning {
    pub(super) fn at(begun: f64) -> Self {
        Self {
            begun,
            newest: f64::NEG_INFINITY,
            moved: 0.0,
            frames: Vec::new(),
            taken: 0,
            detections: BTreeMap::new(),
            turn: None,
        }
    }

    /// Adds a frame. Returns the time since the start of the map, s; `None` if the clock was set back.
    pub(super) fn take(&mut self, frame: &RgbdFrame, tracked: &Tracked) -> Option<f64> {
        if frame.stamp <= self.newest {
            return None;
        }
        self.newest = frame.stamp;
        let since = frame.stamp - self.begun;
        if self.turn.is_none() {
            if since >= SEEN {
                self.moved = self.moved.max(tracked.report.counts.moving_share());
            }
            self.taken += frame.gray.data().len() + 4 * frame.depth.data().len();
            self.frames.push(RgbdFrame {
                id: frame.id,
                stamp: frame.stamp,
                depth_stamp: frame.depth_stamp,
                gray: frame.gray.clone(),
                colour: None,
                depth: frame.depth.clone(),
            });
        }
        Some(since)
    }

    pub(super) fn receive(&mut self, detections: &Detections) {
        if self.turn.is_none() {
            self.detections.insert(detections.frame, detections.clone());
        }
    }

    /// Whether the scene counts as static, `since` seconds after the start.
    pub(super) fn is_quiet(&self, since: f64) -> bool {
        self.turn.is_none() && since >= QUIET && self.moved < SOME_MOVE
    }

    pub(super) fn is_too_large(&self) -> bool {
        self.taken > ROOM
    }

    pub(super) fn is_known(&self) -> bool {
        self.turn.is_some()
    }

    /// Makes the last frame the turning point.
    pub(super) fn turn_at(&mut self, point: TurningPoint, frame: &Arc<RgbdFrame>) {
        self.frames.pop();
        self.turn = Some((point, Arc::clone(frame)));
    }

    /// Whether a version of the map contains the turning point.
    pub(super) fn is_mapped(&self, view: &MapView) -> bool {
        let turn = self.turn.as_ref();
        turn.is_some_and(|(point, _)| point.keyframe.index() < view.keyframe_bound())
    }

    pub(super) fn into_kept(self) -> Option<Kept> {
        let (point, image) = self.turn?;
        Some(Kept {
            frames: self.frames,
            detections: self.detections,
            point,
            image,
        })
    }
}
