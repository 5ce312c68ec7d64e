//! Replay: runs again what threads and clocks decided, from the log of a run.
//!
//! Answers: what the stages said when they took these messages in this order. The same stages, frames and log give the same
//! events, trajectory and map as the run that left the log, bit for bit; no network is needed, since what the detector said
//! is in the log.

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

/// A log cannot be run again.
#[derive(Debug)]
#[non_exhaustive]
pub enum ReplayError {
    /// The log was made with another configuration, camera or first map.
    OtherStages,
    /// The source has no such frame.
    NoFrame {
        /// Number of the entry, from 0.
        entry: usize,
        /// The frame.
        frame: FrameId,
        /// Its colour stamp, s.
        stamp: f64,
    },
    /// The source failed.
    Source(SourceError),
    /// The entry takes a message that nobody sent: these are not the frames or not the program of that run.
    NotSent {
        /// Number of the entry, from 0.
        entry: usize,
        /// What was taken, and what was sent instead.
        error: NotSent,
    },
    /// All messages were taken, and another trajectory came out.
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

/// Runs a log again: an [`Exchange`] that carries out its entries, one after the other.
pub struct Replay {
    exchange: Exchange,
    log: RunLog,
    /// Number of the next entry.
    at: usize,
}

impl Replay {
    /// A replay of a log by stages that are as those of the run were before its first frame.
    ///
    /// # Errors
    /// [`ReplayError::OtherStages`] when they are not.
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

    /// Carries out the next entry, for which the source is asked if it is a frame, and says what happened: one event at most. `None`
    /// when there is no further entry. The source yields the frames of the run and may yield others between them.
    ///
    /// # Errors
    /// [`ReplayError`] when the log does not fit the frames. The replay cannot be resumed after that.
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

    /// Carries out all entries that are left, and compares the trajectory with that of the run. The subscriber receives every event.
    ///
    /// # Errors
    /// [`ReplayError`] when the log does not fit the frames, or the trajectory is another.
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

    /// Reads on to a frame.
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
                // Frames that the run dropped, or could not read either.
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

    /// Whether every entry was carried out.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.at == self.log.entries.len()
    }

    /// When the parts of a frame are exposed, as estimated so far.
    #[must_use]
    pub fn timing(&self) -> Timing {
        self.exchange.timing()
    }

    /// The frames tracked so far.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        self.exchange.trajectory()
    }

    /// The newest version of the map.
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        self.exchange.view()
    }

    /// All loop candidates so far and their outcomes.
    #[must_use]
    pub fn loops(&self) -> &[LoopReport] {
        self.exchange.loops()
    }

    /// The map as the mapper has it now: that of [`Replay::view`].
    #[must_use]
    pub fn map(&self) -> &Map {
        self.exchange.map()
    }

    /// The map, when the replay is over.
    #[must_use]
    pub fn into_map(self) -> Map {
        self.exchange.into_map()
    }
}
