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

/// Called once by the thread of a subscriber, with its name.
pub type SubscriberHook = Arc<dyn Fn(&str) + Send + Sync>;

/// How a live run is driven.
#[derive(Clone)]
pub struct LiveOptions {
    /// Whether a frame that tracking has not taken when the next one arrives gives way to it. Else the next one waits, and none
    /// is dropped. Where frames are dropped, detection takes less of the time.
    pub drop_late: bool,
    /// How long the end of the run waits for a detector that does not answer, before its thread is left to itself.
    pub detector_patience: Duration,
    /// How long the end of the run waits for a subscriber that takes no further event, before its thread is left to itself. What
    /// still waits for it then counts as missed.
    pub subscriber_patience: Duration,
    /// Time that tracking may take per frame, s: it wants fewer keypoints, and asks the detector more rarely, as long as that is
    /// exceeded. None: no limit.
    pub budget: Option<f64>,
    /// Whether the log of the run and the timings of its frames are kept. A run of days, which nobody will repeat, does without: they grow with every frame, and the log of
    /// such a run has no entries.
    pub keep_log: bool,
    /// How many of the newest frames the trajectory remembers at least, of runs of days that keep no log: 300 bytes each. Twice as many are never exceeded. None: all, as with a log.
    pub keep_frames: Option<usize>,
    /// Called by every thread of a stage before it waits for its next message.
    pub hook: Option<Hook>,
    /// Called by the thread of every subscriber before its first event, with its name: to set its priority.
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

/// What a live run gave: everything that was learned, whatever happened to its threads.
pub struct LiveResult {
    /// The frames tracked.
    pub trajectory: Trajectory,
    /// The map; none when mapping panicked and left it in a state in which it cannot be used.
    pub map: Option<Map>,
    /// The last version of the map that was published.
    pub view: Arc<MapView>,
    /// The candidates for loops, with what became of them.
    pub loops: Vec<LoopReport>,
    /// When the parts of a frame are exposed, as estimated.
    pub timing: Timing,
    /// In which order the stages took their messages.
    pub log: RunLog,
    /// What was measured.
    pub statistics: LiveStatistics,
    /// How the threads ended.
    pub ended: Ended,
    /// The detector; none when there was none, or when its thread did not finish.
    pub detector: Option<Box<dyn Detector>>,
}

/// SLAM at the pace of a camera: every stage on a thread of its own.
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
    /// Ends the threads of a run that nobody finishes.
    _closing: Closing,
}

/// Closes the way in when it goes, so that every thread comes to its end.
struct Closing(Arc<Boxes>);

impl Drop for Closing {
    fn drop(&mut self) {
        self.0.detection.close();
        self.0.tracking.close();
        self.0.audience.close();
    }
}

impl LiveSystem {
    /// Starts the threads. `detector.stride` of the configuration is followed; `schedule` is not: here time decides.
    ///
    /// # Errors
    /// What the operating system says when it has no more threads.
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

    /// Has somebody listen from now on, on a thread of this name. Events come in the order that [`Event`] states, and as
    /// `delivery` says; no stage ever waits for a subscriber. What it missed is in [`LiveStatistics::subscribers`].
    ///
    /// # Errors
    /// What the operating system says when it has no more threads.
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

    /// Events from now on, for callers that poll instead of being called.
    #[must_use]
    pub fn listen(&self, name: &str, delivery: Delivery) -> Events {
        self.boxes.audience.listen(name, delivery)
    }

    /// Hands over a frame that arrived just now. With [`LiveOptions::drop_late`] this returns at once; else when the frame before
    /// was taken, and when all who are to receive every event have room for those of this one. A frame that does not follow the one before is refused, which an event tells. False when tracking takes no more
    /// frames because it panicked.
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

    /// Hands over what a detector of the caller's saw, as of the frame named in it: before [`LiveSystem::push`] of that frame, or later.
    /// Tracking takes it with the next frame that it takes, which is another one where the frame before waits still; of answers that wait for it the oldest give way when there are too many. False when
    /// tracking takes no more of them because it panicked.
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

    /// Hands over samples of the inertial sensor, in order of time: before [`LiveSystem::push`] of the frame that they lead to. Those of frames that are dropped
    /// wait for the next one. Without a sensor ([`Stages::with_imu`]) they are left out. False when tracking takes no more of them because it panicked.
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

    /// The same of odometry: see [`Stages::with_odometry`].
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

    /// What there is to know of the run at any moment, for any thread: health of the newest frame, whether the threads are at work,
    /// the map and the trajectory.
    #[must_use]
    pub fn watch(&self) -> Watch {
        Watch::new(&self.boxes, self.threads.has_detection())
    }

    /// The newest version of the map. As [`Watch::view`].
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        self.watch().view()
    }

    /// The frames tracked so far with their poses after all corrections until now. As [`Watch::corrected_trajectory`].
    #[must_use]
    pub fn corrected_trajectory(&self) -> Vec<(TrajectoryEntry, Se3)> {
        self.watch().corrected_trajectory()
    }

    /// A copy of the map as it is now, to be saved while the run goes on. As [`Watch::map`].
    #[must_use]
    pub fn map(&self) -> Option<Map> {
        self.watch().map()
    }

    /// Frames dropped so far.
    #[must_use]
    pub fn dropped(&self) -> usize {
        self.dropped.len()
    }

    /// Ends the stream, lets every stage do what there is to do, and gathers the result. A detector that does not answer is
    /// waited for as long as [`LiveOptions::detector_patience`] says; subscribers until they have received what waits for them, or until
    /// one of them has spent [`LiveOptions::subscriber_patience`] on a single event.
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
        // No stage has anything more to tell.
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
