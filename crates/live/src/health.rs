//! How a live run is at this moment: the newest frame's health, and whether every thread is at work.
//!
//! A thread that hangs cannot say so, and what threads and clocks do is no part of what a replay gives again. So this is no event: it is
//! asked for, from whichever thread, and is answered whatever the stages do.

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

/// A thread that has been at one message for longer does not answer: it hangs, or has more to do than its machine can.
const PATIENCE: Duration = Duration::from_secs(1);

/// How a thread is.
#[derive(Clone, Debug, PartialEq)]
pub enum ThreadState {
    /// It works, or waits for something to do.
    Running,
    /// It has been at one message for more than a second.
    NotAnswering {
        /// For how long, s.
        seconds: f64,
    },
    /// It did all that was to do.
    Finished,
    /// It panicked; the others go on without it.
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

/// What a thread is at, as it notes itself.
#[derive(Clone, Debug, Default)]
pub(crate) enum Pulse {
    /// It waits for its next message, or has not begun.
    #[default]
    Waiting,
    /// It works on a message since then.
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

/// Runs a thread's loop, and tells how it ended. What the loop worked on is left as it was when it panicked, and only what
/// is whole even then is used of it.
pub(crate) fn guarded(boxes: &Boxes, stage: Stage, run: impl FnOnce()) -> WorkerEnd {
    let end = match catch_unwind(AssertUnwindSafe(run)) {
        Ok(()) => WorkerEnd::Finished,
        Err(panic) => WorkerEnd::Panicked(reason_of(panic.as_ref())),
    };
    boxes.pulse(stage).put(|p| *p = Pulse::Ended(end.clone()));
    end
}

/// What a panic says.
pub(crate) fn reason_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
    text.unwrap_or_else(|| "unknown reason".to_owned())
}

/// The newest frame that was tracked.
pub(crate) struct Newest {
    pub(crate) health: Health,
    pub(crate) timing: FrameTiming,
    pub(crate) at: Instant,
}

/// How a live run is at a moment.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveHealth {
    /// Health of the newest frame that was tracked; none before the first.
    pub health: Option<Health>,
    /// What was measured at it.
    pub timing: Option<FrameTiming>,
    /// How long ago its pose was there, s.
    pub frame_age: Option<f64>,
    /// Frames that were tracked so far, whatever became of their poses.
    pub tracked: u64,
    /// Frames that were dropped so far.
    pub dropped: u64,
    /// The threads; detection only with a detector.
    pub threads: Vec<(Stage, ThreadState)>,
}

impl LiveHealth {
    /// The threads that do not do what they should.
    pub fn troubles(&self) -> impl Iterator<Item = &(Stage, ThreadState)> {
        let is_well =
            |state: &ThreadState| matches!(state, ThreadState::Running | ThreadState::Finished);
        self.threads.iter().filter(move |t| !is_well(&t.1))
    }
}

/// One line: [`Health`]'s, the latency, and the threads that do not do what they should.
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

/// Looks at a live run from outside, from any thread, also while [`LiveSystem::play`](crate::LiveSystem::play) is at work and after
/// its end.
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

    /// The frames tracked so far, each with its pose relative to a keyframe and as it was known at that frame. It is copied without
    /// tracking ever waiting for that.
    #[must_use]
    pub fn trajectory(&self) -> Trajectory {
        self.boxes.trajectory()
    }

    /// The frames tracked so far with their poses `world_from_camera` after all corrections until now: through the newest
    /// version of the map, and smoothed ([`Trajectory::smoothed`]).
    #[must_use]
    pub fn corrected_trajectory(&self) -> Vec<(TrajectoryEntry, Se3)> {
        self.trajectory().smoothed(&self.view())
    }

    /// All loop candidates so far and their outcomes.
    #[must_use]
    pub fn loops(&self) -> Vec<LoopReport> {
        self.boxes.loops.look(|l| l.reports().to_vec())
    }

    /// A copy of the map as it is now, from which a map file can be written while the run goes on ([`Map::to_bytes`]). Mapping makes it
    /// between two of its messages, so this waits for the one at hand; tracking waits for nothing. None once mapping has
    /// ended: then the map comes with the run's result.
    #[must_use]
    pub fn map(&self) -> Option<Map> {
        self.boxes.map()
    }

    /// The timing of the newest tracked frame; none before the first. It costs less than [`Watch::health`], for programs
    /// that read it at every frame.
    #[must_use]
    pub fn timing(&self) -> Option<FrameTiming> {
        self.boxes.newest.look(|n| n.as_ref().map(|n| n.timing))
    }

    /// How the run is now.
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
