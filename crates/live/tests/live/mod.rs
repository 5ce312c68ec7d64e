//! Live runs over a simulated scene: the log reproduces any timing of threads, and no run hangs.

mod detection;
mod ending;
mod health;
mod inline;
mod listeners;
mod world;

use self::world::{
    Checked as Received, Frames, frames, mapping_falls_behind, random_delays, replay, scripted,
    stages, within,
};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};
use stillpoint_detection::Detector;
use stillpoint_imaging::{FrameId, FrameSource, RgbdFrame, SourceError};
use stillpoint_live::{
    Delivery, Hook, LiveOptions, LiveResult, LiveSystem, Missed, Played, Stage, WorkerEnd,
};
use stillpoint_slam::{
    Event, LogEntry, LoopReport, Loops, OnEvent, Outcome, Replay, ReplayError, RunLog, Stages,
    System,
};

/// Pushes all frames of the world, with a pause of `pause` ms after each, and ends the stream.
fn run(
    detector: Option<Box<dyn Detector>>,
    options: LiveOptions,
    pause_ms: u64,
) -> (LiveResult, Received) {
    within(move || push(stages(), detector, options, frames(), pause_ms))
}

fn push(
    stages: Stages,
    detector: Option<Box<dyn Detector>>,
    options: LiveOptions,
    frames: &[RgbdFrame],
    pause_ms: u64,
) -> (LiveResult, Received) {
    let mut live = LiveSystem::start(stages, detector, options).unwrap();
    let received = live.subscribe("test", Delivery::until_full(10_000), Received::default());
    for frame in frames {
        if !live.push(frame.clone()) {
            break;
        }
        std::thread::sleep(Duration::from_millis(pause_ms));
    }
    let result = live.finish();
    let expected = [("test".to_owned(), Missed::default())];
    assert_eq!(result.statistics.subscribers, expected);
    (result, received.unwrap().join().unwrap())
}

/// A replay over the world's frames gives the same events and the same map.
fn assert_reproduced(result: &LiveResult, received: &Received) {
    assert_reproduced_by(stages(), Frames::all(), result, received);
}

fn assert_reproduced_by(stages: Stages, frames: Frames, result: &LiveResult, received: &Received) {
    let log = RunLog::from_bytes(result.log.to_text().as_bytes()).unwrap();
    assert_eq!(log, result.log);
    let (again, received_again) = replay(stages, frames, log);
    assert_eq!(received, &received_again);
    assert_eq!(
        format!("{:?}", again.loops()),
        format!("{:?}", result.loops)
    );
    let digest = again.trajectory().digest(&again.view());
    assert_eq!(digest, result.trajectory.digest(&result.view));
    if let Some(map) = &result.map {
        let bytes = |map: &stillpoint_map::Map| map.to_bytes(&[]).unwrap();
        assert!(bytes(map) == bytes(&again.into_map()), "another map");
    }
}

fn assert_all_finished(result: &LiveResult) {
    let failures: Vec<_> = result.ended.failures().collect();
    assert!(failures.is_empty(), "{failures:?}");
}

#[test]
fn run_with_random_delays_replays_bit_for_bit() {
    let mut digests = BTreeSet::new();
    for (seed, drop_late) in [(1, false), (2, false), (3, true)] {
        let options = LiveOptions {
            drop_late,
            hook: Some(random_delays(seed, 30)),
            ..LiveOptions::default()
        };
        let (result, received) = run(Some(scripted()), options, 3);
        assert_all_finished(&result);
        let tracked = result.statistics.frames.len() + result.statistics.dropped.len();
        assert_eq!(tracked, frames().len());
        assert!(result.view.keyframe_count() >= 2);
        let late = |e: &&LogEntry| matches!(e, LogEntry::TrackDetections { next, said: Ok(d) } if d.frame < *next);
        assert!(result.log.entries.iter().any(|e| late(&e)), "{seed}");
        assert_reproduced(&result, &received);
        if !drop_late {
            digests.insert(result.log.trajectory);
        }
    }
    // Control: delays do make a difference.
    let mut inline = System::from(stages()).with_detector(scripted());
    for frame in frames() {
        inline.step(frame.clone());
    }
    inline.finish();
    digests.insert(inline.trajectory().digest(&inline.view()));
    assert!(digests.len() > 1, "no run differs from another");
}

