//! A live run from its first frame to its result.

use crate::audience::{self, Delivery, Events, Listening, Subscribed};
use crate::boxes::{Arrived, Boxes, QUEUE, SAMPLES, Said};
use crate::health::Watch;
use crate::measure::{Ended, LiveStatistics, WorkerEnd};
use crate::recorder::Recorder;
use crate::threads::{Ends, Threads};
use crate::workers::Hook;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use stillpoint_detection::{Detections, Detector};
use stillpoint_geometry::Se3;
use stillpoint_imaging::{FrameId, ImuSample, OdometrySample, RgbdFrame};
use stillpoint_map::{Map, MapView};
use stillpoint_slam::{
    Event, FrameGate, LoopReport, RefusedFrame, RunLog, Stages, Subscriber, Timing, Trajectory,
    TrajectoryEntry,
};

/// Called once by a subscriber's thread, with its name.
pub type SubscriberHook = Arc<dyn Fn(&str) + Send + Sync>;

/// Options of a live run.
#[derive(Clone)]
pub struct LiveOptions {
    /// Whether a frame that tracking has not taken when the next one arrives is dropped. Otherwise the next one waits, and none is dropped.
    /// Dropped frames reduce the detector's share of the time.
    pub drop_late: bool,
    /// Maximum wait for a detector that does not answer at the end of the run, before its thread is abandoned.
    pub detector_patience: Duration,
    /// Maximum wait for a subscriber that takes no further event at the end of the run, before its thread is abandoned; its pending events
    /// count as missed.
    pub subscriber_patience: Duration,
    /// Time budget of tracking per frame, s: beyond it, fewer keypoints are extracted and the detector is called less often. `None`: no
    /// limit.
    pub budget: Option<f64>,
    /// Whether the run log and the frame timings are kept. They grow with every frame; disable this for runs of days that will not be
    /// replayed. The log is then empty.
    pub keep_log: bool,
    /// Minimum number of newest frames kept in the trajectory, for runs of days without a log: 300 bytes each, at most twice as many.
    /// `None`: all, as with a log.
    pub keep_frames: Option<usize>,
    /// Called by every stage's thread before it waits for its next message.
    pub hook: Option<Hook>,
    /// Called by every subscriber's thread before its first event, with its name: to set its priority.
    pub subscriber_hook: Option<SubscriberHook>,
}

impl Default for LiveOptions {
    fn default() -> Self {
        Self {
            drop_late: true,
            detector_patience: Duration::from_secs(2),
            subscriber_patience: Duration::from_secs(30),
            budget: None,
            keep_log: true,
            keep_frames: None,
            hook: None,
            subscriber_hook: None,
        }
    }
}

/// The result of a live run: everything learned, however its threads ended.
pub struct LiveResult {
    /// The tracked frames.
    pub trajectory: Trajectory,
    /// The map; `None` if mapping panicked and left it in an unusable state.
    pub map: Option<Map>,
    /// The last published version of the map.
    pub view: Arc<MapView>,
    /// The loop candidates with their outcomes.
    pub loops: Vec<LoopReport>,
    /// Estimated exposure timing.
    pub timing: Timing,
    /// The order in which the stages took their messages.
    pub log: RunLog,
    /// Measurements.
    pub statistics: LiveStatistics,
    /// How the threads ended.
    pub ended: Ended,
    /// The detector; `None` without one, or if its thread did not finish.
    pub detector: Option<Box<dyn Detector>>,
}

/// SLAM at camera rate: every stage on its own thread.
pub struct LiveSystem {
    boxes: Arc<Boxes>,
    options: LiveOptions,
    fingerprint: u64,
    threads: Threads,
    subscribers: Vec<Listening>,
    gate: FrameGate,
    refused: u64,
    arrived: u64,
    dropped: Vec<FrameId>,
    /// Ends the threads of a run that is dropped unfinished.
    _closing: Closing,
}

/// Closes the inboxes on drop, so that every thread ends.
struct Closing(Arc<Boxes>);

