//! Inline runs: events are complete and in the order of the log, and logs reproduce runs bit for bit.

use super::world::{self, Checked, Frames, frames, scripted};
use stillpoint_detection::{DetectError, Detections, Detector, DetectorInfo};
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::Map;
use stillpoint_slam::{Event, LogEntry, Replay, RunLog, Schedule, Stages, Subscriber, System};

/// A detector that fails at every third frame.
struct Fails(Box<dyn Detector>);

impl Detector for Fails {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        match frame.id.0 % 3 {
            2 => Err(DetectError::NoColour { frame: frame.id }),
            _ => self.0.detect(frame),
        }
    }

    fn info(&self) -> DetectorInfo {
        self.0.info()
    }
}

/// All events of a run, in order.
#[derive(Default)]
struct Received {
    events: Vec<Event>,
    checked: Checked,
}

impl Subscriber for Received {
    fn receive(&mut self, event: &Event) {
        // The order that all drivers guarantee.
        self.checked.take(event);
        self.events.push(event.clone());
    }
}

fn text(events: &[Event]) -> Vec<String> {
    events.iter().map(|e| format!("{e:?}")).collect()
}

/// Runs all frames through a system with a log.
fn run(mut system: System, frames: &[RgbdFrame]) -> (System, Received) {
    let mut received = Received::default();
    for frame in frames {
        received.receive_all(&system.step(frame.clone()));
    }
    received.receive_all(&system.finish());
    (system, received)
}

fn bytes(map: &Map) -> Vec<u8> {
    map.to_bytes(&[]).unwrap()
}

/// A run's log, after a text round trip, reproduces events, trajectory and map.
fn assert_replayed(system: System, received: &Received, stages: Stages, frames: &[RgbdFrame]) {
    let log = system.log().unwrap();
    let log = RunLog::from_bytes(log.to_text().as_bytes()).unwrap();
    let mut replay = Replay::new(stages, log).unwrap();
    let mut again = Received::default();
    replay.run(&mut Frames::of(frames), &mut again).unwrap();
    assert!(replay.is_over());
    assert_eq!(text(&received.events), text(&again.events));
    assert_eq!(
        format!("{:?}", system.loops()),
        format!("{:?}", replay.loops())
    );
    let digest = |t: &stillpoint_slam::Trajectory, v: &stillpoint_map::MapView| t.digest(v);
    assert_eq!(
        digest(system.trajectory(), &system.view()),
        digest(replay.trajectory(), &replay.view())
    );
    assert!(
        bytes(system.map()) == bytes(&replay.into_map()),
        "another map"
    );
}

#[test]
fn run_with_delays_and_detector_failures_replays() {
    let stages = || {
        world::stages_with(|c| {
            c.schedule = Schedule {
                detector: 3,
                mapper: 2,
                loop_closer: 4,
            };
        })
    };
    let system = System::from(stages()).with_log();
    let system = system.with_detector(Box::new(Fails(scripted())));
    let (system, received) = run(system, frames());
    let count = |kind: fn(&Event) -> bool| received.events.iter().filter(|e| kind(e)).count();
    assert_eq!(count(|e| matches!(e, Event::Frame(_))), frames().len());
    assert_eq!(
        count(|e| matches!(e, Event::DetectorFailed(_))),
        frames().len() / 3
    );
    assert!(count(|e| matches!(e, Event::Mapped { .. })) > 2);
    let log = system.log().unwrap();
    let late = |e: &&LogEntry| matches!(e, LogEntry::TrackDetections { next, said: Ok(d) } if d.frame.0 + 3 == next.0);
    assert!(log.entries.iter().any(|e| late(&e)));
    assert_replayed(system, &received, stages(), frames());
}

#[test]
fn run_with_a_correction_replays_and_reports_the_shift() {
    let (camera, frames) = world::there_and_back();
    let stages = |loop_closer: u32| {
        world::stages_for_submaps_with(camera, |c| c.schedule.loop_closer = loop_closer)
    };
    let (system, received) = run(System::from(stages(4)).with_log(), &frames);
    let corrected: Vec<_> = received
        .events
        .iter()
        .filter_map(|e| match e {
            Event::Corrected { report, view } => Some((*report, view)),
            _ => None,
        })
        .collect();
    let [(report, view)] = corrected[..] else {
        panic!("{} corrections", corrected.len());
    };
    assert_eq!(view.version(), report.map_version);
    assert!(
        report.moved.keyframes > 0 && report.moved.landmarks > 100,
        "{report:?}"
    );
    assert_eq!(
        system
            .loops()
            .iter()
            .filter(|l| l.applied == Some(report))
            .count(),
        1
    );
    assert_replayed(system, &received, stages(4), &frames);

    // A pending answer at the end of the stream is delivered and reported.
    let mut late = System::from(stages(1000)).with_log();
    let mut received = Received::default();
    for frame in &frames {
        received.receive_all(&late.step(frame.clone()));
    }
    let before = late.view().submaps().len();
    let last = late.finish();
    assert!(matches!(last[..], [Event::Corrected { .. }]), "{last:?}");
    assert_eq!((before, late.view().submaps().len()), (2, 1));
    received.receive_all(&last);
    assert_replayed(late, &received, stages(1000), &frames);
}

/// A subscriber gets images, reports, health and maps from the events alone.
#[test]
fn events_are_complete() {
    let system = System::from(world::stages()).with_detector(scripted());
    let (system, received) = run(system, frames());
    assert!(system.log().is_none());
    let mut newest = None;
    for event in &received.events {
        match event {
            Event::Frame(tracked) => {
                let frame = tracked.frame.as_ref().unwrap();
                let of = &frames()[frame.id.0 as usize];
                assert_eq!(frame.gray, of.gray);
                let (report, health) = (&tracked.report, &tracked.health);
                assert_eq!((report.frame, health.frame), (frame.id, frame.id));
            }
            Event::Mapped { report, view } => {
                assert_eq!(view.version(), report.map_version);
                assert!(view.keyframe(report.keyframe).is_some());
            }
            _ => {}
        }
        newest = event.view().cloned().or(newest);
    }
    assert_eq!(newest.unwrap().version(), system.view().version());
    // People have positions in the world and relative to the camera, once their depth was measured.
    let last = received
        .events
        .iter()
        .rev()
        .find_map(Event::as_frame)
        .unwrap();
    let pose = last.report.world_from_camera.unwrap();
    let seen = last
        .report
        .objects
        .iter()
        .filter_map(|o| o.seen_from(&pose));
    let mut people = 0;
    for person in seen {
        people += 1;
        assert!((0.3..10.0).contains(&person.position.z), "{person:?}");
        assert!(person.covariance.cholesky().is_some(), "{person:?}");
    }
    assert!(people > 0);
}

/// The map can be saved and the trajectory read at any frame.
#[test]
fn map_and_trajectory_are_available_at_any_frame() {
    let mut system = System::from(world::stages());
    for frame in &frames()[..20] {
        system.step(frame.clone());
    }
    let poses = system.corrected_trajectory();
    assert_eq!(poses.len(), 20);
    let now = bytes(system.map());
    let map = Map::from_bytes(&now).unwrap();
    assert_eq!(map.view().keyframe_count(), system.view().keyframe_count());
    for frame in &frames()[20..] {
        system.step(frame.clone());
    }
    system.finish();
    assert!(bytes(system.map()) != now);
    // Saving has no effect on the run.
    let (other, _) = run(System::from(world::stages()), frames());
    assert!(bytes(system.map()) == bytes(other.map()));
}
