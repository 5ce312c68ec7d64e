//! Faulty detectors, and when a detector is called.

use super::world::{frames, stages};
use super::{assert_all_finished, assert_reproduced, run, unhurried};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use stillpoint_detection::{DetectError, Detections, Detector, DetectorInfo, DetectorKind};
use stillpoint_imaging::{FrameId, RgbdFrame};
use stillpoint_live::{Delivery, LiveOptions, LiveSystem, Stage, WorkerEnd};
use stillpoint_slam::{Event, LogEntry};

/// The answer of a detector without detections.
fn nothing(frame: &RgbdFrame) -> Result<Detections, DetectError> {
    Ok(Detections {
        frame: frame.id,
        stamp: frame.stamp,
        items: Vec::new(),
    })
}

/// A detector that misbehaves at its third call.
pub(crate) struct Odd(
    pub(crate) u32,
    pub(crate) fn(&RgbdFrame) -> Result<Detections, DetectError>,
);

impl Detector for Odd {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        self.0 += 1;
        if self.0 == 3 {
            return (self.1)(frame);
        }
        nothing(frame)
    }

    fn info(&self) -> DetectorInfo {
        DetectorInfo::new(DetectorKind::None, "")
    }
}

#[test]
fn panicking_detector_is_reported_and_others_finish() {
    let odd = Odd(0, |_| panic!("no more boxes"));
    let (result, received) = run(Some(Box::new(odd)), unhurried(), 2);
    let end = Some(WorkerEnd::Panicked("no more boxes".to_owned()));
    assert_eq!(result.ended.detection, end);
    assert_eq!(result.ended.failures().count(), 1);
    assert_eq!(result.trajectory.entries().len(), frames().len());
    assert!(result.statistics.detections.len() <= 2);
    assert_reproduced(&result, &received);
}

#[test]
fn run_without_a_log_keeps_no_per_frame_data() {
    let options = LiveOptions {
        keep_log: false,
        ..unhurried()
    };
    let (result, _) = run(Some(Box::new(Odd(10, nothing))), options, 2);
    assert_all_finished(&result);
    assert_eq!(result.trajectory.entries().len(), frames().len());
    assert!(result.log.entries.is_empty());
    let statistics = &result.statistics;
    assert!(statistics.frames.is_empty() && statistics.detections.is_empty());
    assert_eq!(statistics.arrived, frames().len() as u64);
}

#[test]
fn long_run_keeps_only_its_newest_frames() {
    let forgetful = |keep_log| LiveOptions {
        keep_log,
        keep_frames: Some(3),
        ..unhurried()
    };
    let (result, _) = run(None, forgetful(false), 2);
    assert_all_finished(&result);
    let entries = result.trajectory.entries();
    assert!((3..=6).contains(&entries.len()), "{}", entries.len());
    assert!(frames().len() > 6);
    let last = frames().last().map(|f| f.id);
    assert_eq!(entries.last().map(|e| e.frame), last);
    let newest = result.trajectory.resolve(&result.view).count();
    assert_eq!(newest, entries.len());
    // With a log all are kept: its digest covers the whole trajectory.
    let (result, received) = run(None, forgetful(true), 2);
    assert_eq!(result.trajectory.entries().len(), frames().len());
    assert_reproduced(&result, &received);
}

/// Reports each call, and hangs at the third.
struct Hanging {
    asked: u32,
    says: Sender<()>,
}

impl Detector for Hanging {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        self.asked += 1;
        self.says.send(()).unwrap();
        match self.asked {
            3 => loop {
                std::thread::park();
            },
            _ => nothing(frame),
        }
    }

    fn info(&self) -> DetectorInfo {
        DetectorInfo::new(DetectorKind::None, "")
    }
}

