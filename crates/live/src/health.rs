//! Current state of a live run: the newest frame's health, and the state of every thread.
//!
//! A hanging thread cannot report itself, and replays do not reproduce threads and clocks. So this is not an event: any thread can query it
//! at any time, whatever the stages do.

use crate::boxes::Boxes;
use crate::measure::{FrameTiming, Stage, WorkerEnd};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use stillpoint_geometry::Se3;
use stillpoint_map::{Map, MapView};
use stillpoint_slam::{Health, LoopReport, Trajectory, TrajectoryEntry};

/// Maximum time for one message, after which a thread counts as not answering.
const PATIENCE: Duration = Duration::from_secs(1);

/// State of a thread.
#[derive(Clone, Debug, PartialEq)]
pub enum ThreadState {
    /// Working, or waiting for work.
    Running,
    /// Working on one message for more than a second.
    NotAnswering {
        /// Duration, s.
        seconds: f64,
    },
    /// It completed its work.
    Finished,
    /// It panicked; the others continue without it.
    Panicked(String),
}

impl std::fmt::Display for ThreadState {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Running => f.write_str("running"),
            Self::NotAnswering { seconds } => write!(f, "not answering for {seconds:.1} s"),
            Self::Finished => f.write_str("finished"),
            Self::Panicked(reason) => write!(f, "panicked: {reason}"),
        }
    }
}

/// Activity of a thread, recorded by itself.
#[derive(Clone, Debug, Default)]
pub(crate) enum Pulse {
    /// Waiting for its next message, or not started.
    #[default]
    Waiting,
    /// Working on a message since this time.
    Working(Instant),
    Ended(WorkerEnd),
}

impl Pulse {
    fn state(&self, now: Instant) -> ThreadState {
        match self {
            Self::Waiting => ThreadState::Running,
            Self::Working(since) => {
                let at_it = now.saturating_duration_since(*since);
                if at_it <= PATIENCE {
                    return ThreadState::Running;
                }
                let seconds = at_it.as_secs_f64();
                ThreadState::NotAnswering { seconds }
            }
            Self::Ended(WorkerEnd::Panicked(reason)) => ThreadState::Panicked(reason.clone()),
            Self::Ended(WorkerEnd::Finished | WorkerEnd::GivenUp) => ThreadState::Finished,
        }
    }
}

/// Runs a thread's loop, and returns how it ended. After a panic, only state that stays consistent is used.
pub(crate) fn guarded(boxes: &Boxes, stage: Stage, run: impl FnOnce()) -> WorkerEnd {
    let end = match catch_unwind(AssertUnwindSafe(run)) {
        Ok(()) => WorkerEnd::Finished,
        Err(panic) => WorkerEnd::Panicked(reason_of(panic.as_ref())),
    };
    boxes.pulse(stage).put(|p| *p = Pulse::Ended(end.clone()));
    end
}

pub(crate) fn reason_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
    text.unwrap_or_else(|| "unknown reason".to_owned())
}

pub(crate) struct Newest {
    pub(crate) health: Health,
    pub(crate) timing: FrameTiming,
    pub(crate) at: Instant,
}

/// State of a live run at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveHealth {
    /// Health of the newest tracked frame; `None` before the first.
    pub health: Option<Health>,
    /// Its timing.
    pub timing: Option<FrameTiming>,
    /// Time since its pose, s.
    pub frame_age: Option<f64>,
    /// Number of processed frames, tracked or lost.
    pub tracked: u64,
    /// Number of dropped frames.
    pub dropped: u64,
    /// State of the threads; detection only with a detector.
    pub threads: Vec<(Stage, ThreadState)>,
}

impl LiveHealth {
    /// The threads with problems.
    pub fn troubles(&self) -> impl Iterator<Item = &(Stage, ThreadState)> {
        let is_well =
            |state: &ThreadState| matches!(state, ThreadState::Running | ThreadState::Finished);
        self.threads.iter().filter(move |t| !is_well(&t.1))
    }
}

/// One line: [`Health`]'s, the latency, and the threads with problems.
impl std::fmt::Display for LiveHealth {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.health {
            Some(health) => health.fmt(f)?,
            None => f.write_str("no frame yet")?,
        }
        if let Some(timing) = &self.timing {
            write!(f, " | latency {:.0} ms", 1e3 * timing.latency)?;
        }
        for (stage, state) in self.troubles() {
            write!(f, " | {stage}: {state}")?;
        }
        Ok(())
    }
}

/// Observes a live run from any thread, also during [`LiveSystem::play`](crate::LiveSystem::play) and after its end.
#[derive(Clone)]
pub struct Watch {
    boxes: Arc<Boxes>,
    has_detector: bool,
}

impl Watch {
    pub(crate) fn new(boxes: &Arc<Boxes>, has_detector: bool) -> Self {
        Self {
            boxes: Arc::clone(boxes),
            has_detector,
        }
    }

    /// The newest version of the map.
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        self.boxes.view.look(Arc::clone)
    }

    /// The tracked frames, each with its pose relative to a keyframe as known at that frame. Copying never blocks tracking.
    #[must_use]
    pub fn trajectory(&self) -> Trajectory {
        self.boxes.trajectory()
    }

    /// The tracked frames with their current poses `world_from_camera`: through the newest version of the map, and smoothed
    /// ([`Trajectory::smoothed`]).
    #[must_use]
    pub fn corrected_trajectory(&self) -> Vec<(TrajectoryEntry, Se3)> {
        self.trajectory().smoothed(&self.view())
    }

    /// All loop candidates up to now, with their outcomes.
    #[must_use]
    pub fn loops(&self) -> Vec<LoopReport> {
        self.boxes.loops.look(|l| l.reports().to_vec())
    }

    /// A copy of the current map, for saving during the run ([`Map::to_bytes`]). Mapping makes it between two messages, so this waits for
    /// the current one; tracking does not wait. `None` after mapping has ended: then the run's result has the map.
    #[must_use]
    pub fn map(&self) -> Option<Map> {
        self.boxes.map()
    }

    /// Timing of the newest tracked frame; `None` before the first. Cheaper than [`Watch::health`], for use at every frame.
    #[must_use]
    pub fn timing(&self) -> Option<FrameTiming> {
        self.boxes.newest.look(|n| n.as_ref().map(|n| n.timing))
    }

    /// The current state.
    #[must_use]
    pub fn health(&self) -> LiveHealth {
        let now = Instant::now();
        let (health, timing, frame_age) = self.boxes.newest.look(|newest| match newest {
            None => (None, None, None),
            Some(n) => {
                let age = now.saturating_duration_since(n.at).as_secs_f64();
                (Some(n.health.clone()), Some(n.timing), Some(age))
            }
        });
        let is_there = |stage: &Stage| self.has_detector || *stage != Stage::Detection;
        let state = |stage: Stage| (stage, self.boxes.pulse(stage).look(|p| p.state(now)));
        LiveHealth {
            health,
            timing,
            frame_age,
            tracked: self.boxes.frames.load(Ordering::Relaxed),
            dropped: self.boxes.dropped.load(Ordering::Relaxed),
            threads: Stage::ALL.into_iter().filter(is_there).map(state).collect(),
        }
    }
}
