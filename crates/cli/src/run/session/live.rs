//! One pass of a stream as a camera: every stage on a thread of its own.

use crate::args::run::LiveChoice;
use crate::console;
use crate::failure::Failure;
use crate::priority;
use crate::run::live_report::{LiveJson, LiveRun};
use crate::run::played::Watched;
use crate::run::session::listeners::{LossLine, ProgressLine, Rounds, Stop};
use crate::run::session::outputs::{EVENTS, LiveWriters, returned};
use crate::run::session::{Driver, Outputs, Session};
use crate::run::summary::DetectorJson;
use crate::run::tally::{End, Tally};
use crate::timing::Timing;
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;
use stillpoint::detection::Detector;
use stillpoint::imaging::{FrameId, FrameSource};
use stillpoint::live::{
    Delivery, Hook, LiveOptions, LiveResult, LiveSystem, Played, Stage, Subscribed,
};

/// The subscriber that shows how far a run is.
pub(crate) const PROGRESS: &str = "progress";

/// What a run is driven with, unless a test says otherwise.
pub(crate) fn options(choice: LiveChoice, timing: &'static Timing) -> LiveOptions {
    LiveOptions {
        drop_late: choice == LiveChoice::Newest,
        hook: Some(hook(timing)),
        // As what else is not urgent.
        subscriber_hook: Some(Arc::new(|_| priority::lower(Stage::Looping))),
        ..LiveOptions::default()
    }
}

/// What every thread does before it waits for its next message: set its priority once, and end a round of measuring.
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
    /// Plays the stream at its pace, to its end or until the user asks to stop. `budget`: what a frame may take, s.
    ///
    /// # Errors
    /// As [`Driver::drive`]; and no more threads.
    pub(crate) fn drive_live(
        self,
        source: &mut dyn FrameSource,
        outputs: &mut Outputs,
        choice: LiveChoice,
        budget: Option<f64>,
    ) -> Result<Session, Failure> {
        let options = LiveOptions {
            budget,
            ..options(choice, self.timing)
        };
        self.drive_with(source, outputs, choice, options)
    }

    fn drive_with(
        mut self,
        source: &mut dyn FrameSource,
        outputs: &mut Outputs,
        choice: LiveChoice,
        options: LiveOptions,
    ) -> Result<Session, Failure> {
        let stages = self.stages(true)?;
        let detector = DetectorJson::of(self.detector.as_deref());
        let mut live =
            LiveSystem::start(stages, self.detector.take(), options).map_err(Failure::thread)?;
        self.interrupt.begin();
        let stop = Stop::default();
        let listeners =
            LiveListeners::subscribe(&mut live, outputs, source.remaining(), &stop, self.timing)?;
        let mut skipped = 0;
        let start = Instant::now();
        let mut watched = Watched::new(source, &stop, self.timing);
        let played = live.play(&mut watched, self.interrupt.flag(), |e| {
            console::warn(&format!("skipped: {e}"));
            skipped += 1;
            listeners.skipped.fetch_add(1, Ordering::Relaxed);
        });
        let seconds = start.elapsed().as_secs_f64();
        let result = live.finish();
        let played = match played {
            Played::SourceFailed(e) => Err(Failure::input(e)),
            _ => Ok(()),
        };
        let (mut tally, writers) = listeners.join()?;
        tally.skipped += skipped;
        let rejoined = outputs.rejoin_live(writers);
        if let Err(failure) = played.and(rejoined) {
            outputs.rescue_map(result.map.as_ref(), &result.timing, tally.frames);
            return Err(failure);
        }
        self.check_frames(&tally)?;
        let remark = result.detector.as_deref().and_then(Detector::remark);
        let mut session = tally.close(End {
            trajectory: &result.trajectory,
            view: Arc::clone(&result.view),
            timing: result.timing,
            detector: DetectorJson { remark, ..detector },
            interrupted: self.interrupt.requested(),
            seconds,
        });
        session.fuse(outputs)?;
        session.saved = outputs.map.take().map(|file| match &result.map {
            Some(map) => file.save(map, Some(&result.timing), session.extensions()),
            None => Err(Failure::criteria(
                "the map is not saved: mapping ended in the midst of its work and left it in a state that cannot be used",
            )),
        });
        let per_second = session.detector.frames as f64 / seconds;
        session.live = Some(LiveRun {
            json: LiveJson::new(
                choice.name(),
                &result.statistics,
                &result.ended,
                per_second,
                watched.late(),
            ),
            latency_ms: latencies(&result),
            answer_ms: answers(&result),
        });
        session.log = Some(result.log);
        Ok(session)
    }
}