#[test]
fn hanging_detector_is_abandoned() {
    // Tracking waits for three calls, so that it hangs independent of timing.
    let (says, asked) = channel();
    let (asked, messages) = (Mutex::new(asked), AtomicU32::new(0));
    let options = LiveOptions {
        detector_patience: Duration::ZERO,
        hook: Some(Arc::new(move |stage| {
            let waits = |n: u32| (1..=3).contains(&n);
            if stage == Stage::Tracking && waits(messages.fetch_add(1, Ordering::Relaxed)) {
                asked.lock().unwrap().recv().unwrap();
            }
        })),
        ..unhurried()
    };
    let hanging = Hanging { asked: 0, says };
    let (result, received) = run(Some(Box::new(hanging)), options, 2);
    assert_eq!(result.ended.detection, Some(WorkerEnd::GivenUp));
    assert!(result.detector.is_none());
    assert_eq!(result.ended.failures().count(), 1);
    assert_eq!(result.trajectory.entries().len(), frames().len());
    assert_reproduced(&result, &received);
}

#[test]
fn detector_failures_are_logged() {
    let odd = Odd(0, |frame| {
        Err(DetectError::Runtime {
            frame: frame.id,
            reason: "out of\n\"memory\" \u{1f635}".to_owned(),
        })
    });
    let (result, received) = run(Some(Box::new(odd)), unhurried(), 5);
    assert_all_finished(&result);
    assert!(result.detector.is_some());
    let failed = |e: &&LogEntry| matches!(e, LogEntry::TrackDetections { said: Err(_), .. });
    assert_eq!(result.log.entries.iter().filter(failed).count(), 1);
    assert_reproduced(&result, &received);
}

/// A slow detector that records the time and frame of each call.
struct Slow(Arc<Mutex<Vec<(FrameId, Instant)>>>);

const WHILE: Duration = Duration::from_millis(10);

impl Detector for Slow {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        self.0.lock().unwrap().push((frame.id, Instant::now()));
        std::thread::sleep(WHILE);
        nothing(frame)
    }

    fn info(&self) -> DetectorInfo {
        DetectorInfo::new(DetectorKind::None, "")
    }
}

/// When frames are dropped, the detector soon works at most a quarter of the time.
#[test]
fn detector_rests_when_frames_are_dropped() {
    // The shortest time between two of its frames, from the second frame after dropped ones on.
    let shortest = |tracking_sleeps: Duration| {
        let asked = Arc::default();
        let options = LiveOptions {
            drop_late: !tracking_sleeps.is_zero(),
            hook: Some(Arc::new(move |stage| {
                if stage == Stage::Tracking {
                    std::thread::sleep(tracking_sleeps);
                }
            })),
            ..unhurried()
        };
        let detector = Slow(Arc::clone(&asked));
        let (result, received) = run(Some(Box::new(detector)), options, 10);
        assert_all_finished(&result);
        assert_reproduced(&result, &received);
        let tracked: Vec<FrameId> = result.statistics.frames.iter().map(|f| f.frame).collect();
        let after_dropped = tracked.windows(2).filter(|w| w[1].0 > w[0].0 + 1);
        let since = after_dropped.map(|w| w[1]).nth(1);
        let asked = asked.lock().unwrap();
        let gaps = asked.windows(2).filter(|w| Some(w[1].0) >= since);
        gaps.map(|w| w[1].1 - w[0].1).min().unwrap()
    };
    let gap = shortest(4 * WHILE);
    assert!(gap >= 4 * WHILE, "{gap:?}");
    // Control: without drops it works all the time.
    let gap = shortest(Duration::ZERO);
    assert!(gap < 4 * WHILE, "{gap:?}");
}

#[test]
fn caller_detections_reach_tracking_with_their_frame() {
    let options = LiveOptions {
        drop_late: false,
        ..unhurried()
    };
    let mut live = LiveSystem::start(stages(), None, options).unwrap();
    let events = live.listen("caller", Delivery::until_full(4096));
    for frame in &frames()[..6] {
        assert!(live.tell(nothing(frame).unwrap()));
        assert!(live.push(frame.clone()));
        // Later detections would be taken with this frame, if that is still queued.
        let of = |event: Option<Event>| match event.unwrap() {
            Event::Detected(d) => Some(("detected", d.frame)),
            Event::Frame(f) => Some(("frame", f.report.frame)),
            _ => None,
        };
        let next = || std::iter::repeat_with(|| of(events.recv())).find_map(|e| e);
        assert_eq!(next(), Some(("detected", frame.id)));
        assert_eq!(next(), Some(("frame", frame.id)));
    }
    assert_all_finished(&live.finish());
}
