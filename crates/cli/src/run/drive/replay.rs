//! A pass that follows the log of a run.

use crate::failure::Failure;
use crate::run::drive::audience::Audience;
use crate::run::drive::{Driver, Engine};
use crate::run::session::Session;
use crate::run::summary::DetectorJson;
use crate::run::tally::End;
use crate::sink::Sinks;
use crate::timing::Timing;
use std::time::Instant;
use stillpoint::imaging::{FrameSource, RgbdFrame, SourceError};
use stillpoint::slam::{LogEntry, Replay, RunLog};

struct Repetition {
    replay: Replay,
    expected: u64,
    detector: DetectorJson,
    timing: &'static Timing,
    start: Instant,
}

impl Driver<'_> {
    /// Replays a log, to its end or until interrupted. The session says whether the trajectory equals that of the run. `detector` describes
    /// the run's detector.
    ///
    /// # Errors
    /// Those of [`Driver::drive`], and a log that does not match the stages or the frames.
    pub(crate) fn drive_replay(
        mut self,
        source: &mut dyn FrameSource,
        sinks: &mut Sinks,
        log: RunLog,
        detector: DetectorJson,
    ) -> Result<Session, Failure> {
        let expected = log.trajectory;
        let is_frame = |entry: &&LogEntry| matches!(entry, LogEntry::TrackFrame { .. });
        let frames = log.entries.iter().filter(is_frame).count();
        let replay = Replay::new(self.stages(false)?, log).map_err(Failure::input)?;
        self.interrupt.begin();
        let audience = Audience::here(sinks, &replay.view(), Some(frames));
        let engine = Repetition {
            replay,
            expected,
            detector,
            timing: self.timing,
            start: Instant::now(),
        };
        self.pass(engine, audience, source, sinks)
    }
}

impl Engine for Repetition {
    fn step(
        &mut self,
        source: &mut dyn FrameSource,
        audience: &mut Audience,
    ) -> Result<bool, Failure> {
        let step = self.replay.step(&mut Waited(source));
        let Some(events) = step.map_err(Failure::input)? else {
            return Ok(false);
        };
        audience.receive_all(&events);
        // Each message is a timing round, as on the threads of a live run.
        if events.iter().any(|event| event.as_frame().is_some()) {
            self.timing.end_frame();
        } else {
            self.timing.end_round();
        }
        Ok(true)
    }

    fn end(self, _: &mut Audience, interrupted: bool) -> End {
        let (replay, seconds) = (self.replay, self.start.elapsed().as_secs_f64());
        let view = replay.view();
        let agrees = replay.trajectory().digest(&view) == self.expected;
        End {
            trajectory: replay.trajectory().clone(),
            view,
            timing: replay.timing(),
            detector: self.detector,
            interrupted,
            seconds,
            log: None,
            agrees: replay.is_over().then_some(agrees),
            live: None,
            map: Some(replay.into_map()),
        }
    }
}

struct Waited<'a>(&'a mut dyn FrameSource);

impl FrameSource for Waited<'_> {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        tracing::info_span!("wait").in_scope(|| self.0.next_frame())
    }

    fn remaining(&self) -> Option<usize> {
        self.0.remaining()
    }
}
