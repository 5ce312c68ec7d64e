//! One pass of a stream as the log of a live run has it.

use crate::console::Progress;
use crate::failure::Failure;
use crate::run::played::Passing;
use crate::run::session::{Driver, Outputs, Session};
use crate::run::summary::DetectorJson;
use crate::run::tally::{End, Tally};
use std::time::Instant;
use stillpoint::imaging::FrameSource;
use stillpoint::slam::{Event, LogEntry, Replay, RunLog};

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
        let mut replay = Replay::new(self.stages()?, log).map_err(Failure::input)?;
        let mut tally = Tally::default();
        let start = Instant::now();
        let progress = Progress::new(Some(frames));
        let carried_out = self.carry_out(&mut replay, source, outputs, &mut tally, progress);
        let view = replay.view();
        let whole = match carried_out {
            Ok(whole) => whole,
            Err(failure) => {
                outputs.rescue_map(Some(&replay.into_map()), tally.frames);
                return Err(failure);
            }
        };
        self.check_frames(&tally)?;
        let agrees = replay.trajectory().digest(&view) == expected;
        let mut session = tally.close(End {
            trajectory: replay.trajectory(),
            view,
            detector,
            interrupted: self.interrupt.requested(),
            seconds: start.elapsed().as_secs_f64(),
        });
        let map = outputs.map.take();
        session.saved = map.map(|file| file.save(&replay.into_map()));
        Ok((session, whole.then_some(agrees)))
    }

    /// Whether all was carried out.
    fn carry_out(
        &self,
        replay: &mut Replay,
        source: &mut dyn FrameSource,
        outputs: &mut Outputs,
        tally: &mut Tally,
        mut progress: Progress,
    ) -> Result<bool, Failure> {
        let passing = Passing::new(outputs.overlay.as_ref().map(|folder| folder.every()));
        let mut source = passing.watch(source);
        while !self.interrupt.requested() {
            let step = replay.step(&mut source);
            let Some(events) = step.map_err(Failure::input)? else {
                progress.finish();
                return Ok(true);
            };
            tally.take(&events);
            for event in &events {
                let kept = match event {
                    Event::Frame(report) => passing.leave(report.frame),
                    _ => None,
                };
                outputs.take(std::slice::from_ref(event), kept.as_ref())?;
                if matches!(event, Event::Frame(_)) {
                    self.timing.end_frame();
                    progress.show(tally.frames, &tally.note());
                }
            }
        }
        progress.finish();
        Ok(false)
    }
}