#[test]
fn work_at_the_end_of_the_stream_is_replayed() {
    let (camera, frames) = world::crowd();
    let options = LiveOptions {
        drop_late: false,
        ..LiveOptions::default()
    };
    let (result, received, frames) = within(move || {
        let stages = world::stages_for(camera);
        let (result, received) = push(stages, None, options, &frames, 0);
        (result, received, frames)
    });
    assert_all_finished(&result);
    // It ends before the first frames, with people, were tracked again.
    let tracked = |e: &LogEntry| matches!(e, LogEntry::TrackFrame { .. });
    let entries = &result.log.entries;
    let last = entries.iter().rposition(tracked);
    let end = entries.iter().position(|e| *e == LogEntry::TrackEnd);
    assert!(end.is_some() && end > last, "{last:?} {end:?}");
    let stages = world::stages_for(camera);
    assert_reproduced_by(stages, Frames::of(&frames), &result, &received);
}

#[test]
fn map_corrections_are_replayed() {
    let (camera, frames) = world::there_and_back();
    let options = LiveOptions {
        drop_late: false,
        hook: Some(random_delays(7, 10)),
        ..LiveOptions::default()
    };
    let (result, received, frames) = within(move || {
        let stages = world::stages_for_submaps(camera);
        let (result, received) = push(stages, None, options, &frames, 0);
        (result, received, frames)
    });
    assert_all_finished(&result);
    let joined = |l: &&LoopReport| l.joined.is_some() && l.applied.is_some();
    assert_eq!(result.loops.iter().filter(joined).count(), 1);
    assert_eq!(result.view.submaps().len(), 1);
    let took = |e: &&LogEntry| matches!(e, LogEntry::MapCorrect { .. });
    assert_eq!(result.log.entries.iter().filter(took).count(), 1);
    let stages = world::stages_for_submaps(camera);
    assert_reproduced_by(stages, Frames::of(&frames), &result, &received);
}

#[test]
fn late_frames_are_dropped_and_counted() {
    let slow: Hook = Arc::new(|stage| {
        if stage == Stage::Tracking {
            std::thread::sleep(Duration::from_millis(30));
        }
    });
    let options = LiveOptions {
        hook: Some(slow),
        ..LiveOptions::default()
    };
    let (result, received) = run(None, options, 4);
    let s = &result.statistics;
    assert!(s.dropped.len() > 5, "{:?}", s.dropped);
    assert_eq!(s.arrived as usize, frames().len());
    let mut all: Vec<FrameId> = s.frames.iter().map(|f| f.frame).collect();
    // The newest frame is never dropped.
    assert_eq!(all.last(), frames().last().map(|f| &f.id));
    all.extend(&s.dropped);
    all.sort_unstable();
    assert_eq!(all, frames().iter().map(|f| f.id).collect::<Vec<_>>());
    assert!(s.frames.iter().all(|f| f.latency >= f.waited));
    assert_reproduced(&result, &received);
}

/// With hardly any time per frame, and mapping slower than keyframes arrive, less work is done, and the log records it.
#[test]
fn reduced_effort_under_time_pressure_is_replayed() {
    const WANTED: u32 = 800;
    let efforts = |budget: Option<f64>, behind: u64| {
        let options = LiveOptions {
            drop_late: false,
            budget,
            hook: Some(mapping_falls_behind(behind)),
            ..LiveOptions::default()
        };
        let stages = || {
            world::stages_with(|c| {
                c.features.features = WANTED as usize;
                // Every frame is a keyframe.
                let k = &mut c.keyframes;
                (k.max_view_angle, k.min_seconds) = (0.0, 0.0);
            })
        };
        let (result, received) = within(move || push(stages(), None, options, frames(), 0));
        assert_all_finished(&result);
        assert_reproduced_by(stages(), Frames::all(), &result, &received);
        let counts = result.statistics.frames.iter().map(|f| f.features);
        let fewest = counts.min().unwrap();
        let entries = result.log.entries.iter();
        let hurried = entries.filter(|e| matches!(e, LogEntry::MapEffort { .. }));
        (fewest, hurried.count())
    };
    let (features, hurried) = efforts(Some(1e-6), 4);
    assert!(features < WANTED, "{features} of {WANTED}");
    assert!(hurried > 0);
    // Control: with enough time the full effort is used.
    assert_eq!(efforts(Some(10.0), 0).0, WANTED);
    assert_eq!(efforts(None, 0).0, WANTED);
}

