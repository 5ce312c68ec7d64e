//! A pass in one thread, frame by frame.

use crate::failure::Failure;
use crate::run::drive::audience::Audience;
use crate::run::drive::{Driver, Engine};
use crate::run::session::Session;
use crate::run::summary::DetectorJson;
use crate::run::tally::End;
use crate::sink::Sinks;
use crate::timing::Timing;
use std::time::Instant;
use stillpoint::detection::Detector;
use stillpoint::imaging::FrameSource;
use stillpoint::slam::System;

struct Inline {
    system: System,
    timing: &'static Timing,
    start: Instant,
}

impl Driver<'_> {
    /// Runs the stream to its end, or until interrupted.
    ///
    /// # Errors
    /// A configuration out of range, a stream that fails permanently or has no readable frame, outputs that cannot be written.
    pub(crate) fn drive(
        mut self,
        source: &mut dyn FrameSource,
        sinks: &mut Sinks,
    ) -> Result<Session, Failure> {
        let mut system = System::from(self.stages(false)?).with_log();
        self.interrupt.begin();
        if let Some(detector) = self.detector.take() {
            system = system.with_detector(detector);
        }
        let audience = Audience::here(sinks, &system.view(), source.remaining());
        let engine = Inline {
            system,
            timing: self.timing,
            start: Instant::now(),
        };
        self.pass(engine, audience, source, sinks)
    }
}

impl Engine for Inline {
    fn step(
        &mut self,
        source: &mut dyn FrameSource,
        audience: &mut Audience,
    ) -> Result<bool, Failure> {
        let next = tracing::info_span!("wait").in_scope(|| source.next_frame());
        match next {
            None => return Ok(false),
            Some(Ok(frame)) => {
                let system = &mut self.system;
                system.receive_inertial(source.take_inertial());
                system.receive_odometry(source.take_odometry());
                let events = tracing::info_span!("total").in_scope(|| system.step(frame));
                audience.receive_all(&events);
                self.timing.end_frame();
            }
            Some(Err(e)) if e.recoverable => audience.skip(&e),
            Some(Err(e)) => return Err(Failure::input(e)),
        }
        Ok(true)
    }

    fn end(mut self, audience: &mut Audience, interrupted: bool) -> End {
        audience.receive_all(&self.system.finish());
        let seconds = self.start.elapsed().as_secs_f64();
        let system = self.system;
        End {
            trajectory: system.trajectory().clone(),
            view: system.view(),
            timing: system.timing(),
            detector: DetectorJson {
                remark: system.detector().and_then(Detector::remark),
                ..DetectorJson::of(system.detector())
            },
            interrupted,
            seconds,
            log: system.log(),
            agrees: None,
            live: None,
            map: Some(system.into_map()),
        }
    }
}
