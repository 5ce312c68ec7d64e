//! Subscribers of a live run: delivery, dropped events, and that no stage waits for them.

use super::world::{Checked, Frames, frames, replay, scripted, stages, within};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};
use stillpoint_live::{Delivery, LiveOptions, LiveSystem};
use stillpoint_map::Map;
use stillpoint_slam::{Event, Subscriber};

struct Slow {
    pause: Duration,
    frames: u64,
    images: u64,
    others: u64,
}

impl Slow {
    fn new(ms: u64) -> Self {
        Self {
            pause: Duration::from_millis(ms),
            frames: 0,
            images: 0,
            others: 0,
        }
    }
}

impl Subscriber for Slow {
    fn receive(&mut self, event: &Event) {
        match event.as_frame() {
            Some(tracked) => {
                std::thread::sleep(self.pause);
                self.frames += 1;
                self.images += u64::from(tracked.frame.is_some());
            }
            None => self.others += 1,
        }
    }
}

fn start(drop_late: bool) -> LiveSystem {
    let options = LiveOptions {
        drop_late,
        ..LiveOptions::default()
    };
    LiveSystem::start(stages(), Some(scripted()), options).unwrap()
}

#[test]
fn tracking_ignores_slow_subscribers_and_counts_misses() {
    const PAUSE: u64 = 400;
    let (result, slow, all, took) = within(|| {
        let mut live = start(true);
        let few = Delivery::until_full(4).with_images(2, 1);
        let slow = live.subscribe("slow", few, Slow::new(PAUSE)).unwrap();
        let all = Delivery::until_full(10_000);
        let all = live.subscribe("all", all, Checked::default()).unwrap();
        let began = Instant::now();
        for frame in frames() {
            assert!(live.push(frame.clone()));
            std::thread::sleep(Duration::from_millis(20));
        }
        let took = began.elapsed();
        (
            live.finish(),
            slow.join().unwrap(),
            all.join().unwrap(),
            took,
        )
    });
    // If a stage had waited, each frame would have taken as long as the slow subscriber.
    assert!(
        took < Duration::from_millis(PAUSE) * frames().len() as u32 / 2,
        "{took:?}"
    );
    let tracked = result.statistics.frames.len();
    assert_eq!(all.reports.len(), tracked);
    let [(_, missed), (_, nothing)] = &result.statistics.subscribers[..] else {
        panic!("{:?}", result.statistics.subscribers);
    };
    assert_eq!((nothing.events, nothing.images), (0, 0));
    assert!(missed.events > 0 && slow.frames < tracked as u64);
    assert!(slow.images <= slow.frames);
    // Subscribers have no effect on the run.
    let (again, received) = replay(stages(), Frames::all(), result.log.clone());
    assert_eq!(received, all);
    assert_eq!(
        again.trajectory().digest(&again.view()),
        result.log.trajectory
    );
}

#[test]
fn without_drops_every_image_reaches_its_subscriber() {
    let (result, slow) = within(|| {
        let mut live = start(false);
        let every = Delivery::until_full(200).with_images(4, 1);
        let slow = live.subscribe("slow", every, Slow::new(20)).unwrap();
        for frame in frames() {
            assert!(live.push(frame.clone()));
        }
        (live.finish(), slow.join().unwrap())
    });
    let (_, missed) = &result.statistics.subscribers[0];
    assert_eq!((missed.events, missed.images), (0, 0));
    assert_eq!(
        (slow.frames, slow.images),
        (frames().len() as u64, frames().len() as u64)
    );
    assert!(slow.others > 0);
}

