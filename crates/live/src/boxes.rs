//! The contents of each stage's inbox, and the order in which they are taken.

use crate::audience::Audience;
use crate::health::{Newest, Pulse};
use crate::mailbox::Mailbox;
use crate::measure::Stage;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};
use stillpoint_detection::{DetectError, Detections};
use stillpoint_imaging::{FrameId, ImuSample, OdometrySample, RgbdFrame};
use stillpoint_map::{Correction, KeyframeId, Map, MapView};
use stillpoint_place::PlaceIndex;
use stillpoint_slam::{LoopCloserMsg, Loops, MapperMsg, Trajectory, TrajectoryEntry};

/// Maximum number of messages queued for one stage; beyond it, the sender waits. A stage that keeps up never reaches it, and they fit into
/// memory.
pub(crate) const QUEUE: usize = 64;
/// Maximum number of inertial samples queued for tracking: eight seconds at 4 kHz.
pub(crate) const SAMPLES: usize = 32_768;
/// Maximum pause of the detector.
const LONGEST_REST: Duration = Duration::from_secs(1);

#[derive(Default)]
pub(crate) struct Boxes {
    pub(crate) tracking: Mailbox<TrackingBox>,
    pub(crate) detection: Mailbox<DetectionBox<Arrived>>,
    pub(crate) mapping: Mailbox<MappingBox>,
    pub(crate) looping: Mailbox<LoopingBox>,
    /// State of each thread, in the order of [`Stage::ALL`].
    pulses: [Mailbox<Pulse>; 4],
    pub(crate) newest: Mailbox<Option<Newest>>,
    pub(crate) view: Mailbox<Arc<MapView>>,
    /// All loop candidates up to now.
    pub(crate) loops: Mailbox<Loops>,
    /// Frames tracked since the last request for the trajectory. The list is short, so that tracking never waits for a long copy.
    pub(crate) tracked: Mailbox<NewEntries>,
    /// The trajectory up to the last request. The requesting thread first moves the frames of `tracked` here.
    trajectory: Mailbox<Trajectory>,
    pub(crate) frames: AtomicU64,
    pub(crate) dropped: AtomicU64,
    pub(crate) audience: Audience,
}

/// State of the trajectory when it was last passed on.
#[derive(Default)]
pub(crate) struct PassedOn {
    entries: usize,
    revision: u64,
}

impl PassedOn {
    /// Marks all of it as passed on.
    pub(crate) fn of(trajectory: &Trajectory) -> Self {
        Self {
            entries: trajectory.entries().len(),
            revision: trajectory.revision(),
        }
    }
}

#[derive(Default)]
pub(crate) struct NewEntries {
    anew: bool,
    entries: Vec<TrajectoryEntry>,
}

impl NewEntries {
    /// Takes the entries added to a trajectory, or all of them if it was rewritten.
    pub(crate) fn take(&mut self, before: &PassedOn, trajectory: &Trajectory) {
        let entries = trajectory.entries();
        if trajectory.revision() == before.revision {
            self.entries.extend_from_slice(&entries[before.entries..]);
        } else {
            self.anew = true;
            self.entries = entries.to_vec();
        }
    }
}

impl Boxes {
    pub(crate) fn pulse(&self, stage: Stage) -> &Mailbox<Pulse> {
        &self.pulses[stage as usize]
    }

    pub(crate) fn trajectory(&self) -> Trajectory {
        self.trajectory.change(|known| {
            let new = self.tracked.change(std::mem::take);
            if new.anew {
                *known = Trajectory::default();
            }
            known.extend(new.entries);
            known.clone()
        })
    }

    /// A copy of the current map, made between two messages of mapping; `None` after mapping has ended.
    pub(crate) fn map(&self) -> Option<Map> {
        const NAP: Duration = Duration::from_millis(50);
        let (sender, map) = sync_channel(1);
        self.mapping.put(|b| b.copies.push_back(sender))?;
        loop {
            match map.recv_timeout(NAP) {
                Ok(map) => return Some(map),
                // A panicked thread does not answer.
                Err(RecvTimeoutError::Timeout) if self.mapping.is_closed() => {
                    return map.try_recv().ok();
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return None,
            }
        }
    }

    /// Marks a stage's thread as working on a message.
    pub(crate) fn begins(&self, stage: Stage) {
        self.pulse(stage)
            .put(|p| *p = Pulse::Working(Instant::now()));
    }

    pub(crate) fn rests(&self, stage: Stage) {
        self.pulse(stage).put(|p| *p = Pulse::Waiting);
    }
}

#[derive(Clone)]
pub(crate) struct Arrived {
    pub(crate) frame: Arc<RgbdFrame>,
    pub(crate) at: Instant,
}

pub(crate) struct Published {
    /// Index of the mapper's answer that published it.
    pub(crate) answer: u64,
    pub(crate) view: Arc<MapView>,
    pub(crate) at: Instant,
    /// Number of keyframes that the mapper had taken.
    pub(crate) keyframes: u64,
}

/// A detector answer with its frame and the frame's arrival time.
pub(crate) struct Said {
    pub(crate) frame: FrameId,
    pub(crate) answer: Result<Detections, DetectError>,
    pub(crate) arrived: Instant,
}

#[derive(Default)]
pub(crate) struct TrackingBox {
    pub(crate) frame: Option<Arrived>,
    /// Whether frames were dropped since the last one taken.
    pub(crate) dropped: bool,
    pub(crate) view: Option<Published>,
    pub(crate) places: Option<(u64, PlaceIndex<KeyframeId>)>,
    pub(crate) said: VecDeque<Said>,
    pub(crate) inertial: Vec<ImuSample>,
    pub(crate) odometry: Vec<OdometrySample>,
}

/// All inputs of tracking for a frame.
pub(crate) struct TrackingWork {
    pub(crate) arrived: Arrived,
    pub(crate) news: TrackingBox,
}

impl TrackingBox {
    /// Takes everything, once there is a frame.
    pub(crate) fn next(&mut self) -> Option<TrackingWork> {
        let arrived = self.frame.take()?;
        let news = std::mem::take(self);
        Some(TrackingWork { arrived, news })
    }
}

/// The newest frame for the detector, and the time of its last work.
pub(crate) struct DetectionBox<T> {
    shown: Option<T>,
    /// Reciprocal of the detector's share of the time.
    rarer: u64,
    /// When it last finished, and its working time.
    last: Option<(Instant, Duration)>,
}

impl<T> Default for DetectionBox<T> {
    fn default() -> Self {
        Self {
            shown: None,
            rarer: 1,
            last: None,
        }
    }
}

impl<T> DetectionBox<T> {
    /// Offers the newest frame, with the reciprocal of the detector's share of the time.
    pub(crate) fn show(&mut self, frame: T, rarer: u64) {
        self.shown = Some(frame);
        self.rarer = rarer;
    }

