//! Deterministic replay of a run from its log.
//!
//! The same stages, frames and log reproduce the events, trajectory and map of the logged run bit for bit. Detections
//! are read from the log.

use crate::event::Event;
use crate::exchange::{Exchange, NotSent};
use crate::report::LoopReport;
use crate::run_log::{LogEntry, RunLog};
use crate::stages::Stages;
use crate::subscriber::Subscriber;
use crate::timing::Timing;
use crate::trajectory::Trajectory;
use std::sync::Arc;
use stillpoint_imaging::{FrameId, FrameSource, RgbdFrame, SourceError};
use stillpoint_map::{Map, MapView};

/// Why a log cannot be replayed.
#[derive(Debug)]
#[non_exhaustive]
pub enum ReplayError {
    /// The log belongs to another configuration, camera or initial map.
    OtherStages,
    /// The source has no such frame.
    NoFrame {
        /// Index of the entry.
        entry: usize,
        /// The frame.
        frame: FrameId,
        /// Its colour stamp, s.
        stamp: f64,
    },
    /// The source failed.
    Source(SourceError),
    /// The entry takes a message that was not sent: the frames or the program differ from those of the run.
    NotSent {
        /// Index of the entry.
        entry: usize,
        /// The expected and the found message.
        error: NotSent,
    },
    /// All entries were executed, but the trajectory differs.
    OtherTrajectory,
}

impl std::fmt::Display for ReplayError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::OtherStages => write!(
                f,
                "expected the configuration, camera and first map of the run that left the log, found others; use the config.toml beside it"
            ),
            Self::NoFrame {
                entry,
                frame,
                stamp,
            } => write!(
                f,
                "entry {entry}: expected frame {frame} with stamp {stamp:.6} s, found none; use the frames of the run that left the log"
            ),
            Self::Source(e) => e.fmt(f),
            Self::NotSent { entry, error } => write!(
                f,
                "entry {entry}: {error}; use the frames and the program of that run"
            ),
            Self::OtherTrajectory => write!(
                f,
                "expected the trajectory of the run that left the log, found another; use the frames and the program of that run"
            ),
        }
    }
}

impl std::error::Error for ReplayError {}

/// Replays a log by executing its entries on an [`Exchange`].
pub struct Replay {
    exchange: Exchange,
    log: RunLog,
    at: usize,
}

impl Replay {
    /// Creates a replay; `stages` must equal those of the run before its first frame.
    ///
    /// # Errors
    /// [`ReplayError::OtherStages`] if they do not.
    pub fn new(stages: Stages, log: RunLog) -> Result<Self, ReplayError> {
        if stages.fingerprint() != log.fingerprint {
            return Err(ReplayError::OtherStages);
        }
        Ok(Self {
            exchange: Exchange::from(stages),
            log,
            at: 0,
        })
    }

    /// Executes the next entry, reading its frame from the source if needed, and returns its event, if any. `None` at
    /// the end of the log. The source must yield the frames of the run, and may yield others between them.
    ///
    /// # Errors
    /// [`ReplayError`] if the log does not fit the frames. The replay cannot be resumed after that.
    pub fn step(
        &mut self,
        source: &mut dyn FrameSource,
    ) -> Result<Option<Vec<Event>>, ReplayError> {
        let Some(entry) = self.log.entries.get(self.at) else {
            return Ok(None);
        };
        let frame = match entry {
            LogEntry::TrackFrame { frame, stamp } => Some(self.read(*frame, *stamp, source)?),
            _ => None,
        };
        let event = self.exchange.take(entry, frame.as_ref());
        let event = event.map_err(|error| ReplayError::NotSent {
            entry: self.at,
            error,
        })?;
        self.at += 1;
        Ok(Some(event.into_iter().collect()))
    }

    /// Executes all remaining entries and compares the trajectory with that of the run. The subscriber receives every
    /// event.
    ///
    /// # Errors
    /// [`ReplayError`] if the log does not fit the frames, or the trajectory differs.
    pub fn run(
        &mut self,
        source: &mut dyn FrameSource,
        subscriber: &mut dyn Subscriber,
    ) -> Result<(), ReplayError> {
        while let Some(events) = self.step(source)? {
            events.iter().for_each(|event| subscriber.receive(event));
        }
        if self.trajectory().digest(&self.view()) != self.log.trajectory {
            return Err(ReplayError::OtherTrajectory);
        }
        Ok(())
    }

    fn read(
        &self,
        frame: FrameId,
        stamp: f64,
        source: &mut dyn FrameSource,
    ) -> Result<Arc<RgbdFrame>, ReplayError> {
        loop {
            match source.next_frame() {
                Some(Ok(f)) if f.id == frame && f.stamp.to_bits() == stamp.to_bits() => {
                    return Ok(Arc::new(f));
                }
                // Frames that the run dropped or could not read.
                Some(Ok(_)) => {}
                Some(Err(e)) if e.recoverable => {}
                Some(Err(e)) => return Err(ReplayError::Source(e)),
                None => {
                    return Err(ReplayError::NoFrame {
                        entry: self.at,
                        frame,
                        stamp,
                    });
                }
            }
        }
    }

    /// Whether all entries were executed.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.at == self.log.entries.len()
    }

    /// Estimated exposure timing.
    #[must_use]
    pub fn timing(&self) -> Timing {
        self.exchange.timing()
    }

    /// All tracked frames.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        self.exchange.trajectory()
    }

    /// The newest version of the map.
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        self.exchange.view()
    }

    /// All loop candidates and their outcomes.
    #[must_use]
    pub fn loops(&self) -> &[LoopReport] {
        self.exchange.loops()
    }

    /// The mapper's map, of which [`Replay::view`] is a view.
    #[must_use]
    pub fn map(&self) -> &Map {
        self.exchange.map()
    }

    /// The map at the end of the replay.
    #[must_use]
    pub fn into_map(self) -> Map {
        self.exchange.into_map()
    }
}
