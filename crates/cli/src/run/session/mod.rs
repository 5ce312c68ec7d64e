//! One pass of a stream of frames through the system.
//!
//! Answers: which frames went in, which came out with a pose, what the map was in the end. Knows nothing of where the
//! frames come from or where results go.

pub(crate) mod listeners;
pub(crate) mod live;
pub(crate) mod outputs;
pub(crate) mod replay;

use crate::config;
use crate::dense::Fused;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::map::file::SavedMap;
use crate::run::live_report::LiveRun;
use crate::run::session::listeners::{Listeners, ProgressLine, Stop};
pub(crate) use crate::run::session::outputs::Outputs;
use crate::run::session::outputs::Writers;
use crate::run::submaps::Submap;
use crate::run::summary::{
    DetectorJson, FeaturesJson, InertialJson, LoopsJson, LostStretch, OdometryJson, StillStretch,
    SubmapJson,
};
use crate::run::tally::{End, Tally};
use crate::things::Gathered;
use crate::timing::Timing;
use std::sync::Arc;
use std::time::Instant;
use stillpoint::datasets::StampedPose;
use stillpoint::dense::FinalPose;
use stillpoint::detection::Detector;
use stillpoint::geometry::{Camera, ImuModel, OdometryModel};
use stillpoint::imaging::{FrameId, FrameSource, Simd};
use stillpoint::map::{Extension, Map, MapView};
use stillpoint::slam::{Config, MapUse, RunLog, Stages, Subscriber, System, Up};

/// What a pass gave.
pub(crate) struct Session {
    /// Frames that went through the system.
    pub(crate) frames: usize,
    /// Frames that could not be read.
    pub(crate) skipped: usize,
    /// Frames with a pose that were tracked while it was undecided who moves.
    pub(crate) undecided: usize,
    /// When the parts of a frame are exposed, as estimated in the end.
    pub(crate) timing: stillpoint::slam::Timing,
    /// Stretches of frames without a pose.
    pub(crate) lost: Vec<LostStretch>,
    /// Stretches of frames that repeat an image.
    pub(crate) still: Vec<StillStretch>,
    /// What the detector was and did.
    pub(crate) detector: DetectorJson,
    /// What the static filter did.
    pub(crate) features: FeaturesJson,
    /// What became of the candidates for loops.
    pub(crate) loops: LoopsJson,
    /// The inertial sensor, where there was one.
    pub(crate) inertial: Option<InertialJson>,
    /// The odometry, where there was any.
    pub(crate) odometry: Option<OdometryJson>,
    /// The user ended it early.
    pub(crate) interrupted: bool,
    /// From the first frame to the last, s.
    pub(crate) seconds: f64,
    /// Final poses of the tracked frames.
    pub(crate) final_poses: Vec<StampedPose>,
    /// Their frames.
    pub(crate) of_frames: Vec<FrameId>,
    /// Poses as known at each of these frames; without those that were in another submap then, whose poses were in another frame of
    /// reference.
    pub(crate) online_poses: Vec<StampedPose>,
    /// Poses in other submaps, each in a frame of reference of its own.
    pub(crate) other_submaps: Vec<Submap>,
    /// All submaps; the first is that of the poses above.
    pub(crate) submaps: Vec<SubmapJson>,
    /// What became of every frame, as `frames.csv` has it.
    pub(crate) frames_csv: String,
    /// Final poses of the keyframes of the first submap.
    pub(crate) keyframes: Vec<StampedPose>,
    /// Which way is up: as users say, else as the inertial sensor does, else as the map had it before.
    pub(crate) up: Option<Up>,
    /// The final map.
    pub(crate) view: Arc<MapView>,
    /// Where it was saved, or why it could not be; nothing when it was not to be.
    pub(crate) saved: Option<Result<SavedMap, Failure>>,
    /// The surface, fused; nothing when it was not to be.
    pub(crate) dense: Option<Fused>,
    /// What stands in the room, if it was looked for or known.
    pub(crate) things: Option<Gathered>,
    /// In which order the stages took their messages; none of a replay, which has it from the run.
    pub(crate) log: Option<RunLog>,
    /// What was measured of a live run.
    pub(crate) live: Option<LiveRun>,
}

impl Session {
    /// Fuses at the final poses what was to be fused.
    pub(crate) fn fuse(&mut self, outputs: &mut Outputs) -> Result<(), Failure> {
        let of = |(frame, pose): (&FrameId, &StampedPose)| FinalPose {
            frame: *frame,
            stamp: pose.stamp,
            world_from_camera: pose.world_from_camera,
        };
        let poses: Vec<FinalPose> = self
            .of_frames
            .iter()
            .zip(&self.final_poses)
            .map(of)
            .collect();
        let measured = self.inertial.as_ref().and_then(|i| i.up);
        let measured = measured.and_then(|up| Up::along(&up.into()));
        self.up = outputs.named_up.or(measured).or(outputs.known_up);
        self.dense = outputs.fuse(&poses, self.up);
        self.things = outputs.gather(&self.view);
        if let (Some(fused), Some(record)) = (&self.dense, &mut outputs.record) {
            record.surface(fused)?;
        }
        Ok(())
    }

