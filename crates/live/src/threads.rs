//! Starts and ends the threads of the stages.

use crate::boxes::Boxes;
use crate::budget::Budget;
use crate::detection::DetectionWorker;
use crate::measure::{Stage, WorkerEnd};
use crate::recorder::Recorder;
use crate::system::LiveOptions;
use crate::workers::{Desk, Hook, LoopingWorker, MappingWorker, TrackingWorker};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use stillpoint_detection::Detector;
use stillpoint_slam::{FrameGate, MappingEffort, Stages};

/// A worker, and how its thread ended.
type Finished<W> = (W, WorkerEnd);

/// A detector's thread, and the channel that returns it: joining might block forever.
struct Detection {
    done: Receiver<Finished<DetectionWorker>>,
    thread: JoinHandle<()>,
}

pub(crate) struct Threads {
    tracking: JoinHandle<Finished<TrackingWorker>>,
    mapping: JoinHandle<Finished<MappingWorker>>,
    looping: JoinHandle<Finished<LoopingWorker>>,
    detection: Option<Detection>,
}

pub(crate) struct Ends {
    pub(crate) tracking: Finished<TrackingWorker>,
    pub(crate) mapping: Finished<MappingWorker>,
    pub(crate) looping: Finished<LoopingWorker>,
    /// `None` without a detector; no detector if its thread did not finish.
    pub(crate) detection: (Option<Box<dyn Detector>>, Option<WorkerEnd>),
}

struct Office {
    boxes: Arc<Boxes>,
    counter: Arc<AtomicU64>,
    hook: Option<Hook>,
    keeps_log: bool,
}

impl Office {
    fn desk(&self, stage: Stage) -> Desk {
        Desk {
            stage,
            boxes: Arc::clone(&self.boxes),
            recorder: Recorder::new(&self.counter, self.keeps_log),
            hook: self.hook.clone(),
        }
    }
}

impl Threads {
    /// Starts a thread for each stage; the frame gate is returned.
    pub(crate) fn start(
        boxes: &Arc<Boxes>,
        stages: Stages,
        detector: Option<Box<dyn Detector>>,
        options: &LiveOptions,
    ) -> std::io::Result<(Self, FrameGate)> {
        let office = Office {
            boxes: Arc::clone(boxes),
            counter: Arc::default(),
            hook: options.hook.clone(),
            keeps_log: options.keep_log,
        };
        let stride = u64::from(stages.config().detector.stride);
        let effort = MappingEffort::of(stages.config());
        let features = stages.config().features.features as u32;
        let budget = options.budget.map(|limit| Budget::new(limit, features));
        let Stages {
            gate,
            tracker,
            retracer,
            health,
            mapper,
            loop_closer,
            ..
        } = stages;
        boxes.view.put(|view| *view = tracker.view());
        let looping = LoopingWorker::new(office.desk(Stage::Looping), loop_closer);
        let mapping = MappingWorker::new(office.desk(Stage::Mapping), mapper, effort);
        let desk = office.desk(Stage::Tracking);
        let mut tracking = TrackingWorker::new(desk, (tracker, retracer, health), stride, budget);
        // A log ends with a digest of the whole trajectory.
        tracking.keep_frames = options.keep_frames.filter(|_| !options.keep_log);
        let detection = detector.map(|detector| DetectionWorker {
            boxes: Arc::clone(boxes),
            hook: options.hook.clone(),
            detector,
        });
        // In the order of waiting: if one fails to start, those before it still end.
        let detection = detection.map(start_detection).transpose()?;
        let tracking = spawn("tracking", tracking, TrackingWorker::run)?;
        let mapping =
            spawn("mapping", mapping, MappingWorker::run).inspect_err(|_| boxes.mapping.close())?;
        let looping = spawn("looping", looping, LoopingWorker::run).inspect_err(|_| {
            boxes.looping.close();
            boxes.mapping.close();
        })?;
        let threads = Self {
            tracking,
            mapping,
            looping,
            detection,
        };
        Ok((threads, gate))
    }

    pub(crate) fn has_detection(&self) -> bool {
        self.detection.is_some()
    }

    /// Waits for all threads, after the inboxes of tracking and detection were closed; for a detector up to a time limit.
    pub(crate) fn finish(self, detector_patience: Duration) -> Ends {
        let deadline = Instant::now() + detector_patience;
        Ends {
            tracking: join(self.tracking),
            mapping: join(self.mapping),
            looping: join(self.looping),
            detection: match self.detection {
                None => (None, None),
                Some(detection) => detection.finish(deadline),
            },
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

/// Joins a thread. Panics are caught inside; any other is a bug of this crate, and is resumed here.
pub(crate) fn join<T>(thread: JoinHandle<T>) -> T {
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
        // The receiver is gone if the detector was abandoned.
        let _ = sender.send((worker, end));
    })?;
    Ok(Detection { done, thread })
}

impl Detection {
    /// The detector, and how its thread ended. A thread that does not end in time is abandoned.
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