    /// Records when the detector finished a frame, and its working time.
    pub(crate) fn done(&mut self, at: Instant, worked: Duration) {
        self.last = Some((at, worked));
    }

    /// The newest frame, unless the detector must pause: then the frame stays, and may be replaced by newer ones.
    pub(crate) fn next(&mut self, now: Instant) -> Option<T> {
        let rests = self.last.is_some_and(|(at, worked)| {
            let times = u32::try_from(self.rarer.saturating_sub(1)).unwrap_or(u32::MAX);
            now.saturating_duration_since(at) < worked.saturating_mul(times).min(LONGEST_REST)
        });
        if rests { None } else { self.shown.take() }
    }
}

#[derive(Default)]
pub(crate) struct MappingBox {
    pub(crate) queue: VecDeque<MapperMsg>,
    pub(crate) corrections: VecDeque<Correction>,
    /// Requests for a copy of the map.
    pub(crate) copies: VecDeque<SyncSender<Map>>,
    pub(crate) tracking_is_over: bool,
    looping_was_notified: bool,
    pub(crate) looping_is_over: bool,
}

pub(crate) enum MappingWork {
    Message(MapperMsg),
    /// A request for a copy of the map; not logged, as it changes nothing.
    Copy(SyncSender<Map>),
    /// Tracking has no more keyframes: looping must be informed.
    TrackingIsOver,
    /// No sender remains.
    Over,
}

impl MappingBox {
    /// Copies first, since callers wait for them; then corrections, so that later work uses a better map.
    pub(crate) fn next(&mut self) -> Option<MappingWork> {
        if let Some(to) = self.copies.pop_front() {
            return Some(MappingWork::Copy(to));
        }
        if let Some(correction) = self.corrections.pop_front() {
            return Some(MappingWork::Message(MapperMsg::Correct(correction)));
        }
        if let Some(message) = self.queue.pop_front() {
            return Some(MappingWork::Message(message));
        }
        if !self.tracking_is_over {
            return None;
        }
        if !self.looping_was_notified {
            self.looping_was_notified = true;
            return Some(MappingWork::TrackingIsOver);
        }
        self.looping_is_over.then_some(MappingWork::Over)
    }
}

#[derive(Default)]
pub(crate) struct LoopingBox {
    pub(crate) queue: VecDeque<LoopCloserMsg>,
    pub(crate) mapping_is_over: bool,
}

pub(crate) enum LoopingWork {
    Message(LoopCloserMsg),
    Over,
}

impl LoopingBox {
    pub(crate) fn next(&mut self) -> Option<LoopingWork> {
        let message = self.queue.pop_front().map(LoopingWork::Message);
        message.or_else(|| self.mapping_is_over.then_some(LoopingWork::Over))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn detector_rests_for_its_backoff_time() {
        let start = Instant::now();
        let mut shown = DetectionBox::default();
        // The first frame need not wait, nor does any with enough time.
        shown.show(1, 8);
        assert_eq!(shown.next(start), Some(1));
        shown.done(start, 50 * MS);
        shown.show(2, 1);
        assert_eq!(shown.next(start), Some(2));
        shown.done(start, 50 * MS);
        // It pauses for three quarters of the time, then takes the newest frame.
        for (frame, after) in [(3, 10), (4, 149)] {
            shown.show(frame, 4);
            assert_eq!(shown.next(start + after * MS), None);
        }
        assert_eq!(shown.next(start + 150 * MS), Some(4));
        assert_eq!(shown.next(start + 150 * MS), None);
        // The pause is limited.
        shown.done(start, 3000 * MS);
        shown.show(5, 16);
        assert_eq!(shown.next(start + 999 * MS), None);
        assert_eq!(shown.next(start + 1000 * MS), Some(5));
    }
}
