//! Late detections: propagated forward to the present, and back to their keyframe.

use super::world::{Recording, Run, shows_mover, with};
use std::sync::LazyLock;
use stillpoint_imaging::GrayImage;
use stillpoint_map::KeyframeId;
use stillpoint_slam::{Config, Preset, Reasons};

fn late(frames: u32) -> Config {
    let mut config = with(Preset::Default);
    config.schedule.detector = frames;
    config
}

/// People walk in, cross close in front of the camera and fill half of the image.
static CROSSING: LazyLock<Recording> =
    LazyLock::new(|| Recording::simulated("walking_xyz", 20..110, 0.3));
/// Its name in the table of errors.
const SEQUENCE: &str = "sim:walking_xyz frames 20 to 110";
/// Its ATE without the filter, mm.
static OFF: LazyLock<f64> = LazyLock::new(|| {
    let run = CROSSING.run(with(Preset::Off));
    CROSSING.ate_mm(&run)
});

/// Share of rejected keypoints on people that were attributed to an object.
fn named(recording: &Recording, run: &Run) -> f64 {
    let (mut dynamic, mut named) = (0_usize, 0_usize);
    for (mask, report) in recording.masks.iter().zip(&run.reports) {
        let on_people = |v: &&_| shows_mover(mask, v);
        for v in report.verdicts.iter().filter(on_people) {
            dynamic += usize::from(v.dynamic);
            named += usize::from(v.dynamic && v.reasons.has(Reasons::OBJECT));
        }
    }
    named as f64 / dynamic.max(1) as f64
}

#[test]
fn late_detections_are_propagated_forward() {
    let recording = &CROSSING;
    for (delay, least) in [(1, 0.88), (3, 0.8), (10, 0.45)] {
        let run = recording.run_detected(late(delay));
        let named = named(recording, &run);
        println!("{delay} frames late: {named:.3} on objects");
        assert_eq!(run.lost(), 0, "{delay} frames late");
        let detector = format!("scripted with 30 % missed {delay} late");
        let error = recording.hold(SEQUENCE, &detector, Preset::Default, &run);
        // Control: without the filter the same frames fail.
        assert!(*OFF > 10.0 * error, "off: {} mm", *OFF);
        assert!(named > least, "{delay} frames late: {named} on objects");
    }
    // Control: without a detector there are no objects.
    let alone = recording.run(with(Preset::Default));
    assert!(named(recording, &alone).abs() < f64::EPSILON);
}

#[test]
fn detector_on_every_fifth_frame_suffices() {
    let recording = &CROSSING;
    let mut config = late(3);
    config.detector.stride = 5;
    let run = recording.run_detected(config);
    let named = named(recording, &run);
    println!("every fifth frame, 3 late: {named:.3} on objects");
    assert_eq!(run.lost(), 0);
    let detector = "scripted with 30 % missed every 5 and 3 late";
    let error = recording.hold(SEQUENCE, detector, Preset::Default, &run);
    assert!(named > 0.45, "{named} on objects");
    assert!(*OFF > 10.0 * error, "off: {} mm", *OFF);
}

/// Numbers of detections that were too late, and of those for frames without a pose.
fn unused(run: &Run) -> (u32, u32) {
    let counts = run.reports.iter().map(|r| &r.counts);
    counts.fold((0, 0), |(late, lost), c| {
        (
            late + c.detections_too_late,
            lost + c.detections_without_pose,
        )
    })
}

#[test]
fn unusable_detections_are_counted() {
    // The history is 3.2 s long, 96 frames: of 104 frames the answers to the first four arrive 100 frames late.
    let mut recording = Recording::simulated("walking_static", 20..124, 0.3);
    assert_eq!(unused(&recording.run_detected(late(90))), (0, 0));
    let run = recording.run_detected(late(100));
    assert_eq!((run.lost(), unused(&run)), (0, (4, 0)));
    // Ten frames with a covered lens.
    for frame in &mut recording.frames[30..40] {
        let (width, height) = (frame.gray.width(), frame.gray.height());
        frame.gray = GrayImage::new(width, height);
    }
    for delay in [0, 3] {
        let run = recording.run_detected(late(delay));
        assert!(run.lost() >= 10);
        let expected = (0, run.lost() as u32);
        assert_eq!(unused(&run), expected, "{delay} frames late");
    }
}

/// Number of landmarks observed by keyframe 0 on people, and elsewhere.
fn landmarks_of_first(recording: &Recording, run: &Run) -> (usize, usize) {
    let view = run.system.view();
    let keyframe = view.keyframe(KeyframeId(0)).unwrap();
    let matched = keyframe.matches.iter().zip(run.reports[0].verdicts.iter());
    let (mut people, mut rest) = (0, 0);
    for (_, verdict) in matched.filter(|(landmark, _)| landmark.is_some()) {
        if shows_mover(&recording.masks[0], verdict) {
            people += 1;
        } else {
            rest += 1;
        }
    }
    (people, rest)
}

#[test]
fn first_keyframe_is_rejudged_with_late_detections() {
    // A person is visible from the first frame on: only a detector can tell. No person is missed.
    let recording = Recording::simulated("walking_static", 78..84, 0.0);
    let without = recording.run(with(Preset::Default));
    let (before, _) = landmarks_of_first(&recording, &without);
    assert!(before > 50, "{before} landmarks on people");
    assert!(without.rejudged.is_empty());

    let run = recording.run_detected(late(3));
    let first = run.rejudged.iter().find(|r| r.keyframe == KeyframeId(0));
    let removed = first.map_or(0, |r| r.landmarks);
    let (people, rest) = landmarks_of_first(&recording, &run);
    println!("{before} landmarks on people, {removed} removed, {people} left, {rest} elsewhere");
    assert!(removed as usize > before / 2);
    assert!(people < before / 4, "{people} of {before} are left");
    assert!(rest > 100);
    assert_eq!(run.lost(), 0);

    // With detections in time there is nothing to judge again.
    let run = recording.run_detected(late(0));
    assert!(run.rejudged.is_empty());
    let (people, _) = landmarks_of_first(&recording, &run);
    println!("{people} of {before} with detections in time");
    assert!(people < before / 2, "{people} of {before}");
}
