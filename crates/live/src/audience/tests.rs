//! Queues of subscribers: queueing, dropping, and counting.

use super::*;
use std::sync::mpsc::channel;
use stillpoint_detection::Detections;
use stillpoint_imaging::{DepthImage, FrameId, GrayImage, RgbdFrame};
use stillpoint_slam::{FrameCounts, FrameReport, Health, OnEvent, Outcome, Quality, Segments};

fn detected(n: u32) -> Event {
    Event::Detected(Detections {
        frame: FrameId(n),
        stamp: 0.0,
        items: Vec::new(),
    })
}

fn tracked(n: u32) -> Event {
    let (frame, stamp) = (FrameId(n), f64::from(n));
    Event::Frame(Arc::new(FrameEvent {
        frame: Some(Arc::new(RgbdFrame {
            id: frame,
            stamp,
            depth_stamp: stamp,
            gray: GrayImage::new(1, 1),
            colour: None,
            depth: DepthImage::default(),
        })),
        report: FrameReport {
            inertial: None,
            odometry: None,
            frame,
            stamp,
            outcome: Outcome::Tracked,
            world_from_camera: None,
            undecided: None,
            verdicts: [].into(),
            segments: Segments::default(),
            objects: [].into(),
            counts: FrameCounts::default(),
            still: None,
            is_keyframe: false,
            submap: None,
            map_version: 0,
        },
        health: Health {
            inertial: None,
            odometry: None,
            frame,
            stamp,
            quality: Quality::default(),
            covariance: None,
            covariance_in_map: None,
            static_share: 1.0,
            dynamic_share: 0.0,
            depth_share: 1.0,
            detections_age: None,
            map_age: None,
            undecided: false,
            loss: None,
            still: None,
        },
    }))
}

/// The queued events: `d` and `f` for detections and frames with their numbers, `F` for a frame with its image.
fn waiting(events: &Events) -> String {
    let named = |event: Event| match event {
        Event::Detected(d) => format!("d{}", d.frame.0),
        Event::Frame(f) if f.frame.is_some() => format!("F{}", f.report.frame.0),
        Event::Frame(f) => format!("f{}", f.report.frame.0),
        _ => "?".to_owned(),
    };
    events.try_iter().map(named).collect::<Vec<_>>().join(" ")
}

fn missed(events: &Events) -> (u64, u64) {
    let missed = events.missed();
    (missed.events, missed.images)
}

#[test]
fn until_full_delivers_in_order_and_drops_the_newest() {
    let audience = Audience::default();
    let events = audience.listen("test", Delivery::until_full(3));
    for n in 0..5 {
        audience.publish(&detected(n));
    }
    assert_eq!(waiting(&events), "d0 d1 d2");
    assert_eq!(missed(&events), (2, 0));
    audience.publish(&tracked(5));
    audience.publish(&detected(6));
    assert_eq!(waiting(&events), "f5 d6");
    assert_eq!(audience.missed()[0].0, "test");
    assert_eq!(audience.missed()[0].1.events, 2);
}

#[test]
fn newest_delivers_the_newest_of_each_kind() {
    let audience = Audience::default();
    let events = audience.listen("test", Delivery::newest(2).with_images(1, 1));
    for n in 0..4 {
        audience.publish(&detected(n));
        audience.publish(&tracked(n));
    }
    // One image at a time: an older frame is dropped for one with its image.
    assert_eq!(waiting(&events), "d2 d3 F3");
    assert_eq!(missed(&events), (2 + 3, 0));
    // Taking an event makes room.
    audience.publish(&tracked(4));
    assert_eq!(waiting(&events), "F4");
}

#[test]
fn images_are_bounded_and_delivered_at_their_stride() {
    let audience = Audience::default();
    let events = audience.listen("test", Delivery::until_full(100).with_images(2, 3));
    let others = audience.listen("others", Delivery::until_full(100));
    for n in 0..10 {
        audience.publish(&tracked(n));
    }
    assert_eq!(waiting(&events), "F0 f1 f2 F3 f4 f5 f6 f7 f8 f9");
    assert_eq!(missed(&events), (0, 2));
    audience.publish(&tracked(10));
    audience.publish(&tracked(12));
    audience.publish(&tracked(13));
    assert_eq!(waiting(&events), "f10 f12 F13");
    // A subscriber without images misses none.
    assert!(!waiting(&others).contains('F'));
    assert_eq!(missed(&others), (0, 0));
}

#[test]
fn dropped_listener_blocks_nothing() {
    let audience = Audience::default();
    let events = audience.listen("test", Delivery::until_full(1));
    audience.publish(&detected(0));
    let first = tracked(1);
    drop(events);
    audience.publish(&first);
    audience.wait_for_room();
    let Event::Frame(frame) = &first else {
        unreachable!()
    };
    assert_eq!(Arc::strong_count(frame), 1);
}

#[test]
fn panicking_subscriber_is_reported_and_others_continue() {
    let audience = Audience::default();
    let start = |name: &str, worst: u32| {
        let events = audience.listen(name, Delivery::until_full(10));
        let mut seen = 0;
        let count = OnEvent(move |_: &Event| {
            seen += 1;
            assert!(seen < worst, "no more of this");
        });
        start(name, events, count, || {}).unwrap()
    };
    let (weak, strong) = (start("weak", 2), start("strong", 100));
    for n in 0..5 {
        audience.publish(&detected(n));
    }
    audience.close();
    assert_eq!(weak.0.join().err().unwrap(), "no more of this");
    assert!(strong.0.join().is_ok());
    strong.1.finish(Duration::from_secs(600));
    weak.1.finish(Duration::from_secs(600));
}

#[test]
fn hanging_subscriber_is_abandoned_with_counted_events() {
    let audience = Audience::default();
    let (hangs, hanging) = channel();
    let (release, released) = channel::<()>();
    let subscriber = OnEvent(move |_: &Event| {
        hangs.send(()).unwrap();
        // Until the test releases it.
        let _ = released.recv();
    });
    let events = audience.listen("hanging", Delivery::until_full(4));
    let (subscribed, listening) = start("hanging", events, subscriber, || {}).unwrap();
    audience.publish(&detected(0));
    hanging.recv().unwrap();
    for n in 1..8 {
        audience.publish(&detected(n));
    }
    audience.close();
    listening.finish(Duration::ZERO);
    // One was taken, four were queued, three did not fit.
    assert_eq!(audience.missed()[0].1.events, 3 + 4);
    assert!(subscribed.join().err().unwrap().contains("given up"));
    // It resumes and receives nothing more; its end drops the sender.
    drop(release);
    assert!(hanging.recv().is_err());
}

#[test]
fn progressing_subscriber_is_waited_for() {
    let audience = Audience::default();
    let (next, turn) = channel();
    let mut received = 0;
    let count = OnEvent(move |_: &Event| {
        turn.recv().unwrap();
        received += 1;
        assert!(received <= 5, "more than there were");
    });
    let events = audience.listen("slow", Delivery::until_full(10));
    let (subscribed, listening) = start("slow", events, count, || {}).unwrap();
    for n in 0..5 {
        audience.publish(&detected(n));
    }
    audience.close();
    let feeder = std::thread::spawn(move || (0..5).for_each(|_| next.send(()).unwrap()));
    listening.finish(Duration::from_secs(600));
    feeder.join().unwrap();
    assert!(subscribed.join().is_ok());
    assert_eq!(audience.missed()[0].1.events, 0);
}
