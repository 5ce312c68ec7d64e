//! A live run from its first frame to its result.

use crate::audience::{self, Delivery, Events, Subscribed};
use crate::boxes::{Arrived, Boxes};
use crate::budget::Budget;
use crate::detection::DetectionWorker;
use crate::health::Watch;
use crate::measure::{Ended, LiveStatistics, Stage, WorkerEnd};
use crate::recorder::Recorder;
use crate::workers::{Desk, Hook, LoopingWorker, MappingWorker, TrackingWorker};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use stillpoint_detection::Detector;
use stillpoint_geometry::Se3;
use stillpoint_imaging::{FrameId, RgbdFrame};
use stillpoint_map::{Map, MapView};
use stillpoint_slam::{
    Event, FrameGate, LoopReport, MappingEffort, RefusedFrame, RunLog, Stages, Subscriber, Timing,
    Trajectory, TrajectoryEntry,
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
    /// Time that tracking may take per frame, s: it wants fewer keypoints, and asks the detector more rarely, as long as that is
    /// exceeded. None: no limit.
    pub budget: Option<f64>,
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
            budget: None,
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
    /// The places that were recognised, with what became of them.
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

type Finished<W> = (W, WorkerEnd);

/// A detector's thread, and where it puts itself when it is done: joining it might take forever.
struct Detection {
    done: Receiver<Finished<DetectionWorker>>,
    thread: JoinHandle<()>,
}

/// SLAM at the pace of a camera: every stage on a thread of its own.
pub struct LiveSystem {
    boxes: Arc<Boxes>,
    options: LiveOptions,
    fingerprint: u64,
    tracking: JoinHandle<Finished<TrackingWorker>>,
    mapping: JoinHandle<Finished<MappingWorker>>,
    looping: JoinHandle<Finished<LoopingWorker>>,
    detection: Option<Detection>,
    subscribers: Vec<JoinHandle<()>>,
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

/// What the desks of one run have in common.
struct Office {
    boxes: Arc<Boxes>,
    counter: Arc<AtomicU64>,
    hook: Option<Hook>,
}

impl Office {
    fn desk(&self, stage: Stage) -> Desk {
        Desk {
            stage,
            boxes: Arc::clone(&self.boxes),
            recorder: Recorder::new(&self.counter),
            hook: self.hook.clone(),
        }
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
        let office = Office {
            boxes: Arc::clone(&boxes),
            counter: Arc::default(),
            hook: options.hook.clone(),
        };
        let fingerprint = stages.fingerprint();
        let stride = u64::from(stages.config().detector.stride);
        let effort = MappingEffort::of(stages.config());
        let features = stages.config().features.features as u32;
        let budget = options.budget.map(|limit| Budget::new(limit, features));
        let Stages {
            gate,
            tracker,
            health,
            mapper,
            loop_closer,
            ..
        } = stages;
        boxes.view.put(|view| *view = tracker.view());
        // In the order in which they wait for each other: whatever fails to start, those that did come to their end.
        let looping = LoopingWorker::new(office.desk(Stage::Looping), loop_closer);
        let mapping = MappingWorker::new(office.desk(Stage::Mapping), mapper, effort);
        let tracking = TrackingWorker::new(
            office.desk(Stage::Tracking),
            (tracker, health),
            stride,
            budget,
        );
        let detection = detector
            .map(|detector| DetectionWorker {
                boxes: Arc::clone(&boxes),
                hook: options.hook.clone(),
                detector,
            })
            .map(start_detection)
            .transpose()?;
        let tracking = spawn("tracking", tracking, TrackingWorker::run)?;
        let mapping =
            spawn("mapping", mapping, MappingWorker::run).inspect_err(|_| boxes.mapping.close())?;
        let looping = spawn("looping", looping, LoopingWorker::run).inspect_err(|_| {
            boxes.looping.close();
            boxes.mapping.close();
        })?;
        Ok(Self {
            _closing: closing,
            boxes,
            options,
            fingerprint,
            tracking,
            mapping,
            looping,
            detection,
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
        let (subscribed, thread) = audience::start(name, events, subscriber, begin)?;
        self.subscribers.push(thread);
        Ok(subscribed)
    }

    /// Events from now on, for whoever would rather ask for them than be called.
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

    fn refuse(&mut self, frame: RefusedFrame) {
        self.refused += 1;
        self.boxes.audience.publish(&Event::Refused(frame));
    }

    /// What there is to know of the run at any moment, for any thread: health of the newest frame, whether the threads are at work,
    /// the map and the trajectory.
    #[must_use]
    pub fn watch(&self) -> Watch {
        Watch::new(&self.boxes, self.detection.is_some())
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
    /// waited for as long as [`LiveOptions::detector_patience`] says; subscribers are waited for until they have received what waits for
    /// them.
    #[must_use]
    pub fn finish(self) -> LiveResult {
        self.boxes.detection.close();
        self.boxes.tracking.close();
        let deadline = Instant::now() + self.options.detector_patience;
        let (tracking, tracking_end) = join(self.tracking);
        let (mapping, mapping_end) = join(self.mapping);
        let (looping, looping_end) = join(self.looping);
        let (detector, detection_end) = match self.detection {
            None => (None, None),
            Some(detection) => detection.finish(deadline),
        };
        // No stage has anything more to tell.
        self.boxes.audience.close();
        self.subscribers.into_iter().for_each(join);
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

fn spawn<W: Send + 'static>(
    name: &str,
    mut worker: W,
    run: fn(&mut W) -> WorkerEnd,
) -> std::io::Result<JoinHandle<Finished<W>>> {
    let thread = std::thread::Builder::new().name(name.to_owned());
    thread.spawn(move || {
        let end = run(&mut worker);
        (worker, end)
    })
}

/// Waits for a thread's end. Its panics were caught inside; one that was not is a mistake of this crate, and goes on here.
fn join<T>(thread: JoinHandle<T>) -> T {
    thread
        .join()
        .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

fn start_detection(worker: DetectionWorker) -> std::io::Result<Detection> {
    let (sender, done) = sync_channel(1);
    let thread = std::thread::Builder::new().name("detection".to_owned());
    let thread = thread.spawn(move || {
        let mut worker = worker;
        let end = worker.run();
        // Nobody listens any more when the detector was given up.
        let _ = sender.send((worker, end));
    })?;
    Ok(Detection { done, thread })
}

impl Detection {
    /// The detector and how its thread ended. A thread that does not end in time is left to itself.
    fn finish(self, deadline: Instant) -> (Option<Box<dyn Detector>>, Option<WorkerEnd>) {
        let patience = deadline.saturating_duration_since(Instant::now());
        match self.done.recv_timeout(patience) {
            Ok((worker, end)) => {
                join(self.thread);
                let finished = end == WorkerEnd::Finished;
                (finished.then_some(worker.detector), Some(end))
            }
            Err(_) => (None, Some(WorkerEnd::GivenUp)),
        }
    }
}
