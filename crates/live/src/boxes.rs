//! The content of each stage's inbox, and in which order it is taken.

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

/// Largest number of messages that wait for one stage; beyond it, the sender waits. A stage that keeps up never has so many,
/// and they fit into memory.
pub(crate) const QUEUE: usize = 64;
/// Samples of the inertial sensor that wait for tracking, at most: of eight seconds at 4 kHz.
pub(crate) const SAMPLES: usize = 32_768;
/// The detector rests no longer than this.
const LONGEST_REST: Duration = Duration::from_secs(1);

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
    /// The newest version of the map.
    pub(crate) view: Mailbox<Arc<MapView>>,
    /// All loop candidates so far.
    pub(crate) loops: Mailbox<Loops>,
    /// Frames tracked since the last request for the trajectory. The list is short, so that tracking does not wait for a long one.
    pub(crate) tracked: Mailbox<NewEntries>,
    /// The trajectory up to the last request. The requesting thread first moves the frames of `tracked` here.
    trajectory: Mailbox<Trajectory>,
    /// Frames that were tracked.
    pub(crate) frames: AtomicU64,
    /// Frames that were dropped.
    pub(crate) dropped: AtomicU64,
    pub(crate) audience: Audience,
}

/// What of a trajectory was passed on.
#[derive(Default)]
pub(crate) struct PassedOn {
    entries: usize,
    revision: u64,
}

impl PassedOn {
    /// All of it.
    pub(crate) fn of(trajectory: &Trajectory) -> Self {
        Self {
            entries: trajectory.entries().len(),
            revision: trajectory.revision(),
        }
    }
}

/// Entries of a trajectory that nobody has asked for yet.
#[derive(Default)]
pub(crate) struct NewEntries {
    /// Whether they take the place of all that were passed on before.
    anew: bool,
    entries: Vec<TrajectoryEntry>,
}

impl NewEntries {
    /// Takes what was added to a trajectory, or all of it where it was rewritten.
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
    /// What a stage's thread is at.
    pub(crate) fn pulse(&self, stage: Stage) -> &Mailbox<Pulse> {
        &self.pulses[stage as usize]
    }

    /// The frames tracked so far.
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

    /// The map as it is now, copied between two messages that mapping takes; none when mapping has ended.
    pub(crate) fn map(&self) -> Option<Map> {
        const NAP: Duration = Duration::from_millis(50);
        let (sender, map) = sync_channel(1);
        self.mapping.put(|b| b.copies.push_back(sender))?;
        loop {
            match map.recv_timeout(NAP) {
                Ok(map) => return Some(map),
                // A thread that panics answers no more.
                Err(RecvTimeoutError::Timeout) if self.mapping.is_closed() => {
                    return map.try_recv().ok();
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return None,
            }
        }
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

/// What a detector said, of which frame, and when that had arrived.
pub(crate) struct Said {
    pub(crate) frame: FrameId,
    pub(crate) answer: Result<Detections, DetectError>,
    pub(crate) arrived: Instant,
}

/// Inbox of tracking.
#[derive(Default)]
pub(crate) struct TrackingBox {
    pub(crate) frame: Option<Arrived>,
    /// Whether frames were dropped since the last one that was taken.
    pub(crate) dropped: bool,
    pub(crate) view: Option<Published>,
    pub(crate) places: Option<(u64, PlaceIndex<KeyframeId>)>,
    pub(crate) said: VecDeque<Said>,
    /// What the inertial sensor measured.
    pub(crate) inertial: Vec<ImuSample>,
    /// What the wheels did.
    pub(crate) odometry: Vec<OdometrySample>,
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

/// What detection is shown, and when it worked last.
pub(crate) struct DetectionBox<T> {
    shown: Option<T>,
    /// It may take one part in so many of the time; all of it with 1.
    rarer: u64,
    /// When it was done last, and how long it had worked.
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
    /// Shows the newest frame, of which the detector is to take one part in so many of the time.
    pub(crate) fn show(&mut self, frame: T, rarer: u64) {
        self.shown = Some(frame);
        self.rarer = rarer;
    }

    /// Takes note of when the detector was done with a frame, and how long it had worked.
    pub(crate) fn done(&mut self, at: Instant, worked: Duration) {
        self.last = Some((at, worked));
    }

    /// The newest frame, unless the detector is to rest still: then the frame is kept, and may give way to newer ones.
    pub(crate) fn next(&mut self, now: Instant) -> Option<T> {
        let rests = self.last.is_some_and(|(at, worked)| {
            let times = u32::try_from(self.rarer.saturating_sub(1)).unwrap_or(u32::MAX);
            now.saturating_duration_since(at) < worked.saturating_mul(times).min(LONGEST_REST)
        });
        if rests { None } else { self.shown.take() }
    }
}

/// Inbox of mapping.
#[derive(Default)]
pub(crate) struct MappingBox {
    pub(crate) queue: VecDeque<MapperMsg>,
    pub(crate) corrections: VecDeque<Correction>,
    /// Who wants a copy of the map.
    pub(crate) copies: VecDeque<SyncSender<Map>>,
    pub(crate) tracking_is_over: bool,
    looping_was_notified: bool,
    pub(crate) looping_is_over: bool,
}

pub(crate) enum MappingWork {
    Message(MapperMsg),
    /// Somebody wants a copy of the map. It changes nothing, and is in no log.
    Copy(SyncSender<Map>),
    /// Tracking has no more keyframes: looping is to learn that.
    TrackingIsOver,
    /// Nobody has anything more.
    Over,
}

impl MappingBox {
    /// Copies first, since somebody waits for them; then corrections: what comes after it is built on a better map.
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

/// Inbox of looping.
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
    fn a_detector_rests_for_the_time_it_is_given() {
        let start = Instant::now();
        let mut shown = DetectionBox::default();
        // The first frame need not wait, nor does any where there is time.
        shown.show(1, 8);
        assert_eq!(shown.next(start), Some(1));
        shown.done(start, 50 * MS);
        shown.show(2, 1);
        assert_eq!(shown.next(start), Some(2));
        shown.done(start, 50 * MS);
        // Three quarters of the time it rests, and then looks at the newest frame.
        for (frame, after) in [(3, 10), (4, 149)] {
            shown.show(frame, 4);
            assert_eq!(shown.next(start + after * MS), None);
        }
        assert_eq!(shown.next(start + 150 * MS), Some(4));
        assert_eq!(shown.next(start + 150 * MS), None);
        // A slow one does not rest forever.
        shown.done(start, 3000 * MS);
        shown.show(5, 16);
        assert_eq!(shown.next(start + 999 * MS), None);
        assert_eq!(shown.next(start + 1000 * MS), Some(5));
    }
}
