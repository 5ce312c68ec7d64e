//! One pass of a stream as the log of a run has it.

use crate::failure::Failure;
use crate::run::session::listeners::{Listeners, ProgressLine, Stop};
use crate::run::session::outputs::Writers;
use crate::run::session::{Driver, Outputs, Session};
use crate::run::summary::DetectorJson;
use crate::run::tally::{End, Tally};
use std::time::Instant;
use stillpoint::imaging::{FrameSource, RgbdFrame, SourceError};
use stillpoint::slam::{LogEntry, Replay, RunLog, Subscriber};

impl Driver<'_> {
    /// Carries out a log, to its end or until the user asks to stop. Says at the end whether the trajectory is that of the
    /// run.
    ///
    /// # Errors
    /// As [`Driver::drive`]; and a log that does not fit the stages or the frames.
    pub(crate) fn drive_replay(
        mut self,
        source: &mut dyn FrameSource,
        outputs: &mut Outputs,
        log: RunLog,
        detector: DetectorJson,
    ) -> Result<(Session, Option<bool>), Failure> {
        let expected = log.trajectory;
        let is_frame = |entry: &&LogEntry| matches!(entry, LogEntry::TrackFrame { .. });
        let frames = log.entries.iter().filter(is_frame).count();
        let mut replay = Replay::new(self.stages(false)?, log).map_err(Failure::input)?;
        self.interrupt.begin();
        if let Some(view) = &outputs.view {
            view.begin(replay.view(), None);
        }
        let stop = Stop::default();
        let mut listeners = Listeners {
            tally: Tally::default(),
            writers: outputs.listen(&stop),
            progress: ProgressLine::new(Some(frames)),
        };
        let start = Instant::now();
        let carried_out = self.carry_out(&mut replay, source, &mut listeners, &stop);
        listeners.progress.finish();
        let view = replay.view();
        let Listeners { tally, writers, .. } = listeners;
        if let Err(failure) = outputs.rejoin(writers).and(carried_out) {
            outputs.rescue_map(Some(replay.map()), &replay.timing(), tally.frames);
            return Err(failure);
        }
        let whole = replay.is_over();
        self.check_frames(&tally)?;
        let agrees = replay.trajectory().digest(&view) == expected;
        let mut session = tally.close(End {
            trajectory: replay.trajectory(),
            view,
            timing: replay.timing(),
            detector,
            interrupted: self.interrupt.requested(),
            seconds: start.elapsed().as_secs_f64(),
        });
        session.fuse(outputs)?;
        let map = outputs.map.take();
        let timing = replay.timing();
        session.saved =
            map.map(|file| file.save(&replay.into_map(), Some(&timing), session.extensions()));
        Ok((session, whole.then_some(agrees)))
    }

    /// Carries out entries until all are done, the user asks to stop, or a listener cannot go on.
    fn carry_out(
        &self,
        replay: &mut Replay,
        source: &mut dyn FrameSource,
        listeners: &mut Listeners<Writers>,
        stop: &Stop,
    ) -> Result<(), Failure> {
        let mut source = Waited(source);
        while !self.interrupt.requested() && !stop.requested() {
            let step = replay.step(&mut source);
            let Some(events) = step.map_err(Failure::input)? else {
                return Ok(());
            };
            listeners.receive_all(&events);
            // Every message is a round of its own, as on the threads of a live run.
            if events.iter().any(|event| event.as_frame().is_some()) {
                self.timing.end_frame();
            } else {
                self.timing.end_round();
            }
        }
        Ok(())
    }
}

/// A source for which it is measured how long it is waited for.
struct Waited<'a>(&'a mut dyn FrameSource);

impl FrameSource for Waited<'_> {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        tracing::info_span!("wait").in_scope(|| self.0.next_frame())
    }

    fn remaining(&self) -> Option<usize> {
        self.0.remaining()
    }
}
