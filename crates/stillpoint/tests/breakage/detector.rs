//! Failing and slow detectors.

use super::world::{Recording, Session, config, losses, small, undisturbed, within};
use std::sync::OnceLock;
use std::time::Duration;
use stillpoint_detection::{DetectError, Detections, Detector, DetectorInfo};
use stillpoint_imaging::{RgbdFrame, Simd};
use stillpoint_live::{LiveOptions, LiveSystem};
use stillpoint_slam::{Event, Stages};

/// People crossing in front of a hand-held camera.
fn people() -> &'static Recording {
    static PEOPLE: OnceLock<Recording> = OnceLock::new();
    PEOPLE.get_or_init(|| Recording::new("walking_xyz", 20..110, small(267.5)))
}

struct Dies(Box<dyn Detector>, u32);

impl Detector for Dies {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        if frame.id.0 < self.1 {
            return self.0.detect(frame);
        }
        Err(DetectError::Runtime {
            frame: frame.id,
            reason: "the device is gone".to_owned(),
        })
    }

    fn info(&self) -> DetectorInfo {
        self.0.info()
    }
}

fn failures(events: &[Event]) -> usize {
    let failed = |e: &&Event| matches!(e, Event::DetectorFailed(_));
    events.iter().filter(failed).count()
}

#[test]
fn failed_detector_does_not_harm_tracking() {
    let detector = Box::new(Dies(people().detector(), 30));
    let mut session = Session::new(people(), config()).with_detector(detector);
    let reports = session.feed(people().play(0..90));
    assert_eq!(failures(&session.events), 60);
    assert!(losses(&reports).is_empty());
    session.hold("a detector that dies", people(), &reports);
    // Objects are propagated for a limited time.
    assert!(reports[29].objects.len() + reports[30].objects.len() > 0);
    assert!(reports[89].objects.is_empty());

    // A detector without any answer has no effect at all.
    let detector = Box::new(Dies(people().detector(), 0));
    let mut session = Session::new(people(), config()).with_detector(detector);
    session.feed(people().play(0..90));
    assert_eq!(failures(&session.events), 90);
    assert_eq!(session.digest(), undisturbed("people", people()));
}

#[test]
fn detections_two_seconds_late_do_no_harm() {
    let mut config = config();
    (config.schedule.detector, config.detector.stride) = (60, 15);
    let mut session = Session::new(people(), config).with_detector(people().detector());
    let reports = session.feed(people().play(0..90));
    let received = |e: &&Event| matches!(e, Event::Detected(_));
    assert_eq!(session.events.iter().filter(received).count(), 2);
    assert!(losses(&reports).is_empty());
    // The answers are within the history.
    assert!(reports.iter().all(|r| r.counts.detections_too_late == 0));
    session.hold("answers two seconds late", people(), &reports);
}

struct Slow(Box<dyn Detector>);

impl Detector for Slow {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        std::thread::sleep(Duration::from_secs(2));
        self.0.detect(frame)
    }

    fn info(&self) -> DetectorInfo {
        self.0.info()
    }
}

#[test]
fn tracking_does_not_wait_for_a_slow_detector() {
    let result = within(|| {
        let stages = Stages::new(config(), people().camera, Simd::detect()).unwrap();
        let options = LiveOptions {
            drop_late: false,
            ..LiveOptions::default()
        };
        let detector: Box<dyn Detector> = Box::new(Slow(people().detector()));
        let mut live = LiveSystem::start(stages, Some(detector), options).unwrap();
        for frame in people().play(0..90) {
            assert!(live.push(frame));
            std::thread::sleep(Duration::from_millis(30));
        }
        live.finish()
    });
    assert_eq!(result.ended.failures().count(), 0, "{:?}", result.ended);
    assert_eq!(result.statistics.frames.len(), 90);
    assert_eq!(result.trajectory.entries().len(), 90);
    // One answer arrived; some frames had no older one.
    let ages = result
        .statistics
        .frames
        .iter()
        .filter_map(|f| f.detections_age);
    let oldest = ages.fold(0.0, f64::max);
    println!(
        "answers as old as {:?} s, then {oldest:.1} s",
        result.statistics.detections
    );
    assert!(!result.statistics.detections.is_empty());
    assert!(
        result
            .statistics
            .detections
            .iter()
            .all(|a| a.latency >= 2.0)
    );
    // Control: no frame waited for the detector.
    assert!(result.statistics.frames.iter().all(|f| f.latency < 2.0));
    let kept = result.view.landmark_count();
    assert!(kept > 100, "{kept}");
}