#[test]
fn map_and_trajectory_are_available_during_the_run() {
    let (result, received, (map, poses, view), gone) = within(|| {
        let mut live = start(false);
        let received = Delivery::until_full(10_000);
        let received = live
            .subscribe("test", received, Checked::default())
            .unwrap();
        let mut now = None;
        for (i, frame) in frames().iter().enumerate() {
            assert!(live.push(frame.clone()));
            if i == 30 {
                let poses = live.corrected_trajectory();
                now = Some((live.map().unwrap(), poses, live.view()));
            }
        }
        let watch = live.watch();
        let result = live.finish();
        assert_eq!(
            watch.trajectory().entries().len(),
            result.trajectory.entries().len()
        );
        assert_eq!(watch.view().version(), result.view.version());
        (result, received.join().unwrap(), now.unwrap(), watch.map())
    });
    // The previous frame was taken when the next one was pushed.
    assert!((29..=31).contains(&poses.len()), "{}", poses.len());
    let end = result.trajectory.entries();
    for ((entry, _), last) in poses.iter().zip(end) {
        assert_eq!(entry.frame, last.frame);
        assert_eq!(
            entry.pose.reference_from_camera,
            last.pose.reference_from_camera
        );
    }
    let saved = Map::from_bytes(&map.to_bytes(&[]).unwrap()).unwrap();
    assert!(map.view().version() <= view.version());
    assert!(saved.view().keyframe_count() > 0 && saved.check().is_ok());
    assert!(view.version() <= result.view.version());
    assert!(gone.is_none());
    // Saving has no effect on the run.
    let (again, replayed) = replay(stages(), Frames::all(), result.log.clone());
    assert_eq!(replayed, received);
    let bytes = |map: &Map| map.to_bytes(&[]).unwrap();
    assert!(bytes(&again.into_map()) == bytes(result.map.as_ref().unwrap()));
}

#[test]
fn events_can_be_polled() {
    let (kept, waited) = within(|| {
        let mut live = start(false);
        let events = live.listen("pull", Delivery::newest(1));
        assert!(events.recv_within(Duration::from_millis(1)).is_none());
        for frame in frames() {
            live.push(frame.clone());
        }
        let waited = events.recv_within(Duration::from_secs(60)).is_some();
        let _ = live.finish();
        (events.iter().collect::<Vec<Event>>(), waited)
    });
    assert!(waited);
    // The newest of each kind, including the last frame.
    let frames_of = kept.iter().filter_map(Event::as_frame);
    let last: Vec<_> = frames_of.map(|f| f.report.frame).collect();
    assert_eq!(last, [frames().last().unwrap().id]);
}

/// Hangs at its first event until the test releases it, and reports so.
struct Hanging {
    hangs: Sender<()>,
    released: Receiver<()>,
}

impl Subscriber for Hanging {
    fn receive(&mut self, _: &Event) {
        self.hangs.send(()).unwrap();
        let _ = self.released.recv();
    }
}

#[test]
fn hanging_subscriber_does_not_block_the_end_of_the_run() {
    let (hangs, hanging) = channel();
    let (release, released) = channel();
    let (result, all, end) = within(move || {
        let options = LiveOptions {
            drop_late: false,
            subscriber_patience: Duration::ZERO,
            ..LiveOptions::default()
        };
        let mut live = LiveSystem::start(stages(), Some(scripted()), options).unwrap();
        let every = Delivery::until_full(10_000);
        let all = live.listen("all", every);
        let subscriber = Hanging { hangs, released };
        let subscriber = live.subscribe("hanging", every, subscriber).unwrap();
        for (i, frame) in frames().iter().enumerate() {
            assert!(live.push(frame.clone()));
            if i == 0 {
                hanging.recv().unwrap();
            }
        }
        (live.finish(), all.iter().count() as u64, subscriber.join())
    });
    assert!(end.err().unwrap().contains("given up"));
    assert_eq!(result.trajectory.entries().len(), frames().len());
    let [(_, nothing), (name, missed)] = &result.statistics.subscribers[..] else {
        panic!("{:?}", result.statistics.subscribers);
    };
    // All but the one at which it hangs.
    assert_eq!(name, "hanging");
    assert_eq!((nothing.events, missed.events), (0, all - 1));
    drop(release);
}