    /// What a map file keeps beside the map.
    pub(crate) fn extensions(&self) -> Vec<Extension> {
        let dense = self.dense.as_ref().map(Fused::extension);
        let things = self.things.as_ref().map(Gathered::extension);
        let up = self.up.as_ref().map(Up::to_extension);
        up.into_iter().chain(dense).chain(things).collect()
    }
}

/// Means of a pass.
pub(crate) struct Driver<'a> {
    pub(crate) config: Config,
    pub(crate) camera: Camera,
    /// The inertial sensor that is fixed to it, if it is to be listened to.
    pub(crate) imu: Option<ImuModel>,
    /// The odometry of the base that carries it, if it is to be listened to.
    pub(crate) odometry: Option<OdometryModel>,
    pub(crate) simd: Simd,
    pub(crate) timing: &'static Timing,
    pub(crate) interrupt: &'a Interrupt,
    pub(crate) detector: Option<Box<dyn Detector>>,
    /// A map to begin with, and what is done with it.
    pub(crate) map: Option<(Map, MapUse)>,
}

impl Driver<'_> {
    /// Runs the stream to its end, or until the user asks to stop.
    ///
    /// # Errors
    /// A configuration out of range, a stream that fails for good, a stream without any readable frame, outputs that cannot
    /// be written.
    pub(crate) fn drive(
        mut self,
        source: &mut dyn FrameSource,
        outputs: &mut Outputs,
    ) -> Result<Session, Failure> {
        let mut system = System::from(self.stages(false)?).with_log();
        self.interrupt.begin();
        if let Some(detector) = self.detector.take() {
            system = system.with_detector(detector);
        }
        if let Some(view) = &outputs.view {
            view.begin(system.view(), None);
        }
        let stop = Stop::default();
        let mut listeners = Listeners {
            tally: Tally::default(),
            writers: outputs.listen(&stop),
            progress: ProgressLine::new(source.remaining()),
        };
        let start = Instant::now();
        let taken = self.take_frames(source, &mut system, &mut listeners, &stop);
        listeners.receive_all(&system.finish());
        listeners.progress.finish();
        let Listeners { tally, writers, .. } = listeners;
        if let Err(failure) = outputs.rejoin(writers).and(taken) {
            outputs.rescue_map(Some(system.map()), &system.timing(), tally.frames);
            return Err(failure);
        }
        self.check_frames(&tally)?;
        let mut session = tally.close(End {
            trajectory: system.trajectory(),
            view: system.view(),
            timing: system.timing(),
            detector: DetectorJson {
                remark: system.detector().and_then(Detector::remark),
                ..DetectorJson::of(system.detector())
            },
            interrupted: self.interrupt.requested(),
            seconds: start.elapsed().as_secs_f64(),
        });
        session.log = system.log();
        session.fuse(outputs)?;
        // What was found until then is worth having even when the map cannot be saved.
        let timing = system.timing();
        let map = outputs.map.take();
        session.saved = map.map(|map| map.save(system.map(), Some(&timing), session.extensions()));
        Ok(session)
    }

    /// The stages, with the map that is there before the first frame.
    pub(crate) fn stages(&mut self, live: bool) -> Result<Stages, Failure> {
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

    /// Whether any frame went through the system.
    pub(crate) fn check_frames(&self, tally: &Tally) -> Result<(), Failure> {
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

    /// Lets the frames go by, until the stream ends, the user asks to stop, or a listener cannot go on.
    fn take_frames(
        &self,
        source: &mut dyn FrameSource,
        system: &mut System,
        listeners: &mut Listeners<Writers>,
        stop: &Stop,
    ) -> Result<(), Failure> {
        while !self.interrupt.requested() && !stop.requested() {
            let next = tracing::info_span!("wait").in_scope(|| source.next_frame());
            match next {
                None => break,
                Some(Ok(frame)) => {
                    system.receive_inertial(source.take_inertial());
                    system.receive_odometry(source.take_odometry());
                    let events = tracing::info_span!("total").in_scope(|| system.step(frame));
                    listeners.receive_all(&events);
                    self.timing.end_frame();
                }
                Some(Err(e)) if e.recoverable => listeners.skip(&e),
                Some(Err(e)) => return Err(Failure::input(e)),
            }
        }
        Ok(())
    }
}