#[test]
fn no_frame_is_dropped_if_drops_are_disabled() {
    let options = LiveOptions {
        drop_late: false,
        hook: Some(random_delays(5, 8)),
        ..LiveOptions::default()
    };
    let (result, received) = run(None, options, 0);
    assert_all_finished(&result);
    assert_eq!(result.ended.detection, None);
    let tracked: Vec<FrameId> = result.statistics.frames.iter().map(|f| f.frame).collect();
    assert_eq!(tracked, frames().iter().map(|f| f.id).collect::<Vec<_>>());
    assert!(result.statistics.dropped.is_empty());
    assert_eq!(result.trajectory.entries().len(), frames().len());
    assert_reproduced(&result, &received);
}

/// Drops no frame, and waits for a detector that answers, on any machine.
fn unhurried() -> LiveOptions {
    LiveOptions {
        drop_late: false,
        detector_patience: Duration::from_secs(600),
        ..LiveOptions::default()
    }
}

/// Frames of a camera arrive as they come, whatever their stamps.
struct Camera(Frames);

impl FrameSource for Camera {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        self.0.next_frame()
    }

    fn is_live(&self) -> bool {
        true
    }
}

#[test]
fn camera_frames_are_not_delayed() {
    // Four seconds between two stamps; a recording would be played with that delay.
    let mut slow = frames()[..3].to_vec();
    for (i, frame) in slow.iter_mut().enumerate() {
        frame.stamp = 4.0 * i as f64;
        frame.depth_stamp = frame.stamp;
    }
    let (seconds, tracked) = within(move || {
        let mut live = LiveSystem::start(stages(), None, unhurried()).unwrap();
        let start = Instant::now();
        let mut source = Camera(Frames::of(&slow));
        let played = live.play(&mut source, &AtomicBool::new(false), |e| panic!("{e}"));
        assert!(matches!(played, Played::ToTheEnd), "{played:?}");
        let seconds = start.elapsed().as_secs_f64();
        (seconds, live.finish().statistics.frames.len())
    });
    assert_eq!(tracked, 3);
    // A bound on waiting, not on speed: with that delay it would take eight seconds.
    assert!(seconds < 4.0, "{seconds}");
}

#[test]
fn log_is_refused_with_other_frames_or_configuration() {
    let (result, _) = run(None, unhurried(), 0);
    let other = world::stages_with(|c| c.seed = 1);
    let refused = Replay::new(other, result.log.clone()).err();
    assert!(matches!(refused, Some(ReplayError::OtherStages)));

    let mut again = Replay::new(stages(), result.log.clone()).unwrap();
    let mut source = Frames::all();
    source.0.remove(4);
    let e = again.run(&mut source, &mut None::<Loops>).unwrap_err();
    let missing = matches!(e, ReplayError::NoFrame { frame, .. } if frame == FrameId(4));
    assert!(missing, "{e}");

    // One grey image differs.
    let mut again = Replay::new(stages(), result.log.clone()).unwrap();
    let mut source = Frames::all();
    source.0[7].gray = source.0[12].gray.clone();
    let e = again.run(&mut source, &mut None::<Loops>).unwrap_err();
    let noticed = matches!(
        e,
        ReplayError::OtherTrajectory | ReplayError::NotSent { .. }
    );
    assert!(noticed, "{e}");

    // A message that was never sent.
    let mut log = result.log;
    let first = |e: &LogEntry| matches!(e, LogEntry::MapKeyframe { .. });
    let at = log.entries.iter().position(first).unwrap();
    log.entries.insert(at, log.entries[at].clone());
    let mut again = Replay::new(stages(), log).unwrap();
    let e = again
        .run(&mut Frames::all(), &mut None::<Loops>)
        .unwrap_err();
    assert!(matches!(e, ReplayError::NotSent { .. }), "{e}");
}

#[test]
fn every_frame_has_a_pose() {
    let (result, received) = run(Some(scripted()), unhurried(), 0);
    assert_all_finished(&result);
    let lost = |r: &&stillpoint_slam::FrameReport| matches!(r.outcome, Outcome::Lost { .. });
    assert_eq!(received.reports.iter().filter(lost).count(), 0);
}
