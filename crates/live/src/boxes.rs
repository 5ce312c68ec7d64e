//! What each stage can be told, and in which order it takes it.

use crate::detection::DetectionBox;
use crate::health::{Newest, Pulse};
use crate::mailbox::Mailbox;
use crate::measure::Stage;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;
use stillpoint_detection::{DetectError, Detections};
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::{Correction, KeyframeId, MapView};
use stillpoint_place::PlaceIndex;
use stillpoint_slam::{LooperMsg, MapperMsg};

/// Messages that wait for one stage, at most; then whoever has another one waits. More than a stage that keeps up ever sees,
/// and little enough for a machine's memory.
pub(crate) const QUEUE: usize = 64;

/// The inboxes of all stages.
#[derive(Default)]
pub(crate) struct Boxes {
    pub(crate) tracking: Mailbox<TrackingBox>,
    pub(crate) detection: Mailbox<DetectionBox<Arrived>>,
    pub(crate) mapping: Mailbox<MappingBox>,
    pub(crate) looping: Mailbox<LoopingBox>,
    /// What each thread is at, in the order of [`Stage::ALL`].
    pulses: [Mailbox<Pulse>; 4],
    pub(crate) newest: Mailbox<Option<Newest>>,
}

impl Boxes {
    /// What a stage's thread is at.
    pub(crate) fn pulse(&self, stage: Stage) -> &Mailbox<Pulse> {
        &self.pulses[stage as usize]
    }

    /// Notes that a stage's thread took a message.
    pub(crate) fn begins(&self, stage: Stage) {
        self.pulse(stage)
            .put(|p| *p = Pulse::Working(Instant::now()));
    }

    /// Notes that it is done with it.
    pub(crate) fn rests(&self, stage: Stage) {
        self.pulse(stage).put(|p| *p = Pulse::Waiting);
    }
}

/// A frame, and when it arrived.
#[derive(Clone)]
pub(crate) struct Arrived {
    pub(crate) frame: Arc<RgbdFrame>,
    pub(crate) at: Instant,
}

/// A view of the map on its way to tracking.
pub(crate) struct Published {
    /// The mapper's answer that brought it, counted from 0.
    pub(crate) answer: u64,
    pub(crate) view: Arc<MapView>,
    pub(crate) at: Instant,
    /// Keyframes that the mapper had taken.
    pub(crate) keyframes: u64,
}

/// What a detector said, and when its frame had arrived.
pub(crate) struct Said {
    pub(crate) answer: Result<Detections, DetectError>,
    pub(crate) arrived: Instant,
}

/// What tracking is told.
#[derive(Default)]
pub(crate) struct TrackingBox {
    pub(crate) frame: Option<Arrived>,
    /// Whether frames were dropped since the last one that was taken.
    pub(crate) dropped: bool,
    pub(crate) view: Option<Published>,
    pub(crate) places: Option<(u64, PlaceIndex<KeyframeId>)>,
    pub(crate) said: VecDeque<Said>,
}

/// All that tracking takes with a frame.
pub(crate) struct TrackingWork {
    pub(crate) arrived: Arrived,
    pub(crate) news: TrackingBox,
}

impl TrackingBox {
    /// Everything, once there is a frame.
    pub(crate) fn next(&mut self) -> Option<TrackingWork> {
        let arrived = self.frame.take()?;
        let news = std::mem::take(self);
        Some(TrackingWork { arrived, news })
    }
}

/// What mapping is told.
#[derive(Default)]
pub(crate) struct MappingBox {
    pub(crate) queue: VecDeque<MapperMsg>,
    pub(crate) corrections: VecDeque<Correction>,
    pub(crate) tracking_is_over: bool,
    looping_was_told: bool,
    pub(crate) looping_is_over: bool,
}

pub(crate) enum MappingWork {
    Message(MapperMsg),
    /// Tracking has no more keyframes: looping is to hear of that.
    TrackingIsOver,
    /// Nobody has anything more.
    Over,
}

impl MappingBox {
    /// A correction first: what comes after it is built on a better map.
    pub(crate) fn next(&mut self) -> Option<MappingWork> {
        if let Some(correction) = self.corrections.pop_front() {
            return Some(MappingWork::Message(MapperMsg::Correct(correction)));
        }
        if let Some(message) = self.queue.pop_front() {
            return Some(MappingWork::Message(message));
        }
        if !self.tracking_is_over {
            return None;
        }
        if !self.looping_was_told {
            self.looping_was_told = true;
            return Some(MappingWork::TrackingIsOver);
        }
        self.looping_is_over.then_some(MappingWork::Over)
    }
}

/// What looping is told.
#[derive(Default)]
pub(crate) struct LoopingBox {
    pub(crate) queue: VecDeque<LooperMsg>,
    pub(crate) mapping_is_over: bool,
}

pub(crate) enum LoopingWork {
    Message(LooperMsg),
    Over,
}

impl LoopingBox {
    pub(crate) fn next(&mut self) -> Option<LoopingWork> {
        let message = self.queue.pop_front().map(LoopingWork::Message);
        message.or_else(|| self.mapping_is_over.then_some(LoopingWork::Over))
    }
}
