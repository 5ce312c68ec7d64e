//! A run with threads: tracking answers each frame before the next is accepted; detection, mapping and loop closure run in parallel.

use crate::arrays;
use crate::detections::answer;
use crate::driver::{Known, Surface, Taken, Trouble};
use crate::events::Source;
use crate::guard::calling;
use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use stillpoint::dense::{Dense, DenseCounts, DenseMap};
use stillpoint::detection::{
    DetectError, Detection, Detections, Detector, DetectorInfo, DetectorKind,
};
use stillpoint::imaging::{FrameId, ImuSample, OdometrySample, RgbdFrame};
use stillpoint::live::{Delivery, Events, LiveOptions, LiveResult, LiveSystem, Stage, ThreadState};
use stillpoint::map::Map;
use stillpoint::slam::{Event, FrameEvent, Stages, Subscriber, Timing};
use stillpoint_cli::front::ResultRecorder;

/// Interval of checks whether the threads are alive.
const LOOK: Duration = Duration::from_millis(200);
/// Maximum number of frames with images queued for the surface: more than a second.
const IMAGES: usize = 40;
/// Maximum number of events queued before a frame's answer: more than those of a second of mapping.
const WAITING: usize = 1024;

pub(crate) struct Live {
    run: Option<LiveSystem>,
    events: Events,
    next: Option<u32>,
    surface: Option<Arc<Mutex<Surface>>>,
    /// Recorder of a requested result folder.
    kept: Option<Arc<Mutex<ResultRecorder>>>,
    /// `Some` after the end.
    result: Option<LiveResult>,
    /// Shared with listeners: whether the run is finished.
    over: Arc<AtomicBool>,
}

impl Drop for Live {
    fn drop(&mut self) {
        // A run dropped unfinished sends no more events, so listeners must stop waiting.
        self.over.store(true, Ordering::Release);
    }
}

/// Fuses the surface in its own thread.
struct Fusing(Arc<Mutex<Surface>>);

impl Subscriber for Fusing {
    fn receive(&mut self, event: &Event) {
        if let Surface::Growing(dense) = &mut *lock(&self.0) {
            dense.receive(event);
        }
    }
}

/// Records for a result folder in its own thread.
struct Keeping(Arc<Mutex<ResultRecorder>>);

