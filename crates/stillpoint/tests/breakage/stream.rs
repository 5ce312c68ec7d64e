//! Frames that are repeated, out of order, late, or have a different clock.

use super::world::{
    Frames, Recording, Session, assert_kept, at_home, config, losses, room, small, undisturbed,
    until_pose, walk, within,
};
use stillpoint_imaging::{DepthImage, GrayImage, RgbdFrame, Simd};
use stillpoint_live::{Delivery, LiveOptions, LiveSystem};
use stillpoint_slam::{Event, OnEvent, RefusalReason, Replay, Stages};

fn shifted(mut frames: Vec<RgbdFrame>, seconds: f64) -> Vec<RgbdFrame> {
    for frame in &mut frames {
        frame.stamp += seconds;
        frame.depth_stamp += seconds;
    }
    frames
}

#[test]
fn repeated_frames_change_nothing() {
    let mut session = Session::new(room(), config());
    let mut frames = Vec::new();
    for frame in room().play(0..130) {
        frames.extend([frame.clone(), frame]);
    }
    assert_eq!(session.feed(frames).len(), 130);
    assert_eq!(session.refused().len(), 130);
    let by_number = |r: &stillpoint_slam::RefusedFrame| matches!(r.reason, RefusalReason::Number { newest } if newest == r.frame);
    assert!(session.refused().iter().all(by_number));
    assert_eq!(session.digest(), undisturbed("room", room()));

    // The same image again with the next number.
    let mut session = Session::new(room(), config());
    let mut frames = Vec::new();
    for (i, frame) in room().play(0..40).into_iter().enumerate() {
        let number = |k: usize| stillpoint_imaging::FrameId((2 * i + k) as u32);
        let [mut first, mut again] = [frame.clone(), frame];
        (first.id, again.id) = (number(0), number(1));
        frames.extend([first, again]);
    }
    let reports = session.feed(frames);
    assert_eq!((reports.len(), session.refused().len()), (40, 40));
    assert!(losses(&reports).is_empty());
}

#[test]
fn out_of_order_frames_are_dropped_without_side_effects() {
    let mut frames = room().play(0..70);
    frames.swap(20, 21);
    frames[40..44].reverse();
    let frame = frames.remove(50);
    frames.insert(60, frame);
    let mut session = Session::new(room(), config());
    session.feed(frames);
    let refused: Vec<u32> = session.refused().iter().map(|r| r.frame.0).collect();
    assert_eq!(refused, [20, 42, 41, 40, 50]);

    let mut without = Session::new(room(), config());
    let in_order = room().play(0..70).into_iter();
    without.feed(in_order.filter(|f| !refused.contains(&f.id.0)).collect());
    assert_eq!(session.digest(), without.digest());
    assert!(losses(&session.reports()).is_empty());
    // Control: the refused frames matter.
    let mut all = Session::new(room(), config());
    all.feed(room().play(0..70));
    assert_ne!(session.digest(), all.digest());
}

#[test]
fn two_second_gap_is_bridged() {
    let mut session = Session::new(room(), config());
    session.feed(room().play(0..60));
    let before = session.view();
    // During the gap the camera stood still, or returned to its position a second before.
    for (next, what) in [(60..90, "it stood still"), (30..60, "it went back")] {
        let after = session.go_on(room().play(next), 2.0);
        println!("pose after {} frames", until_pose(&after));
        assert!(until_pose(&after) <= 1);
        assert_eq!(at_home(&after), after.len() - until_pose(&after));
        session.hold(&format!("a gap in which {what}"), room(), &after);
    }
    assert_kept(&before, &session.view());
}

#[test]
fn clock_jump_loses_at_most_one_frame() {
    for jump in [-3600.0, -0.1, 0.5, 86400.0] {
        let mut session = Session::new(room(), config());
        session.feed(room().play(0..50));
        let before = session.view();
        let after = session.feed(shifted(room().play(50..110), jump));
        let refused = usize::from(jump < 0.0);
        assert_eq!(session.refused().len(), refused, "{jump} s");
        assert_eq!(after.len(), 60 - refused, "{jump} s");
        assert!(losses(&after).is_empty(), "{jump} s");
        session.hold(&format!("a clock set by {jump} s"), room(), &after);
        assert_kept(&before, &session.view());
    }
}