/// From each frame's arrival to its pose, ms.
fn latencies(result: &LiveResult) -> Vec<f64> {
    let frames = result.statistics.frames.iter();
    frames.map(|f| f.latency * 1e3).collect()
}

/// From the arrival of each frame that the detector answered for until tracking took the answer, ms.
fn answers(result: &LiveResult) -> Vec<(FrameId, f64)> {
    let answers = result.statistics.detections.iter();
    answers.map(|a| (a.frame, a.latency * 1e3)).collect()
}

/// Who listens to a live run.
struct LiveListeners {
    tally: Subscribed<Rounds<(Tally, LossLine)>>,
    writers: LiveWriters,
    progress: Subscribed<Rounds<ProgressLine>>,
    /// Frames that could not be read, for the progress line.
    skipped: Arc<AtomicUsize>,
}

impl LiveListeners {
    fn subscribe(
        live: &mut LiveSystem,
        outputs: &mut Outputs,
        frames: Option<usize>,
        stop: &Stop,
        timing: &'static Timing,
    ) -> Result<Self, Failure> {
        if let Some(view) = &outputs.view {
            view.begin(live.watch().view(), Some(live.watch()));
        }
        let progress = ProgressLine::of_live(frames, live.watch());
        let skipped = progress.skipped();
        let tally = Rounds {
            subscriber: (Tally::default(), LossLine::default()),
            timing,
        };
        let progress = Rounds {
            subscriber: progress,
            timing,
        };
        Ok(Self {
            tally: live
                .subscribe("tally", Delivery::until_full(EVENTS), tally)
                .map_err(Failure::thread)?,
            writers: outputs.subscribe(live, stop, timing)?,
            progress: live
                .subscribe(PROGRESS, Delivery::newest(1), progress)
                .map_err(Failure::thread)?,
            skipped,
        })
    }

    /// What was counted and what was written, when the run is over.
    fn join(self) -> Result<(Tally, LiveWriters), Failure> {
        // The result is whole without the progress line, which waits for a terminal that was stopped.
        match returned(self.progress) {
            Ok(progress) => progress.finish(),
            Err(failure) => console::warn(&format!("no progress is shown: {failure}")),
        }
        let (tally, _) = returned(self.tally)?;
        Ok((tally, self.writers))
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

    /// A detector that does this with every frame.
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

    /// Longer than any thread that ends at all takes to do so, however busy the machine is.
    const PATIENT: Duration = Duration::from_secs(600);

    /// A run of a few frames with this detector, in which each thread does this before it waits.
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
        let options = LiveOptions {
            detector_patience: patience,
            hook: Some(Arc::new(before)),
            ..options(LiveChoice::All, timing)
        };
        let mut outputs = Outputs::default();
        let mut source = simulator.source();
        let session = driver.drive_with(&mut source, &mut outputs, LiveChoice::All, options);
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
    fn a_detector_that_hangs_or_panics_costs_only_what_it_would_have_said() {
        // The run goes on once the detector hangs, so no time has to pass for it to be given up.
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
        assert_eq!(hanging.frames, 4);
        assert_eq!(hanging.final_poses.len(), 4);
        assert!(threads(&hanging).0.contains("given up"));
        let panicking = run(|| panic!("out of order"), |_| {}, PATIENT);
        assert_eq!(panicking.final_poses.len(), 4);
        let ends = threads(&panicking);
        assert_eq!(ends, ("panicked: out of order".into(), "finished".into()));
        // The result still names the detector.
        assert_eq!(panicking.detector.name, "does");
    }

    #[test]
    fn a_map_that_stops_growing_leaves_poses_and_a_log() {
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
        assert_eq!(session.final_poses.len(), 4);
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
