//! One pass of a stream of frames through the system.
//!
//! [`Driver::pass`] is the common loop; [`inline`], [`live`] and [`replay`] implement its step. Independent of the source of the frames and
//! of the outputs.

mod audience;
mod inline;
mod lines;
pub(crate) mod live;
mod replay;

use crate::config;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::run::drive::audience::Audience;
use crate::run::session::Session;
use crate::run::tally::{End, Tally};
use crate::sink::{Left, Sinks};
use crate::timing::Timing;
use stillpoint::detection::Detector;
use stillpoint::geometry::{Camera, ImuModel, OdometryModel};
use stillpoint::imaging::{FrameSource, Simd};
use stillpoint::map::Map;
use stillpoint::slam::{Config, MapUse, Stages};

pub(crate) struct Driver<'a> {
    pub(crate) config: Config,
    pub(crate) camera: Camera,
    /// The inertial sensor fixed to the camera, if used.
    pub(crate) imu: Option<ImuModel>,
    /// The odometry of the base that carries it, if used.
    pub(crate) odometry: Option<OdometryModel>,
    pub(crate) simd: Simd,
    pub(crate) timing: &'static Timing,
    pub(crate) interrupt: &'a Interrupt,
    pub(crate) detector: Option<Box<dyn Detector>>,
    /// The initial map, and how it is used.
    pub(crate) map: Option<(Map, MapUse)>,
}

trait Engine {
    /// Processes the next part of the stream; false at its end.
    ///
    /// # Errors
    /// A stream that fails permanently, or does not match the log.
    fn step(
        &mut self,
        source: &mut dyn FrameSource,
        audience: &mut Audience,
    ) -> Result<bool, Failure>;

    /// Completes pending work.
    fn end(self, audience: &mut Audience, interrupted: bool) -> End;
}

impl Driver<'_> {
    /// Processes the stream to its end, or until interrupted or a sink fails.
    ///
    /// # Errors
    /// A stream that fails permanently or has no readable frame, outputs that cannot be written. The sinks then save their data where
    /// possible.
    fn pass(
        &self,
        mut engine: impl Engine,
        mut audience: Audience,
        source: &mut dyn FrameSource,
        sinks: &mut Sinks,
    ) -> Result<Session, Failure> {
        let carried = self.carry_out(&mut engine, &mut audience, source);
        let end = engine.end(&mut audience, self.interrupt.requested());
        let (tally, written) = audience.leave(sinks)?;
        if let Err(failure) = written.and(carried) {
            sinks.rescue(&Left {
                map: end.map.as_ref(),
                timing: end.timing,
                frames: tally.frames,
            });
            return Err(failure);
        }
        self.check_frames(&tally)?;
        Ok(tally.close(end))
    }

    fn carry_out(
        &self,
        engine: &mut impl Engine,
        audience: &mut Audience,
        source: &mut dyn FrameSource,
    ) -> Result<(), Failure> {
        while !self.interrupt.requested() && !audience.stop().requested() {
            if !engine.step(source, audience)? {
                break;
            }
        }
        Ok(())
    }

    fn stages(&mut self, live: bool) -> Result<Stages, Failure> {
        let stages =
            Stages::new(self.config.clone(), self.camera, self.simd).map_err(Failure::input)?;
        let stages = stages.with_workers(config::workers(live)?);
        let stages = match self.imu {
            Some(imu) => stages.with_imu(imu).map_err(Failure::input)?,
            None => stages,
        };
        let stages = match self.odometry {
            Some(wheels) => stages.with_odometry(wheels).map_err(Failure::input)?,
            None => stages,
        };
        match self.map.take() {
            None => Ok(stages),
            Some((map, map_use)) => stages.with_map(map, map_use).map_err(Failure::input),
        }
    }

    fn check_frames(&self, tally: &Tally) -> Result<(), Failure> {
        match tally.frames {
            0 if self.interrupt.requested() => Err(Failure::criteria(
                "interrupted before the first frame: nothing was written",
            )),
            0 => Err(Failure::input(format!(
                "expected frames, found none that can be read ({} skipped); check the images",
                tally.skipped
            ))),
            _ => Ok(()),
        }
    }
}