/// State with stamps of the old clock must be dropped.
#[test]
fn detector_works_after_a_backward_clock_jump() {
    let people = Recording::new("walking_xyz", 40..80, small(267.5));
    let with_objects = |jump: f64| {
        // The detector's script uses the original stamps.
        let config = config();
        let detector = Box::new(Shifted(people.detector(), 20, jump));
        let mut session = Session::new(&people, config).with_detector(detector);
        session.feed(people.play(0..20));
        let after = session.feed(shifted(people.play(20..40), jump));
        after.iter().filter(|r| !r.objects.is_empty()).count()
    };
    let (straight, jumped) = (with_objects(0.0), with_objects(-3600.0));
    println!("frames with objects: {straight}, after a jump {jumped}");
    assert!(straight > 10);
    assert!(jumped + 3 >= straight, "{jumped} of {straight}");
}

/// A detector with original stamps, while the clock jumps at a frame.
struct Shifted(Box<dyn stillpoint_detection::Detector>, u32, f64);

impl stillpoint_detection::Detector for Shifted {
    fn detect(
        &mut self,
        frame: &RgbdFrame,
    ) -> Result<stillpoint_detection::Detections, stillpoint_detection::DetectError> {
        let mut own = frame.clone();
        if frame.id.0 >= self.1 {
            own.stamp -= self.2;
        }
        let mut said = self.0.detect(&own)?;
        said.stamp = frame.stamp;
        Ok(said)
    }

    fn info(&self) -> stillpoint_detection::DetectorInfo {
        self.0.info()
    }
}

/// A covered camera whose clock is set back, uncovered far away in the same room.
#[test]
fn lost_camera_relocalises_after_a_backward_clock_jump() {
    let found_after = |jump: f64| {
        let mut session = Session::new(walk(), config());
        session.feed(walk().play(0..60));
        let dark = walk().disturbed(60..75, stillpoint_datasets::Disturbance::Black);
        let (first, second) = dark.split_at(2);
        session.feed(first.to_vec());
        session.feed(shifted(second.to_vec(), jump));
        // Like after 40 dark frames, 0.6 m from its last position.
        let after = session.go_on(walk().play(0..20), 1.0);
        let home = at_home(&after);
        println!(
            "jump of {jump} s: {home} of 20 found, {:.3} m",
            session.worst(walk(), &after)
        );
        home
    };
    let (straight, jumped) = (found_after(0.0), found_after(-3600.0));
    assert!(straight >= 18, "{straight}");
    assert!(jumped >= straight, "{jumped} of {straight}");
}

#[test]
fn frames_not_matching_the_camera_are_refused() {
    let mut session = Session::new(room(), config());
    let mut frames = room().play(0..20);
    frames[10].gray = GrayImage::new(640, 480);
    frames[11].depth = DepthImage::from_vec(160, 120, vec![1.0; 160 * 120]).unwrap();
    frames[12].stamp = f64::NAN;
    frames[13].depth_stamp = f64::INFINITY;
    let reports = session.feed(frames);
    assert!(losses(&reports).is_empty());
    let refused: Vec<u32> = session.refused().iter().map(|r| r.frame.0).collect();
    assert_eq!(refused, [10, 11, 12, 13]);
}

/// The live driver refuses the same frames; they are not logged, and a replay of all frames skips them.
#[test]
fn live_run_refuses_the_same_frames_as_inline() {
    let mut frames = room().play(0..40);
    frames.swap(20, 21);
    let twice: Vec<RgbdFrame> = frames.into_iter().flat_map(|f| [f.clone(), f]).collect();
    let stages = || Stages::new(config(), room().camera, Simd::detect()).unwrap();
    let pushed = twice.clone();
    let (result, events) = within(move || {
        let options = LiveOptions {
            drop_late: false,
            ..LiveOptions::default()
        };
        let mut live = LiveSystem::start(stages(), None, options).unwrap();
        let events = live.listen("test", Delivery::until_full(1000));
        for frame in pushed {
            assert!(live.push(frame));
        }
        (live.finish(), events)
    });
    let s = &result.statistics;
    assert_eq!((s.refused, s.arrived, s.frames.len()), (41, 39, 39));
    let reported = events.iter();
    assert_eq!(
        reported.filter(|e| matches!(e, Event::Refused(_))).count(),
        41
    );
    let mut replay = Replay::new(stages(), result.log).unwrap();
    let mut nobody = OnEvent(|_: &Event| {});
    replay.run(&mut Frames::of(twice), &mut nobody).unwrap();
    let digest = result.trajectory.digest(&result.view);
    assert_eq!(replay.trajectory().digest(&replay.view()), digest);
}
