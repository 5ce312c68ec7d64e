//! Real recordings, where they are.

use super::world::{Recording, with};
use stillpoint_detection::{BoundingBox, ClassId, Detection, ScriptRow};
use stillpoint_imaging::FrameId;
use stillpoint_slam::Preset;

/// Boxes of the people in a recording, from its file `boxes.csv`: `timestamp,walker,x0,y0,x1,y1,visible_px`.
fn boxes(name: &str) -> Vec<ScriptRow> {
    let text = std::fs::read_to_string(stillpoint_testdata::folder().join(name).join("boxes.csv"))
        .unwrap();
    let row = |line: &str| {
        let v: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
        ScriptRow {
            stamp: v[0],
            detection: Detection {
                class: ClassId::PERSON,
                score: 0.8,
                bounds: BoundingBox {
                    x0: v[2],
                    y0: v[3],
                    x1: v[4],
                    y1: v[5],
                },
            },
        }
    };
    text.lines().skip(1).map(row).collect()
}

#[test]
fn people_before_a_desk() {
    let Some(mut recording) = Recording::real("fr1_xyz_walkers") else {
        return;
    };
    let alone = recording.run(with(Preset::Default));
    let error = recording.ate_mm(&alone);
    println!("no detector: {error:.2} mm");
    assert_eq!(alone.lost(), 0);
    assert!(error < 22.4, "{error} mm");

    recording.script = boxes("fr1_xyz_walkers");
    let detected = recording.run_detected(with(Preset::Default));
    let error = recording.ate_mm(&detected);
    println!("true boxes: {error:.2} mm");
    assert_eq!(detected.lost(), 0);
    assert!(error < 14.6, "{error} mm");

    let off = recording.run(with(Preset::Off));
    let error = recording.ate_mm(&off);
    println!("off: {error:.2} mm");
    assert!(error > 22.4, "control: {error} mm");
}

/// People fill the image for a second, few keypoints are wanted, and the map comes late: what drifts meanwhile is undone. With the map
/// not looked for again the error is 84 to 94 mm (docs/decisions/0018).
#[test]
fn what_drifted_among_people_is_undone() {
    let Some(recording) = Recording::real("fr1_xyz_walkers") else {
        return;
    };
    let mut config = with(Preset::Default);
    config.features.features = 500;
    config.schedule.mapper = 6;
    let run = recording.run(config);
    let error = recording.ate_mm(&run);
    println!("500 keypoints, map 6 frames late: {error:.2} mm");
    assert_eq!(run.lost(), 0);
    assert!(error < 22.4, "{error} mm");
}

/// At 90 to 180 deg/s into a part of the room that was not seen yet, people come in: a shift and a part of a degree look alike, and the camera's momentum decides
/// between both. Without it the error is 49 mm (docs/decisions/0044).
#[test]
fn a_fast_turn_towards_people_is_held_by_the_momentum() {
    let Some(mut recording) = Recording::real("fr1_rpy_walkers") else {
        return;
    };
    recording.frames.drain(..80);
    for (id, frame) in (0..).zip(&mut recording.frames) {
        frame.id = FrameId(id);
    }
    let run = recording.run(with(Preset::Default));
    let error = recording.ate_mm(&run);
    println!("a fast turn towards people: {error:.2} mm");
    assert_eq!(run.lost(), 0);
    assert!(error < 40.0, "{error} mm");
}

#[test]
fn a_desk_without_people_is_tracked_as_well_as_without_the_filter() {
    let Some(recording) = Recording::real("fr1_xyz") else {
        return;
    };
    let [on, off] = [Preset::Default, Preset::Off].map(|preset| {
        let run = recording.run(with(preset));
        assert_eq!(run.lost(), 0, "{preset:?}");
        recording.ate_mm(&run)
    });
    println!("on: {on:.2} mm, off: {off:.2} mm");
    assert!(on < 1.05 * off, "on: {on} mm, off: {off} mm");
}
