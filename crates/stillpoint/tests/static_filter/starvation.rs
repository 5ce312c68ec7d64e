//! Few static features: losing track is worse than keeping some bad points.

use super::world::{Recording, with};
use stillpoint_detection::{BoundingBox, ClassId, Detection, ScriptRow};
use stillpoint_geometry::Camera;
use stillpoint_slam::Preset;

#[test]
fn people_filling_the_view_lose_no_frame() {
    // A longer lens: at their closest the people fill almost three quarters of the image.
    let camera = Camera::pinhole(640, 480, [750.0, 750.0, 319.5, 239.5]);
    let recording = Recording::with_camera("walking_xyz", 30..90, 0.3, camera);
    let cover = recording.covers().fold(0.0, f64::max);
    assert!(cover > 0.7, "{cover}");
    let off = recording.ate_mm(&recording.run(with(Preset::Off)));
    let sequence = "sim:walking_xyz frames 30 to 90 by a long lens";
    for (name, run) in [
        ("none", recording.run(with(Preset::Default))),
        (
            "scripted with 30 % missed",
            recording.run_detected(with(Preset::Default)),
        ),
    ] {
        let error = recording.hold(sequence, name, Preset::Default, &run);
        assert_eq!(run.lost(), 0, "{name}");
        assert!(off > 5.0 * error, "control: {off} mm");
    }
}

#[test]
fn box_over_the_whole_image_loses_no_frame() {
    // A detector that takes the room for a person, from the first frame on.
    let mut recording = Recording::simulated("xyz", 0..40, 0.3);
    assert!(recording.script.is_empty());
    let all = BoundingBox {
        x0: -0.5,
        y0: -0.5,
        x1: 639.5,
        y1: 479.5,
    };
    recording.script = recording
        .frames
        .iter()
        .map(|frame| ScriptRow {
            stamp: frame.stamp,
            detection: Detection {
                class: ClassId::PERSON,
                score: 0.9,
                bounds: all,
            },
        })
        .collect();
    let run = recording.run_detected(with(Preset::Default));
    let detector = "a person all over the image";
    recording.hold("sim:xyz 40 frames", detector, Preset::Default, &run);
    assert_eq!(run.lost(), 0);
}

#[test]
fn released_features_match_the_reported_count() {
    let recording = Recording::simulated("walking_static", 70..100, 0.3);
    let mut config = with(Preset::Default);
    config.static_filter.min_features = 1000;
    let run = recording.run_detected(config);
    let mut frames = 0;
    for report in &run.reports {
        let counts = &report.counts;
        let dynamic = report.verdicts.iter().filter(|v| v.dynamic).count();
        assert_eq!(counts.dynamic as usize, dynamic);
        // Released features stop exactly at the requested number.
        let left = counts.keypoints as usize - dynamic;
        if counts.released > 0 {
            assert!(left == 1000.min(counts.keypoints as usize), "{counts:?}");
            frames += 1;
        } else {
            assert!(left >= 1000 || dynamic == 0, "{counts:?}");
        }
    }
    assert!(frames > 10, "{frames}");
    assert_eq!(run.lost(), 0);
}
