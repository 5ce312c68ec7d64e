//! A live pass: every stage on its own thread, at camera rate.

use crate::failure::Failure;
use crate::priority;
use crate::run::drive::audience::Audience;
use crate::run::drive::{Driver, Engine};
use crate::run::played::Watched;
use crate::run::session::Session;
use crate::run::summary::DetectorJson;
use crate::run::tally::{End, Measured};
use crate::sink::Sinks;
use crate::timing::Timing;
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;
use stillpoint::detection::Detector;
use stillpoint::imaging::FrameSource;
use stillpoint::live::{Hook, LiveOptions, LiveSystem, Played, Stage};

/// Frame selection of a live run, and its time budget.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Choice {
    pub(crate) name: &'static str,
    /// A late frame is dropped in favour of the next one.
    pub(crate) drops_late: bool,
    pub(crate) budget: Option<f64>,
}

fn options(choice: Choice, timing: &'static Timing) -> LiveOptions {
    LiveOptions {
        drop_late: choice.drops_late,
        budget: choice.budget,
        hook: Some(hook(timing)),
        // As other threads that are not urgent.
        subscriber_hook: Some(Arc::new(|_| priority::lower(Stage::Looping))),
        ..LiveOptions::default()
    }
}

/// Hook that every thread calls before it waits for a message: sets its priority once, and ends a timing round.
fn hook(timing: &'static Timing) -> Hook {
    thread_local! {
        static LOWERED: Cell<bool> = const { Cell::new(false) };
    }
    Arc::new(move |stage| {
        if !LOWERED.replace(true) {
            priority::lower(stage);
        }
        match stage {
            Stage::Tracking => timing.end_frame(),
            _ => timing.end_round(),
        }
    })
}

impl Driver<'_> {
    /// Plays the stream at its pace, to its end or until interrupted.
    ///
    /// # Errors
    /// Those of [`Driver::drive`], and threads that cannot be started.
    pub(crate) fn drive_live(
        self,
        source: &mut dyn FrameSource,
        sinks: &mut Sinks,
        choice: Choice,
    ) -> Result<Session, Failure> {
        let options = options(choice, self.timing);
        self.drive_with(source, sinks, choice, options)
    }

    fn drive_with(
        mut self,
        source: &mut dyn FrameSource,
        sinks: &mut Sinks,
        choice: Choice,
        options: LiveOptions,
    ) -> Result<Session, Failure> {
        let stages = self.stages(true)?;
        let detector = DetectorJson::of(self.detector.as_deref());
        let mut live =
            LiveSystem::start(stages, self.detector.take(), options).map_err(Failure::thread)?;
        self.interrupt.begin();
        let audience = Audience::apart(sinks, &mut live, source.remaining(), self.timing)?;
        let engine = Live {
            live,
            interrupted: self.interrupt.flag(),
            timing: self.timing,
            frames: choice.name,
            detector,
            seconds: 0.0,
            late: Vec::new(),
        };
        self.pass(engine, audience, source, sinks)
    }
}

struct Live<'a> {
    live: LiveSystem,
    interrupted: &'a AtomicBool,
    timing: &'static Timing,
    frames: &'static str,
    detector: DetectorJson,
    /// From the first frame to the last, s.
    seconds: f64,
    late: Vec<f64>,
}