impl Subscriber for Keeping {
    fn receive(&mut self, event: &Event) {
        lock(&self.0).receive(event);
    }
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Live {
    pub(crate) fn start(
        stages: Stages,
        detector: Option<Box<dyn Detector>>,
        dense: Option<Dense>,
    ) -> std::io::Result<Self> {
        let options = LiveOptions {
            drop_late: false,
            ..LiveOptions::default()
        };
        let mut run = LiveSystem::start(stages, detector, options)?;
        let events = run.listen("python", Delivery::until_full(WAITING).with_images(8, 1));
        let surface = dense.map(|d| Arc::new(Mutex::new(Surface::Growing(Box::new(d)))));
        if let Some(surface) = &surface {
            let all = Delivery::until_full(4096).with_images(IMAGES, 1);
            run.subscribe("dense", all, Fusing(Arc::clone(surface)))?;
        }
        Ok(Self {
            run: Some(run),
            events,
            next: Some(0),
            surface,
            kept: None,
            result: None,
            over: Arc::default(),
        })
    }

    pub(crate) fn track(
        &mut self,
        taken: Taken,
        seen: Option<Vec<Detection>>,
    ) -> Result<Arc<FrameEvent>, Trouble> {
        let run = self.run.as_mut().ok_or(Trouble::Over)?;
        let id = FrameId(self.next.ok_or(Trouble::Full)?);
        let frame = taken.numbered(id);
        // Discards events of previous frames.
        self.events.try_iter().for_each(drop);
        if let Some(items) = seen {
            run.tell(Detections {
                frame: id,
                stamp: frame.stamp,
                items,
            });
        }
        if !run.push(frame) {
            return Err(Trouble::Broken("tracking ended".to_owned()));
        }
        loop {
            match self.events.recv_within(LOOK) {
                Some(Event::Frame(frame)) if frame.report.frame == id => {
                    self.next = id.0.checked_add(1);
                    return Ok(frame);
                }
                Some(Event::Refused(refused)) => return Err(Trouble::Refused(refused)),
                Some(_) => {}
                None => {
                    let health = run.watch().health();
                    let tracking = health.troubles().find(|t| t.0 == Stage::Tracking);
                    if let Some((_, ThreadState::Panicked(why))) = tracking {
                        return Err(Trouble::Broken(why.clone()));
                    }
                }
            }
        }
    }

    /// Adds IMU samples up to the next frame; errors are reported with that frame.
    pub(crate) fn receive_inertial(&mut self, samples: Vec<ImuSample>) {
        if let Some(run) = &mut self.run {
            run.tell_inertial(samples);
        }
    }

    /// Likewise for wheel odometry.
    pub(crate) fn receive_odometry(&mut self, samples: Vec<OdometrySample>) {
        if let Some(run) = &mut self.run {
            run.tell_odometry(samples);
        }
    }

    pub(crate) fn is_over(&self) -> bool {
        self.run.is_none()
    }

    pub(crate) fn known(&self) -> Known {
        match (&self.run, &self.result) {
            (Some(run), _) => {
                let watch = run.watch();
                Known {
                    trajectory: watch.trajectory(),
                    view: watch.view(),
                }
            }
            (None, Some(result)) => Known {
                trajectory: result.trajectory.clone(),
                view: Arc::clone(&result.view),
            },
            (None, None) => Known {
                trajectory: Default::default(),
                view: Arc::default(),
            },
        }
    }

    pub(crate) fn with_map<R>(&self, look: impl FnOnce(&Map, Option<&Timing>) -> R) -> Option<R> {
        if let Some(result) = &self.result {
            let map = result.map.as_ref();
            return map.map(|map| look(map, Some(&result.timing)));
        }
        // The estimated readout time is available only at the end.
        Some(look(&self.run.as_ref()?.map()?, None))
    }

    pub(crate) fn surface(&self) -> Option<DenseMap> {
        self.surface.as_ref().and_then(|s| lock(s).map())
    }

    pub(crate) fn counted_surface(&self) -> Option<(DenseMap, DenseCounts)> {
        lock(self.surface.as_ref()?).counted()
    }

    pub(crate) fn keep_result(&mut self, recorder: ResultRecorder) -> std::io::Result<()> {
        let Some(run) = &mut self.run else {
            return Ok(());
        };
        let kept = Arc::new(Mutex::new(recorder));
        let all = Delivery::until_full(4096).with_images(IMAGES, 1);
        run.subscribe("result", all, Keeping(Arc::clone(&kept)))?;
        self.kept = Some(kept);
        Ok(())
    }

    pub(crate) fn with_result<R>(&self, look: impl FnOnce(&ResultRecorder) -> R) -> Option<R> {
        self.kept.as_ref().map(|kept| look(&lock(kept)))
    }

    pub(crate) fn end_frame(&self, milliseconds: f64) {
        if let Some(kept) = &self.kept {
            lock(kept).end_frame(milliseconds);
        }
    }

    pub(crate) fn listen(&mut self, room: usize) -> Source {
        match &self.run {
            Some(run) => {
                let events = run.listen("python events", Delivery::newest(room));
                Source::Live(Arc::new(events), Arc::clone(&self.over))
            }
            None => Source::over(),
        }
    }

    pub(crate) fn finish(&mut self) {
        let Some(run) = self.run.take() else {
            return;
        };
        self.result = Some(run.finish());
        self.over.store(true, Ordering::Release);
        let known = self.known();
        if let Some(surface) = &self.surface {
            lock(surface).finish(&known);
        }
    }
}

/// A Python function as the detector of a live run, called in the detection thread.
pub(crate) struct Called(pub(crate) Py<PyAny>);

impl Detector for Called {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        let failed = |reason: String| DetectError::Runtime {
            frame: frame.id,
            reason,
        };
        let colour = frame.colour.as_ref();
        let colour = colour.ok_or(DetectError::NoColour { frame: frame.id })?;
        // `None` during shutdown of the interpreter.
        let ask = |py: Python<'_>| {
            let callable = self.0.bind(py);
            let image = arrays::shared_colour(py, Arc::clone(colour))?;
            let said = answer(callable, image);
            said.inspect_err(|e| e.clone_ref(py).write_unraisable(py, Some(callable)))
        };
        // Covers the time from waiting for the interpreter's lock to its release.
        let said = calling(|| Python::try_attach(ask)).flatten();
        let items = said
            .ok_or_else(|| failed("the interpreter ends".to_owned()))?
            .map_err(|e| failed(e.to_string()))?;
        Ok(Detections {
            frame: frame.id,
            stamp: frame.stamp,
            items,
        })
    }

    fn info(&self) -> DetectorInfo {
        Self::about()
    }
}

impl Called {
    /// Description for results.
    pub(crate) fn about() -> DetectorInfo {
        DetectorInfo::new(DetectorKind::Scripted, "a function of Python's")
    }
}
