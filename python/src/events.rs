//! The events of a run, for polling.

use crate::frame::Frame;
use pyo3::exceptions::PyStopIteration;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use stillpoint::slam::{Event as Happened, FrameEvent};

/// Interval of checks for Ctrl-C while waiting.
const NAP: Duration = Duration::from_millis(100);

/// Event queue of one listener of a single-threaded run; drops the oldest when full.
#[derive(Clone)]
pub(crate) struct Queue(Arc<Mutex<Waiting>>);

struct Waiting {
    events: VecDeque<Happened>,
    room: usize,
    missed: u64,
    is_over: bool,
}

impl Queue {
    pub(crate) fn new(room: usize) -> Self {
        Self(Arc::new(Mutex::new(Waiting {
            events: VecDeque::new(),
            room,
            missed: 0,
            is_over: false,
        })))
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the listener still exists.
    pub(crate) fn is_wanted(&self) -> bool {
        Arc::strong_count(&self.0) > 1
    }

    /// Drops images, which would take gigabytes in a long queue.
    pub(crate) fn put(&self, event: &Happened) {
        let mut waiting = self.lock();
        if waiting.events.len() >= waiting.room {
            waiting.events.pop_front();
            waiting.missed += 1;
        }
        waiting.events.push_back(match event {
            Happened::Frame(frame) => Happened::Frame(Arc::new(FrameEvent {
                frame: None,
                report: frame.report.clone(),
                health: frame.health.clone(),
            })),
            other => other.clone(),
        });
    }

    pub(crate) fn close(&self) {
        self.lock().is_over = true;
    }
}

#[derive(Clone)]
pub(crate) enum Source {
    Queue(Queue),
    /// With a flag that is set when the run is finished.
    Live(Arc<stillpoint::live::Events>, Arc<AtomicBool>),
}

impl Source {
    pub(crate) fn over() -> Self {
        let queue = Queue::new(1);
        queue.close();
        Self::Queue(queue)
    }
}

/// Events of a run, as an iterator.
///
/// In a single-threaded run the iteration yields past events, and can be continued after the next frame. In a live run it waits for
/// the next event, and stops at the end of the run.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Events {
    source: Source,
}

impl Events {
    pub(crate) fn new(source: Source) -> Self {
        Self { source }
    }
}

#[pymethods]
impl Events {
    fn __iter__(this: Bound<'_, Self>) -> Bound<'_, Self> {
        this
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Event> {
        match &self.source {
            Source::Queue(_) => self.poll(py)?.ok_or_else(|| PyStopIteration::new_err(())),
            Source::Live(events, over) => loop {
                let is_over = over.load(Ordering::Acquire);
                let events = Arc::clone(events);
                let next = crate::guard::detached(py, move || events.recv_within(NAP))?;
                if let Some(event) = next {
                    return Event::new(py, event);
                }
                if is_over {
                    return Err(PyStopIteration::new_err(()));
                }
                py.check_signals()?;
            },
        }
    }

    /// The next event if available, else None. Never waits.
    fn poll(&self, py: Python<'_>) -> PyResult<Option<Event>> {
        let next = match &self.source {
            Source::Queue(queue) => queue.lock().events.pop_front(),
            Source::Live(events, _) => events.try_recv(),
        };
        next.map(|event| Event::new(py, event)).transpose()
    }

    /// Number of events dropped from the full queue.
    #[getter]
    fn missed(&self) -> u64 {
        match &self.source {
            Source::Queue(queue) => queue.lock().missed,
            Source::Live(events, _) => events.missed().events,
        }
    }
}

/// One event.
#[pyclass(frozen, module = "stillpoint_slam")]
pub(crate) struct Event {
    /// Kind of event: frame, refused, mapped, detected, detector_failed, rejudged, revoked, looped or corrected.
    #[pyo3(get)]
    kind: &'static str,
    frame: Option<Py<Frame>>,
    values: Py<PyDict>,
    text: String,
}

#[pymethods]
impl Event {
    /// The frame of a frame event, without its images; else None.
    #[getter]
    fn frame(&self, py: Python<'_>) -> Option<Py<Frame>> {
        self.frame.as_ref().map(|f| f.clone_ref(py))
    }

    /// Numeric values by name.
    #[getter]
    fn values(&self, py: Python<'_>) -> Py<PyDict> {
        self.values.clone_ref(py)
    }

    fn __repr__(&self) -> String {
        format!("<Event {}: {}>", self.kind, self.text)
    }
}

impl Event {
    fn new(py: Python<'_>, event: Happened) -> PyResult<Self> {
        let values = PyDict::new(py);
        let mut frame = None;
        let (kind, text) = match event {
            Happened::Frame(event) => {
                let text = event.health.to_string();
                values.set_item("index", event.report.frame.0)?;
                values.set_item("stamp", event.report.stamp)?;
                frame = Some(Py::new(py, Frame::new(event))?);
                ("frame", text)
            }
            Happened::Refused(refused) => {
                values.set_item("stamp", refused.stamp)?;
                ("refused", refused.to_string())
            }
            Happened::Mapped { report, .. } => {
                values.set_item("keyframe", report.keyframe.0)?;
                values.set_item("map_version", report.map_version)?;
                values.set_item("keyframes", report.keyframes)?;
                values.set_item("landmarks", report.landmarks)?;
                ("mapped", format!("keyframe {}", report.keyframe))
            }
            Happened::Detected(detections) => {
                values.set_item("index", detections.frame.0)?;
                values.set_item("stamp", detections.stamp)?;
                let count = detections.items.len();
                values.set_item("detections", count)?;
                ("detected", format!("{count} in frame {}", detections.frame))
            }
            Happened::DetectorFailed(e) => ("detector_failed", e.to_string()),
            Happened::Rejudged { report, .. } => {
                values.set_item("keyframe", report.keyframe.0)?;
                values.set_item("landmarks", report.landmarks)?;
                ("rejudged", format!("keyframe {}", report.keyframe))
            }
            Happened::Revoked { report, .. } => {
                values.set_item("first", report.first.0)?;
                values.set_item("last", report.last.0)?;
                values.set_item("keyframes", report.keyframes)?;
                ("revoked", format!("{} keyframes", report.keyframes))
            }
            Happened::Looped(report) => {
                values.set_item("keyframe", report.keyframe.0)?;
                values.set_item("with", report.with.0)?;
                values.set_item("score", report.score)?;
                values.set_item("inliers", report.inliers)?;
                values.set_item("moved_m", report.moved_m)?;
                values.set_item("outcome", report.outcome.to_string())?;
                (
                    "looped",
                    format!(
                        "keyframe {} with {}: {}",
                        report.keyframe, report.with, report.outcome
                    ),
                )
            }
            Happened::Corrected { report, .. } => {
                values.set_item("map_version", report.map_version)?;
                values.set_item("keyframes", report.keyframes)?;
                values.set_item("merged", report.merged)?;
                ("corrected", format!("{} keyframes", report.keyframes))
            }
        };
        Ok(Self {
            kind,
            frame,
            values: values.unbind(),
            text,
        })
    }
}
