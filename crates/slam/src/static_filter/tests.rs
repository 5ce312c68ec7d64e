//! The filter as used by tracking: a person at 1.5 m in front of a wall at 3 m, with detections at various times.

use super::*;
use crate::anchored_pose::AnchoredPose;
use crate::config::Config;
use stillpoint_detection::{BoundingBox, ClassId, Detection};
use stillpoint_geometry::Vec2;
use stillpoint_imaging::{DepthImage, GrayImage};
use stillpoint_map::KeyframeId;

/// The person fills the centre of the box; left and right of it the box contains wall.
const PERSON: std::ops::Range<usize> = 136..184;
const BOX: BoundingBox = BoundingBox {
    x0: 119.5,
    y0: 39.5,
    x1: 199.5,
    y1: 199.5,
};
/// A corner on the person, one on the wall in the box, one on the wall outside.
const CORNERS: [[f32; 2]; 3] = [[160.0, 120.0], [126.0, 120.0], [40.0, 120.0]];

fn camera() -> Camera {
    Camera::pinhole(320, 240, [260.0, 260.0, 159.5, 119.5])
}

fn filter(config: &Config) -> StaticFilter {
    StaticFilter::new(FilterSetup::from(config), &camera())
}

fn detections(frame: u32) -> Detections {
    Detections {
        frame: FrameId(frame),
        stamp: f64::from(frame) / 30.0,
        items: vec![Detection {
            class: ClassId::PERSON,
            score: 0.9,
            bounds: BOX,
        }],
    }
}

fn frame(id: u32) -> RgbdFrame {
    let there = |i: usize| PERSON.contains(&(i % 320)) && (40..200).contains(&(i / 320));
    let depth = (0..320 * 240).map(|i| if there(i) { 1.5 } else { 3.0 });
    RgbdFrame {
        id: FrameId(id),
        stamp: f64::from(id) / 30.0,
        depth_stamp: f64::from(id) / 30.0,
        gray: GrayImage::new(320, 240),
        colour: None,
        depth: DepthImage::from_vec(320, 240, depth.collect()).unwrap(),
    }
}

fn judge(filter: &mut StaticFilter, id: u32) -> Judgement {
    judge_frame(filter, &frame(id), &[1.5, 3.0, 3.0], &[])
}

fn judge_frame(
    filter: &mut StaticFilter,
    frame: &RgbdFrame,
    depths: &[f32],
    pairs: &[Option<FlowPair>],
) -> Judgement {
    let (judgement, next) = filter.judge(
        &FrameInput {
            frame,
            view: &MapView::default(),
            world_from_camera: Se3::identity(),
            camera_from_depth: Se3::identity(),
            features: &CORNERS,
            depths,
            pairs,
            last_from_now: Se3::identity(),
            few: false,
        },
        &mut Memory::default(),
    );
    *filter = next;
    judgement
}

/// Judges a frame and adds its pose.
fn follow(filter: &mut StaticFilter, id: u32) -> Unused {
    judge(filter, id);
    filter.remember(
        &CapturePose {
            anchored: AnchoredPose {
                keyframe: None,
                reference: KeyframeId(0),
                reference_from_camera: Se3::identity(),
                online_world_from_camera: Se3::identity(),
            },
            camera_from_depth: Se3::identity(),
        },
        &mut Memory::default(),
    );
    filter.end_frame()
}

fn dynamic(judgement: &Judgement) -> Vec<bool> {
    judgement.verdicts.iter().map(|v| v.dynamic).collect()
}

/// Disables the release of features: three corners are always too few.
fn config() -> Config {
    let mut config = Config::default();
    config.static_filter.min_features = 0;
    config
}

#[test]
fn detections_of_lost_frames_are_discarded() {
    let mut filter = filter(&config());
    let unused = Unused {
        too_late: 0,
        without_pose: 1,
    };
    // Tracking is lost: the filter receives detections but judges no frame.
    for id in 0..300 {
        filter.receive(detections(id));
        assert_eq!(filter.end_frame(), unused, "frame {id}");
        assert!(filter.waiting.is_none(), "frame {id}");
    }
    // Detections of lost frames do not affect the next tracked one.
    assert!(judge(&mut filter, 300).objects.is_empty());
    assert_eq!(filter.end_frame(), Unused::default());
    // Control: its own detections do.
    filter.receive(detections(301));
    assert_eq!(judge(&mut filter, 301).objects.len(), 1);
    assert_eq!(filter.end_frame(), Unused::default());
}

