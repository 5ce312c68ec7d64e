//! One pass of a stream as a camera: every stage on a thread of its own.

use crate::args::run::LiveChoice;
use crate::console::{self, Progress};
use crate::failure::Failure;
use crate::run::live_report::{LiveJson, LiveRun};
use crate::run::played::{Drawing, Passing};
use crate::run::priority;
use crate::run::session::{Driver, Outputs, Session};
use crate::run::summary::DetectorJson;
use crate::run::tally::{End, Tally};
use crate::timing::Timing;
use std::cell::Cell;
use std::sync::Arc;
use std::time::Instant;
use stillpoint::detection::Detector;
use stillpoint::imaging::{FrameId, FrameSource};
use stillpoint::live::{Hook, LiveOptions, LiveResult, LiveSystem, Played, Stage, Told, Watch};
use stillpoint::slam::{Event, FrameReport, Health};

/// What a run is driven with, unless a test says otherwise.
pub(crate) fn options(choice: LiveChoice, timing: &'static Timing) -> LiveOptions {
    LiveOptions {
        drop_late: choice == LiveChoice::Newest,
        hook: Some(hook(timing)),
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
        let stages = self.stages()?;
        let detector = DetectorJson::of(self.detector.as_deref());
        let passing = Passing::new(outputs.overlay.as_ref().map(|folder| folder.every()));
        let mut listener = Listener::new(outputs, &passing, self.timing, source.remaining());
        listener.begin_to_draw(choice)?;
        let mut live =
            LiveSystem::start(stages, self.detector.take(), options).map_err(Failure::thread)?;
        listener.watch = Some(live.watch());
        let start = Instant::now();
        let mut watched = passing.watch(source);
        let played = live.play(&mut watched, self.interrupt.flag(), |told| {
            listener.hear(told);
        });
        let seconds = start.elapsed().as_secs_f64();
        let result = live.finish();
        for event in result.events.try_iter() {
            listener.hear(Told::Event(Box::new(event)));
        }
        if let Played::SourceFailed(e) = played {
            listener.failed.get_or_insert(Failure::input(e));
        }
        let tally = match listener.finish() {
            (tally, None) => tally,
            (tally, Some(failure)) => {
                outputs.rescue_map(result.map.as_ref(), tally.frames);
                return Err(failure);
            }
        };
        self.check_frames(&tally)?;
        let remark = result.detector.as_deref().and_then(Detector::remark);
        let mut session = tally.close(End {
            trajectory: &result.trajectory,
            view: Arc::clone(&result.view),
            detector: DetectorJson { remark, ..detector },
            interrupted: self.interrupt.requested(),
            seconds,
        });
        session.saved = outputs.map.take().map(|file| match &result.map {
            Some(map) => file.save(map),
            None => Err(Failure::criteria(
                "the map is not saved: mapping ended in the midst of its work and left it in a state that cannot be used",
            )),
        });
        let answers = session.detector.frames as f64 / seconds;
        session.live = Some(told(result, choice, answers, &passing.late()));
        Ok(session)
    }
}

/// What is told of a live run beside what is told of every run.
fn told(result: LiveResult, choice: LiveChoice, answers: f64, late: &[f64]) -> LiveRun {
    let LiveResult {
        statistics,
        ended,
        log,
        ..
    } = result;
    LiveRun {
        json: LiveJson::new(choice.name(), &statistics, &ended, answers, late),
        log,
        latency_ms: statistics.frames.iter().map(|f| f.latency * 1e3).collect(),
    }
}

/// Time after which it is said why the camera is lost, s.
const TELL_LOSS: f64 = 1.0;

/// Counts and writes while frames go by.
struct Listener<'a> {
    outputs: &'a mut Outputs,
    passing: &'a Passing,
    timing: &'static Timing,
    tally: Tally,
    progress: Progress,
    watch: Option<Watch>,
    /// The last loss that was told.
    told_loss: Option<FrameId>,
    drawing: Option<Drawing>,
    /// Why the run cannot go on.
    failed: Option<Failure>,
}

impl<'a> Listener<'a> {
    fn new(
        outputs: &'a mut Outputs,
        passing: &'a Passing,
        timing: &'static Timing,
        frames: Option<usize>,
    ) -> Self {
        Self {
            outputs,
            passing,
            timing,
            tally: Tally::default(),
            progress: Progress::new(frames).without_bar(),
            watch: None,
            told_loss: None,
            drawing: None,
            failed: None,
        }
    }

