use super::*;
use crate::report::{Column, FrameColumns};
use serde_json::json;

/// A run of frames 10 cm apart, with three people in all images and a fourth in one.
fn run(summary: Value) -> RunData {
    let n = 100_u32;
    let mut run = RunData {
        summary,
        frames: FrameColumns {
            id: (0..n).collect(),
            state: (0..n).map(|_| FrameState::Tracked as u8).collect(),
            sigma_mm: (0..n).map(|_| 3.0).collect(),
            pose: (0..n)
                .flat_map(|i| [0.1 * i as f32, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
                .collect(),
            ..FrameColumns::default()
        },
        ..RunData::default()
    };
    run.pictures.frame = (0..n).collect();
    run.objects.classes = vec!["chair".to_owned(), "person".to_owned()];
    let mut people: Vec<u32> = (0..n).flat_map(|f| [f; 3]).collect();
    people.push(7);
    run.objects.class = Column(vec![1; people.len()]);
    run.objects.frame = Column(people);
    run
}

fn judged(mut run: RunData) -> (Concern, String) {
    run.judge();
    (run.verdict.concern, run.verdict.text)
}

fn accuracy(rmse: f64) -> Value {
    json!({"final": {"ate": {"rmse": rmse}}})
}

#[test]
fn good_run_raises_no_concern() {
    let good = json!({"frames": 100, "tracked": 100, "skipped": 0, "accuracy": accuracy(0.0059)});
    let expected = "Tracked all 100 frames among up to 3 people; 5.9 mm from the truth; nothing to worry about.";
    assert_eq!(judged(run(good)), (Concern::None, expected.to_owned()));
    let unknown = json!({"frames": 100, "tracked": 100});
    let (concern, text) = judged(run(unknown));
    assert_eq!(concern, Concern::None);
    assert!(
        text.contains("certain to 3.0 mm by its own reckoning"),
        "{text}"
    );
    let fixed =
        json!({"frames": 100, "tracked": 100, "accuracy": {"final": {"drift": {"rmse": 0.0018}}}});
    let text = judged(run(fixed)).1;
    assert!(
        text.contains("drifted 1.8 mm while it stood still"),
        "{text}"
    );
}

#[test]
fn inaccurate_run_raises_grave_concern() {
    let bad = json!({"frames": 100, "tracked": 100, "accuracy": accuracy(0.2174)});
    let mut off = run(bad);
    let (concern, text) = judged(off.clone());
    assert_eq!(concern, Concern::Grave);
    assert!(
        text.contains("217.4 mm from the truth; that is far off: check"),
        "{text}"
    );
    off.config =
        "[static_filter]\n# Strategy: \"off\", or \"default\".\npreset = \"off\"\n[loops]\n"
            .to_owned();
    let text = judged(off.clone()).1;
    assert!(text.contains("the static filter was off"), "{text}");
    // Another section may have a setting of that name.
    off.config = "[static_filter]\npreset = \"default\"\n[loops]\npreset = \"off\"\n".to_owned();
    assert!(!judged(off.clone()).1.contains("filter was off"));
    // On a path of ten metres 9 cm are less than 1 %.
    off.summary = json!({"frames": 100, "tracked": 100, "accuracy": accuracy(0.09)});
    assert_eq!(judged(off).0, Concern::None);
}

#[test]
fn filter_off_without_ground_truth_is_reported() {
    let mut off = run(json!({"frames": 100, "tracked": 100}));
    off.config = "[static_filter]\npreset = \"off\"\n".to_owned();
    let (concern, text) = judged(off);
    assert_eq!(concern, Concern::Some);
    assert!(text.contains("poses may follow them"), "{text}");
}

#[test]
fn losses_are_reported_with_a_remedy() {
    let loss = |first: u32, last: u32, seconds: f64| json!({"first": first, "last": last, "seconds": seconds, "reason": LostReason::FewMatches.to_string(), "then": "found again"});
    let few = json!({"frames": 100, "tracked": 95, "accuracy": accuracy(0.004), "lost": [loss(10, 10, 0.1), loss(20, 23, 0.2)]});
    let (concern, text) = judged(run(few));
    assert_eq!(concern, Concern::Some);
    assert_eq!(
        text,
        "Tracked 95 of 100 frames among up to 3 people; 4.0 mm from the truth; no pose in frames 20 to 23 \
         (0.2 s, the longest of 2 losses: too few keypoints match the map), then found again: move more slowly, or go back to a place that was seen."
    );
    let many = json!({"frames": 100, "tracked": 60, "lost": [loss(60, 99, 1.3)]});
    assert_eq!(judged(run(many)).0, Concern::Grave);
    let none = json!({"frames": 100, "tracked": 0, "lost": [loss(0, 99, 3.3)]});
    let (concern, text) = judged(run(none));
    assert_eq!(concern, Concern::Grave);
    assert!(text.starts_with("Tracked none of 100 frames"), "{text}");
}

#[test]
fn missing_frames_are_reported() {
    for (summary, expected) in [
        (
            json!({"frames": 90, "tracked": 90, "skipped": 10}),
            "10 frames could not be read",
        ),
        (
            json!({"frames": 80, "tracked": 80, "live": {"dropped": 20}}),
            "20 frames came faster",
        ),
        (
            json!({"frames": 100, "tracked": 60, "submaps": [{"frames": 60}, {"frames": 40}]}),
            "40 frames are in a map",
        ),
        (
            json!({"frames": 100, "tracked": 100, "interrupted": true}),
            "interrupted",
        ),
        (
            json!({"frames": 100, "tracked": 100, "detector": {"failed_frames": 3}}),
            "failed on 3 frames",
        ),
    ] {
        let (concern, text) = judged(run(summary));
        assert!(
            concern != Concern::None && text.contains(expected),
            "{text}"
        );
        assert!(!text.contains("nothing to worry"), "{text}");
    }
    let mut short = run(json!({"frames": 100, "tracked": 100}));
    short.frames.state = Column(vec![FrameState::Undecided as u8; 100]);
    assert!(judged(short).1.contains("undecided who moves"));
}

#[test]
fn every_loss_reason_has_a_remedy() {
    for reason in [
        LostReason::FewFeatures,
        LostReason::FewDepths,
        LostReason::FewMatches,
        LostReason::FewInliers,
        LostReason::AgainstGyro,
        LostReason::AgainstOdometry,
        LostReason::Repeated,
    ] {
        assert_ne!(remedy(&reason.to_string()), remedy(""), "{reason}");
    }
}