#[test]
fn late_detections_are_counted() {
    let mut filter = filter(&config());
    let view = MapView::default();
    for id in 0..200 {
        if id != 150 {
            assert_eq!(follow(&mut filter, id), Unused::default());
        }
    }
    // The history is 3.2 s long: from frame 103 on.
    for (id, too_late, without_pose, objects) in [
        (10, 1, 0, 0),
        (102, 1, 0, 0),
        (150, 0, 1, 0),
        (190, 0, 0, 1),
    ] {
        assert!(filter.take_late(&detections(id), &view, None).is_none());
        let expected = Unused {
            too_late,
            without_pose,
        };
        let found = judge(&mut filter, 200).objects.len();
        assert_eq!(
            (filter.end_frame(), found),
            (expected, objects),
            "of frame {id}"
        );
    }
    // A filter that uses no detections counts none as unused.
    let mut deaf = config();
    deaf.static_filter.parts.objects = false;
    let mut filter = self::filter(&deaf);
    filter.receive(detections(0));
    filter.take_late(&detections(0), &view, None);
    assert_eq!(follow(&mut filter, 0), Unused::default());
}

#[test]
fn without_depth_every_feature_in_the_box_is_dynamic() {
    for (depth, expected) in [(true, [true, false, false]), (false, [true, true, false])] {
        let mut config = config();
        config.static_filter.parts.depth = depth;
        let mut filter = filter(&config);
        filter.receive(detections(0));
        assert_eq!(dynamic(&judge(&mut filter, 0)), expected, "depth: {depth}");
    }
}

/// Features on a detected person have hardly any weight in the camera motion; the wall behind keeps its weight.
#[test]
fn features_on_detected_people_get_little_weight() {
    let say = |filter: &StaticFilter| CORNERS.map(|corner| filter.say(corner));
    let mut filter = filter(&config());
    follow(&mut filter, 0);
    // Control: no people are detected.
    assert!(say(&filter).iter().all(|s| (0.4..=1.0).contains(s)));
    filter.receive(detections(1));
    follow(&mut filter, 1);
    let [person, wall, beside] = say(&filter);
    assert!(
        person < 0.1 && wall > 0.4 && beside > 0.4,
        "{person} {wall} {beside}"
    );
    filter.forget();
    assert!(say(&filter)[0] >= 0.4);
}

#[test]
fn discarded_judgement_has_no_side_effects() {
    let mut filter = filter(&config());
    for id in 0..10 {
        follow(&mut filter, id);
    }
    filter.receive(detections(10));
    // Judged with a pose that is 1 m off: all surfaces seem to move, and the person is elsewhere.
    let far = Se3 {
        translation: stillpoint_geometry::Vec3::new(0.0, 0.0, 1.0),
        ..Se3::identity()
    };
    let (frame, view) = (frame(10), MapView::default());
    let input = |world_from_camera| FrameInput {
        frame: &frame,
        view: &view,
        world_from_camera,
        camera_from_depth: Se3::identity(),
        features: &CORNERS,
        depths: &[1.5, 3.0, 3.0],
        pairs: &[],
        last_from_now: Se3::identity(),
        few: false,
    };
    let (expected, _) = filter
        .clone()
        .judge(&input(Se3::identity()), &mut Memory::default());
    let memory = &mut Memory::default();
    let (tried, refused) = filter.judge(&input(far), memory);
    assert_ne!(tried.verdicts, expected.verdicts);
    assert_ne!(refused.surfaces, filter.surfaces);
    memory.give(refused);
    let (found, next) = filter.judge(&input(Se3::identity()), memory);
    assert_eq!(found.verdicts, expected.verdicts);
    assert_eq!(found.objects.len(), 1);
    // Detections remain until a judgement that used them is kept.
    assert!(filter.waiting.is_some() && next.waiting.is_none());
}