impl Drop for Closing {
    fn drop(&mut self) {
        self.0.detection.close();
        self.0.tracking.close();
        self.0.audience.close();
    }
}

impl LiveSystem {
    /// Starts the threads. `detector.stride` of the configuration applies; `schedule` does not, as timing decides.
    ///
    /// # Errors
    /// A thread that cannot be started.
    pub fn start(
        stages: Stages,
        detector: Option<Box<dyn Detector>>,
        options: LiveOptions,
    ) -> std::io::Result<Self> {
        let boxes = Arc::new(Boxes::default());
        let closing = Closing(Arc::clone(&boxes));
        let fingerprint = stages.fingerprint();
        let (threads, gate) = Threads::start(&boxes, stages, detector, &options)?;
        Ok(Self {
            _closing: closing,
            boxes,
            options,
            fingerprint,
            threads,
            subscribers: Vec::new(),
            gate,
            refused: 0,
            arrived: 0,
            dropped: Vec::new(),
        })
    }

    /// Adds a subscriber on its own thread of this name. Events come in the order stated at [`Event`], as specified by `delivery`; no stage
    /// ever waits for a subscriber. Missed events are counted in [`LiveStatistics::subscribers`].
    ///
    /// # Errors
    /// A thread that cannot be started.
    pub fn subscribe<S: Subscriber + Send + 'static>(
        &mut self,
        name: &str,
        delivery: Delivery,
        subscriber: S,
    ) -> std::io::Result<Subscribed<S>> {
        let events = self.boxes.audience.listen(name, delivery);
        let hook = self.options.subscriber_hook.clone();
        let named = name.to_owned();
        let begin = move || {
            if let Some(hook) = hook {
                hook(&named);
            }
        };
        let (subscribed, listening) = audience::start(name, events, subscriber, begin)?;
        self.subscribers.push(listening);
        Ok(subscribed)
    }

    /// Events from now on, for polling.
    #[must_use]
    pub fn listen(&self, name: &str, delivery: Delivery) -> Events {
        self.boxes.audience.listen(name, delivery)
    }

    /// Pushes a frame that just arrived. With [`LiveOptions::drop_late`] this returns at once; otherwise when the previous frame was taken
    /// and all complete subscriptions have room for this one's events. A frame that does not follow the previous one is refused, with an
    /// event. False if tracking panicked and takes no more frames.
    pub fn push(&mut self, frame: RgbdFrame) -> bool {
        if let Err(refused) = self.gate.admit(&frame) {
            self.refuse(refused);
            return true;
        }
        let arrived = Arrived {
            frame: Arc::new(frame),
            at: Instant::now(),
        };
        self.arrived += 1;
        let drop_late = self.options.drop_late;
        if !drop_late {
            self.boxes.audience.wait_for_room();
        }
        let before = self.boxes.tracking.put_when(
            |b| drop_late || b.frame.is_none(),
            |b| {
                b.dropped |= b.frame.is_some();
                b.frame.replace(arrived)
            },
        );
        if let Some(Some(late)) = &before {
            self.dropped.push(late.frame.id);
            self.boxes.dropped.fetch_add(1, Ordering::Relaxed);
        }
        before.is_some()
    }

    /// Adds detections of the caller's detector for the frame named in them: before [`LiveSystem::push`] of that frame, or later. Tracking
    /// takes them with its next frame, which is an earlier one if that is still queued; when too many are queued the oldest are dropped.
    /// False if tracking panicked.
    pub fn tell(&mut self, detections: Detections) -> bool {
        let said = Said {
            frame: detections.frame,
            answer: Ok(detections),
            arrived: Instant::now(),
        };
        let put = self.boxes.tracking.put(|b| {
            if b.said.len() >= QUEUE {
                b.said.pop_front();
            }
            b.said.push_back(said);
        });
        put.is_some()
    }

    /// Adds inertial samples in time order, before [`LiveSystem::push`] of the frame after them. Those of dropped frames are kept for the
    /// next one. Ignored without a sensor ([`Stages::with_imu`]). False if tracking panicked.
    pub fn tell_inertial(&mut self, samples: Vec<ImuSample>) -> bool {
        if samples.is_empty() {
            return true;
        }
        let put = self.boxes.tracking.put(|b| {
            b.inertial.extend(samples);
            let excess = b.inertial.len().saturating_sub(SAMPLES);
            b.inertial.drain(..excess);
        });
        put.is_some()
    }

    /// Adds odometry samples, like [`Self::tell_inertial`]: see [`Stages::with_odometry`].
    pub fn tell_odometry(&mut self, samples: Vec<OdometrySample>) -> bool {
        if samples.is_empty() {
            return true;
        }
        let put = self.boxes.tracking.put(|b| {
            b.odometry.extend(samples);
            let excess = b.odometry.len().saturating_sub(SAMPLES);
            b.odometry.drain(..excess);
        });
        put.is_some()
    }

    fn refuse(&mut self, frame: RefusedFrame) {
        self.refused += 1;
        self.boxes.audience.publish(&Event::Refused(frame));
    }

    /// Observes the run from any thread: health of the newest frame, state of the threads, map and trajectory.
    #[must_use]
    pub fn watch(&self) -> Watch {
        Watch::new(&self.boxes, self.threads.has_detection())
    }

    /// The newest version of the map. As [`Watch::view`].
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        self.watch().view()
    }

    /// The tracked frames with their current poses. As [`Watch::corrected_trajectory`].
    #[must_use]
    pub fn corrected_trajectory(&self) -> Vec<(TrajectoryEntry, Se3)> {
        self.watch().corrected_trajectory()
    }

    /// A copy of the current map, for saving during the run. As [`Watch::map`].
    #[must_use]
    pub fn map(&self) -> Option<Map> {
        self.watch().map()
    }

    /// Number of dropped frames.
    #[must_use]
    pub fn dropped(&self) -> usize {
        self.dropped.len()
    }

    /// Ends the stream, lets every stage complete its work, and collects the result. Waits for a detector that does not answer up to
    /// [`LiveOptions::detector_patience`]; for subscribers until they have received all pending events, or one has spent
    /// [`LiveOptions::subscriber_patience`] on a single event.
    #[must_use]
    pub fn finish(self) -> LiveResult {
        self.boxes.detection.close();
        self.boxes.tracking.close();
        let Ends {
            tracking: (tracking, tracking_end),
            mapping: (mapping, mapping_end),
            looping: (looping, looping_end),
            detection: (detector, detection_end),
        } = self.threads.finish(self.options.detector_patience);
        // No stage publishes any more.
        self.boxes.audience.close();
        for subscriber in self.subscribers {
            subscriber.finish(self.options.subscriber_patience);
        }
        let loops = self.boxes.loops.look(Clone::clone).into_reports();
        let view = self.boxes.view.look(Arc::clone);
        let trajectory = tracking.tracker.trajectory().clone();
        let map = mapping.mapper.into_map();
        let is_whole = mapping_end == WorkerEnd::Finished || map.check().is_ok();
        let recorders = [
            tracking.desk.recorder,
            mapping.desk.recorder,
            looping.desk.recorder,
        ];
        LiveResult {
            log: RunLog {
                fingerprint: self.fingerprint,
                about: String::new(),
                entries: Recorder::merge(recorders),
                trajectory: trajectory.digest(&view),
            },
            timing: tracking.tracker.timing(),
            trajectory,
            map: is_whole.then_some(map),
            view,
            loops,
            statistics: LiveStatistics {
                arrived: self.arrived,
                refused: self.refused,
                dropped: self.dropped,
                frames: tracking.frames,
                detections: tracking.detections,
                subscribers: self.boxes.audience.missed(),
            },
            ended: Ended {
                tracking: tracking_end,
                detection: detection_end,
                mapping: mapping_end,
                looping: looping_end,
            },
            detector,
        }
    }
}