    fn begin_to_draw(&mut self, choice: LiveChoice) -> Result<(), Failure> {
        let folder = self.outputs.overlay.take();
        let drawing = folder.map(|f| Drawing::start(f, choice == LiveChoice::All));
        self.drawing = drawing.transpose()?;
        Ok(())
    }

    fn hear(&mut self, told: Told) {
        let event = match told {
            Told::Skipped(e) => return self.tally.skip(&e),
            Told::Event(event) => event,
        };
        self.tally.take(std::slice::from_ref(&event));
        let written = self.outputs.take(std::slice::from_ref(&event), None);
        if let Err(failure) = written {
            self.failed.get_or_insert(failure);
            self.passing.close();
        }
        match &*event {
            Event::Frame(report) => self.hear_report(report),
            Event::Health(health) => self.hear_health(health),
            Event::Refused(refused) => self.passing.refused(refused.frame),
            _ => {}
        }
    }

    /// Says why the camera is lost, once, when that lasts.
    fn hear_health(&mut self, health: &Health) {
        if let Some(loss) = &health.loss
            && loss.seconds >= TELL_LOSS
            && self.told_loss != Some(loss.since)
        {
            self.told_loss = Some(loss.since);
            console::warn(&loss.to_string());
        }
    }

    fn hear_report(&mut self, report: &FrameReport) {
        let kept = self.passing.leave(report.frame);
        if let (Some(drawing), Some(frame)) = (&mut self.drawing, kept)
            && !drawing.draw(frame, report)
        {
            self.passing.close();
        }
        // What was waited for and written on this thread.
        self.timing.end_round();
        let dropped = self.passing.dropped();
        let note = match dropped {
            0 => self.tally.note(),
            n => format!(", {n} dropped{}", self.tally.note()),
        };
        let done = self.tally.frames + self.tally.skipped + dropped;
        let health = self.watch.as_ref().map(Watch::health);
        let health = health.map_or_else(String::new, |h| format!(" | {h}"));
        self.progress.show(done, &(note + &health));
    }

    /// What was counted, and why the run could not go on.
    fn finish(mut self) -> (Tally, Option<Failure>) {
        self.progress.finish();
        match self.drawing.map(Drawing::finish).transpose() {
            Ok(None) => {}
            Ok(Some((folder, left_out))) => {
                self.outputs.overlay = Some(folder);
                if left_out > 0 {
                    console::warn(&format!(
                        "{left_out} pictures were left out, since drawing them took longer than frames came"
                    ));
                }
            }
            Err(failure) => {
                self.failed.get_or_insert(failure);
            }
        }
        (self.tally, self.failed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interrupt::Interrupt;
    use std::time::Duration;
    use stillpoint::detection::{DetectError, Detections, DetectorInfo, DetectorKind};
    use stillpoint::imaging::{RgbdFrame, Simd};
    use stillpoint::simulator::{Simulator, SimulatorConfig};
    use stillpoint::slam::{Config, Replay, Stages};

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

    /// A run of a few frames with this detector, in which each thread does this before it waits.
    fn run(detector: fn(), before: fn(Stage)) -> Session {
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
            simd: Simd::detect(),
            timing,
            interrupt: &Interrupt::default(),
            detector: Some(Box::new(Does(detector))),
            map: None,
        };
        let options = LiveOptions {
            detector_patience: Duration::from_millis(50),
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
        let hanging = run(
            || loop {
                std::thread::park()
            },
            |_| {},
        );
        assert_eq!(hanging.frames, 4);
        assert_eq!(hanging.final_poses.len(), 4);
        assert!(threads(&hanging).0.contains("given up"));
        let panicking = run(|| panic!("out of order"), |_| {});
        assert_eq!(panicking.final_poses.len(), 4);
        let ends = threads(&panicking);
        assert_eq!(ends, ("panicked: out of order".into(), "finished".into()));
        // What it was is told all the same.
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
        );
        assert_eq!(session.final_poses.len(), 4);
        assert_eq!(
            threads(&session),
            ("finished".into(), "panicked: no room".into())
        );
        let log = session.live.unwrap().log;
        let simulator = SimulatorConfig {
            scene: "xyz".to_owned(),
            frames: Some(4),
            ..SimulatorConfig::default()
        };
        let simulator = Simulator::new(&simulator).unwrap();
        let stages = Stages::new(Config::default(), *simulator.camera(), Simd::detect());
        let mut replay = Replay::new(stages.unwrap(), log).unwrap();
        replay.run(&mut simulator.source(), |_| {}).unwrap();
    }
}