/// Corners on a person without depth, beside the person, and far from any person.
const DARK: [[f32; 2]; 10] = [
    [152.0, 120.0],
    [160.0, 124.0],
    [168.0, 128.0],
    [154.0, 132.0],
    [166.0, 136.0],
    [158.0, 140.0],
    [20.0, 100.0],
    [26.0, 104.0],
    [30.0, 108.0],
    [34.0, 112.0],
];

/// Which of these move in the third frame, for a turning person whose dark clothes never have depth; neither has the
/// left of the image. `flow`: motion between two frames, px; `None` if unknown.
fn dark_corners(flow: [Option<f64>; 10], few: bool, detector: bool) -> Vec<bool> {
    let clothes = |x: usize, y: usize| (145..175).contains(&x) && (100..200).contains(&y);
    let depth = (0..320 * 240).map(|i| match (i % 320, i / 320) {
        (x, y) if clothes(x, y) || x < 60 => 0.0,
        (x, y) if PERSON.contains(&x) && (40..200).contains(&y) => 1.5,
        _ => 3.0,
    });
    let depth = DepthImage::from_vec(320, 240, depth.collect()).unwrap();
    let pair = |now: [f32; 2], dx: f64| {
        let now = Vec2::from(now.map(f64::from));
        let before = now + Vec2::new(dx, 0.0);
        FlowPair {
            before_raw: [before.x as f32, before.y as f32],
            before_exposed: before,
            before,
            now,
            flow_sigma: 0.1,
            shutter_sigma: 0.0,
            edge: Vec2::zeros(),
        }
    };
    let rows = |columns: [f32; 2]| (0..24).map(move |i| [columns[i % 2], 45.0 + 6.0 * i as f32]);
    let (room, person) = (rows([250.0, 290.0]), rows([140.0, 180.0]));
    let pairs: Vec<_> = (DARK.iter().zip(flow))
        .map(|(now, dx)| Some(pair(*now, dx?)))
        .chain(room.clone().map(|now| Some(pair(now, 0.0))))
        .chain(person.clone().map(|now| Some(pair(now, 6.0))))
        .collect();
    let features: Vec<_> = DARK.into_iter().chain(room).chain(person).collect();
    let depths: Vec<_> = ([0.0; 10].into_iter().chain([3.0; 24]))
        .chain([1.5; 24])
        .collect();
    let mut filter = filter(&config());
    let mut moving = Vec::new();
    for id in 0..3 {
        if detector {
            filter.receive(detections(id));
        }
        let frame = RgbdFrame {
            depth: depth.clone(),
            ..frame(id)
        };
        let input = FrameInput {
            frame: &frame,
            view: &MapView::default(),
            world_from_camera: Se3::identity(),
            camera_from_depth: Se3::identity(),
            features: &features,
            depths: &depths,
            pairs: &pairs,
            last_from_now: Se3::identity(),
            few,
        };
        let (judgement, next) = filter.judge(&input, &mut Memory::default());
        filter = next;
        moving = dynamic(&judgement)[..10].to_vec();
        assert!(dynamic(&judgement)[34..].iter().all(|moves| *moves), "{id}");
    }
    moving
}

#[test]
fn dark_corners_move_by_majority_near_people() {
    let there = |moves: [bool; 10]| moves.to_vec();
    let [on, off] = [true, false];
    // Far from people, flow alone is not enough.
    let all = [Some(6.0); 10];
    assert_eq!(
        dark_corners(all, false, false),
        there([on, on, on, on, on, on, off, off, off, off])
    );
    assert_eq!(
        dark_corners([Some(0.1); 10], false, false),
        there([off; 10])
    );
    assert_eq!(dark_corners([None; 10], false, false), there([off; 10]));
    // A corner that disagrees is kept, and so is one that moves alone.
    let [mut one, mut rest] = [[Some(0.1); 10], all];
    (one[2], rest[2]) = (Some(6.0), Some(0.1));
    assert_eq!(dark_corners(one, false, false), there([off; 10]));
    assert_eq!(
        dark_corners(rest, false, false),
        there([on, on, off, on, on, on, off, off, off, off])
    );
    // If the camera motion rests on little else, all are kept.
    assert_eq!(dark_corners(all, true, false), there([off; 10]));
    // With a detector, flow of such corners is not used.
    assert_eq!(dark_corners(all, false, true), there([off; 10]));
}