impl Engine for Live<'_> {
    /// Processes the whole stream, since it sets its own pace.
    fn step(
        &mut self,
        source: &mut dyn FrameSource,
        audience: &mut Audience,
    ) -> Result<bool, Failure> {
        let start = Instant::now();
        let mut watched = Watched::new(source, audience.stop(), self.timing);
        let played = self
            .live
            .play(&mut watched, self.interrupted, |e| audience.skip(&e));
        self.seconds = start.elapsed().as_secs_f64();
        self.late = watched.late().to_vec();
        match played {
            Played::SourceFailed(e) => Err(Failure::input(e)),
            _ => Ok(false),
        }
    }

    fn end(self, _: &mut Audience, interrupted: bool) -> End {
        let result = self.live.finish();
        let remark = result.detector.as_deref().and_then(Detector::remark);
        End {
            trajectory: result.trajectory,
            view: result.view,
            map: result.map,
            timing: result.timing,
            detector: DetectorJson {
                remark,
                ..self.detector
            },
            interrupted,
            seconds: self.seconds,
            log: Some(result.log),
            agrees: None,
            live: Some(Measured {
                frames: self.frames,
                statistics: result.statistics,
                ended: result.ended,
                late: self.late,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interrupt::Interrupt;
    use std::sync::OnceLock;
    use std::time::Duration;
    use stillpoint::detection::{DetectError, Detections, DetectorInfo, DetectorKind};
    use stillpoint::imaging::{RgbdFrame, Simd};
    use stillpoint::simulator::{Simulator, SimulatorConfig};
    use stillpoint::slam::{Config, Loops, Replay, Stages};

    /// A detector that calls this function for every frame.
    struct Does(fn());

    impl Detector for Does {
        fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
            self.0();
            Ok(Detections {
                frame: frame.id,
                stamp: frame.stamp,
                items: Vec::new(),
            })
        }

        fn info(&self) -> DetectorInfo {
            DetectorInfo::new(DetectorKind::Scripted, "does")
        }
    }

    /// Longer than any thread takes to end on a busy machine.
    const PATIENT: Duration = Duration::from_secs(600);

    /// Runs a few frames with this detector; each thread calls `before` before it waits.
    fn run(detector: fn(), before: fn(Stage), patience: Duration) -> Session {
        let simulator = Simulator::new(&SimulatorConfig {
            scene: "xyz".to_owned(),
            frames: Some(4),
            ..SimulatorConfig::default()
        })
        .unwrap();
        let timing: &'static Timing = Box::leak(Box::default());
        let driver = Driver {
            config: Config::default(),
            camera: *simulator.camera(),
            imu: None,
            odometry: None,
            simd: Simd::detect(),
            timing,
            interrupt: &Interrupt::default(),
            detector: Some(Box::new(Does(detector))),
            map: None,
        };
        let all = Choice {
            name: "all",
            drops_late: false,
            budget: None,
        };
        let options = LiveOptions {
            detector_patience: patience,
            hook: Some(Arc::new(before)),
            ..options(all, timing)
        };
        let mut sinks = Sinks::default();
        let mut source = simulator.source();
        let session = driver.drive_with(&mut source, &mut sinks, all, options);
        session.unwrap()
    }

    fn threads(session: &Session) -> (String, String) {
        let live = &session.live.as_ref().unwrap().json;
        let failed = live.tell();
        let t = &live.threads;
        let ends = (t.detection.clone().unwrap(), t.mapping.clone());
        let finished = |end: &String| usize::from(end != "finished");
        assert_eq!(failed, finished(&ends.0) + finished(&ends.1));
        ends
    }

    #[test]
    fn hanging_or_panicking_detector_loses_only_detections() {
        // The run continues once the detector hangs, so that giving up on it needs no waiting time.
        static HANGS: OnceLock<()> = OnceLock::new();
        let hang = || {
            HANGS.get_or_init(|| ());
            loop {
                std::thread::park();
            }
        };
        let until_it_hangs = |stage| {
            thread_local! {
                static FRAMES: Cell<u32> = const { Cell::new(0) };
            }
            if stage == Stage::Tracking && FRAMES.replace(FRAMES.get() + 1) == 1 {
                HANGS.wait();
            }
        };
        let hanging = run(hang, until_it_hangs, Duration::ZERO);
        assert_eq!(hanging.tracking.frames, 4);
        assert_eq!(hanging.poses.final_poses.len(), 4);
        assert!(threads(&hanging).0.contains("given up"));
        let panicking = run(|| panic!("out of order"), |_| {}, PATIENT);
        assert_eq!(panicking.poses.final_poses.len(), 4);
        let ends = threads(&panicking);
        assert_eq!(ends, ("panicked: out of order".into(), "finished".into()));
        // The result still names the detector.
        assert_eq!(panicking.stages.detector.name, "does");
    }

    #[test]
    fn mapping_failure_keeps_poses_and_log() {
        let session = run(
            || {},
            |stage| {
                thread_local! {
                    static CALLS: Cell<u32> = const { Cell::new(0) };
                }
                CALLS.set(CALLS.get() + 1);
                if stage == Stage::Mapping && CALLS.get() == 2 {
                    panic!("no room");
                }
            },
            PATIENT,
        );
        assert_eq!(session.poses.final_poses.len(), 4);
        assert_eq!(
            threads(&session),
            ("finished".into(), "panicked: no room".into())
        );
        let log = session.log.unwrap();
        let simulator = SimulatorConfig {
            scene: "xyz".to_owned(),
            frames: Some(4),
            ..SimulatorConfig::default()
        };
        let simulator = Simulator::new(&simulator).unwrap();
        let stages = Stages::new(Config::default(), *simulator.camera(), Simd::detect());
        let mut replay = Replay::new(stages.unwrap(), log).unwrap();
        let mut nobody = None::<Loops>;
        replay.run(&mut simulator.source(), &mut nobody).unwrap();
    }
}
