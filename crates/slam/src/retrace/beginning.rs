//! The first frames of a map, kept until it is known who moves.

use crate::messages::Tracked;
use crate::tracking::{SOME_MOVE, TurningPoint};
use std::collections::BTreeMap;
use std::sync::Arc;
use stillpoint_detection::Detections;
use stillpoint_imaging::{FrameId, RgbdFrame};
use stillpoint_map::MapView;

/// If nothing has moved for this time after the start of a map, the scene is taken as static, s: chosen on the recordings of decision 25; starts 80
/// and 90 of fr1_rpy_walkers are rightly decided by it.
const QUIET: f64 = 0.8;
/// Motion can be seen from this time after the start of a map, s: depths are compared with those of 0.2 s before, and three frames of 30 Hz come to
/// it.
const SEEN: f64 = 0.3;

/// Frames are kept up to this, bytes: 174 of 640x480, at five bytes per pixel. Larger or faster cameras go without. Chosen: the three seconds of
/// `MOST` at 58 Hz.
const ROOM: usize = 256 << 20;

/// The frames since a map was begun.
pub(super) struct Beginning {
    /// When it was, s.
    begun: f64,
    /// The newest frame's stamp, s.
    newest: f64,
    /// The greatest share of keypoints that moved in a frame.
    moved: f64,
    /// Frames before the turning point, without colour.
    frames: Vec<RgbdFrame>,
    /// What they take, bytes.
    taken: usize,
    detections: BTreeMap<FrameId, Detections>,
    /// From where one goes back, with its image, once it is known who moves.
    turn: Option<(TurningPoint, Arc<RgbdFrame>)>,
}

/// All that is needed to go back.
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

    /// Takes a frame. Returns the time since the map was begun, s; none when the clock was set back.
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

    /// Whether nothing moves, `since` seconds after the beginning.
    pub(super) fn is_quiet(&self, since: f64) -> bool {
        self.turn.is_none() && since >= QUIET && self.moved < SOME_MOVE
    }

    /// Whether the frames take more than they may.
    pub(super) fn is_too_large(&self) -> bool {
        self.taken > ROOM
    }

    /// Whether it is known who moves.
    pub(super) fn is_known(&self) -> bool {
        self.turn.is_some()
    }

    /// The frame that was taken last is where one turns back.
    pub(super) fn turn_at(&mut self, point: TurningPoint, frame: &Arc<RgbdFrame>) {
        self.frames.pop();
        self.turn = Some((point, Arc::clone(frame)));
    }

    /// Whether a version of the map is of after the turning point.
    pub(super) fn is_mapped(&self, view: &MapView) -> bool {
        let turn = self.turn.as_ref();
        turn.is_some_and(|(point, _)| point.keyframe.index() < view.keyframe_bound())
    }

    /// What is needed to go back from the turning point.
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
