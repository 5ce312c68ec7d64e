//! The cases of Algorithm 2: outside all boxes, in a split box, in an unsplit one, and with missing data.

use super::*;
use crate::static_filter::{FilterParts, FlowPair, Preset};
use stillpoint_detection::{BoundingBox, ObjectId};
use stillpoint_geometry::{Se3, Vec2, Vec3};
use stillpoint_imaging::{DepthImage, FrameId, GrayImage, RgbdFrame};
use stillpoint_map::MapView;

const BOX: BoundingBox = BoundingBox {
    x0: 100.0,
    y0: 0.0,
    x1: 200.0,
    y1: 240.0,
};
const INSIDE: [f32; 2] = [150.0, 100.0];
const OUTSIDE: [f32; 2] = [40.0, 100.0];
/// Features beyond this are background, m.
const SPLIT_AT: f64 = 2.0;
const NEAR: f32 = 1.5;
const FAR: f32 = 3.0;

const PERSON: f64 = 5.0;
const CHAIR: f64 = 3.0;
const DESK: f64 = 1.0;

fn config(parts: &str) -> StaticFilterConfig {
    StaticFilterConfig {
        preset: Preset::Paper,
        parts: FilterParts::try_from(parts.to_owned()).unwrap(),
        ..StaticFilterConfig::default()
    }
}

fn mover(weight: f64, bounds: BoundingBox) -> Mover {
    Mover {
        id: ObjectId(1),
        bounds,
        range: None,
        weight,
        strength: 0.0,
    }
}

/// Verdict on a feature with one box of this weight, split at [`SPLIT_AT`] if the weight requires it.
fn verdict(
    config: &StaticFilterConfig,
    weight: f64,
    pixel: [f32; 2],
    z: f32,
    distance: Option<f64>,
) -> FeatureVerdict {
    let mover = mover(weight, BOX);
    let is_split = config.parts.depth && weight >= config.split_weight;
    let boxes = [SplitBox {
        mover: &mover,
        background_beyond: is_split.then_some(SPLIT_AT),
    }];
    decide(config, pixel, z, distance, &boxes)
}

fn dynamic(weight: f64, pixel: [f32; 2], z: f32, distance: Option<f64>) -> bool {
    verdict(&config("O+G+D"), weight, pixel, z, distance).dynamic
}

#[test]
fn outside_all_boxes_the_epipolar_distance_decides() {
    for z in [0.0, NEAR, FAR] {
        assert!(!dynamic(PERSON, OUTSIDE, z, Some(0.0)));
        assert!(!dynamic(PERSON, OUTSIDE, z, Some(0.99)));
        assert!(dynamic(PERSON, OUTSIDE, z, Some(1.0)));
        assert!(dynamic(PERSON, OUTSIDE, z, Some(8.0)));
        assert!(!dynamic(PERSON, OUTSIDE, z, None));
    }
    let moved = verdict(&config("O+G+D"), PERSON, OUTSIDE, FAR, Some(1.5));
    assert_eq!(moved.reasons, Reasons::EPIPOLAR);
}

#[test]
fn in_a_box_the_weight_multiplies_the_distance() {
    // On the background, so that depth favours the feature.
    for (weight, distance, expected) in [
        (PERSON, 0.19, false),
        (PERSON, 0.21, true),
        (CHAIR, 0.32, false),
        (CHAIR, 0.34, true),
        (DESK, 0.99, false),
        (DESK, 1.01, true),
    ] {
        let found = verdict(&config("O+G+D"), weight, INSIDE, FAR, Some(distance));
        assert_eq!(found.dynamic, expected, "{weight} {distance}");
        assert_eq!(found.reasons.has(Reasons::EPIPOLAR), expected);
        assert_eq!(
            dynamic(weight, OUTSIDE, FAR, Some(distance)),
            distance >= 1.0
        );
    }
}

#[test]
fn in_a_split_box_only_deeper_features_may_be_static() {
    for weight in [PERSON, CHAIR] {
        for distance in [Some(0.0), None] {
            assert!(!dynamic(weight, INSIDE, FAR, distance), "{weight}");
            assert!(dynamic(weight, INSIDE, NEAR, distance), "{weight}");
            // A feature without depth counts as object.
            assert!(dynamic(weight, INSIDE, 0.0, distance), "{weight}");
        }
        // Both criteria must hold.
        assert!(dynamic(weight, INSIDE, FAR, Some(0.5)));
    }
    let kept = verdict(&config("O+G+D"), PERSON, INSIDE, FAR, Some(0.0));
    assert_eq!(kept.reasons, Reasons::DEPTH);
    let rejected = verdict(&config("O+G+D"), PERSON, INSIDE, NEAR, Some(0.0));
    assert_eq!(rejected.reasons, Reasons::DEPTH | Reasons::OBJECT);
}

#[test]
fn in_an_unsplit_box_distance_then_class_decides() {
    for z in [0.0, NEAR, FAR] {
        assert!(!dynamic(DESK, INSIDE, z, Some(0.5)));
        assert!(!dynamic(DESK, INSIDE, z, None));
        // Without D no box is.
        for parts in ["O+G", "O"] {
            let config = config(parts);
            let dynamic = |weight, d| verdict(&config, weight, INSIDE, z, d).dynamic;
            assert!(!dynamic(PERSON, Some(0.1)), "{parts}");
            assert!(dynamic(PERSON, Some(0.3)), "{parts}");
            assert!(dynamic(PERSON, None), "{parts}");
            assert!(!dynamic(CHAIR, None), "{parts}");
        }
    }
}

#[test]
fn threshold_and_split_weight_are_settings() {
    let mut config = config("O+G+D");
    config.epipolar_px = 2.0;
    let dynamic = |pixel, d| verdict(&config, CHAIR, pixel, FAR, Some(d)).dynamic;
    assert!(!dynamic(OUTSIDE, 1.9) && dynamic(OUTSIDE, 2.0));
    assert!(!dynamic(INSIDE, 0.6) && dynamic(INSIDE, 0.7));
    config.split_weight = 4.0;
    let dynamic = |weight| verdict(&config, weight, INSIDE, NEAR, Some(0.0)).dynamic;
    assert!(dynamic(PERSON) && !dynamic(CHAIR));
}

#[test]
fn heaviest_matching_box_decides_in_overlaps() {
    let (person, chair, desk) = (mover(PERSON, BOX), mover(CHAIR, BOX), mover(DESK, BOX));
    let split = |mover, at| SplitBox {
        mover,
        background_beyond: at,
    };
    let judge =
        |boxes: &[SplitBox<'_>], z, d| decide(&config("O+G+D"), INSIDE, z, d, boxes).dynamic;
    // The box of weight 5 decides, in any order.
    for boxes in [
        [split(&person, None), split(&desk, None)],
        [split(&desk, None), split(&person, None)],
    ] {
        assert!(judge(&boxes, FAR, Some(0.3)));
    }
    assert!(!judge(&[split(&desk, None)], FAR, Some(0.3)));
    // Behind the person but possibly on the chair, which then decides.
    let boxes = [split(&person, Some(2.0)), split(&chair, Some(4.0))];
    assert!(judge(&boxes, FAR, Some(0.0)));
    // Behind both it is background, with the weight of the heavier.
    let boxes = [split(&person, Some(2.0)), split(&chair, Some(2.5))];
    assert!(!judge(&boxes, FAR, Some(0.1)));
    assert!(judge(&boxes, FAR, Some(0.3)));
}

#[test]
fn release_risk_orders_by_weight_depth_and_distance() {
    let config = config("O+G+D");
    let risk = |weight, z, d| verdict(&config, weight, INSIDE, z, Some(d)).risk;
    assert!(risk(DESK, NEAR, 2.0) < risk(CHAIR, FAR, 2.0));
    assert!(risk(CHAIR, FAR, 2.0) < risk(CHAIR, NEAR, 2.0));
    assert!(risk(CHAIR, NEAR, 2.0) < risk(PERSON, FAR, 2.0));
    assert!(risk(PERSON, NEAR, 0.5) < risk(PERSON, NEAR, 2.0));
}

/// A static frame, except for the features of the box, half at each of two depths.
fn judged(config: &StaticFilterConfig, depths: [f32; 2], weight: f64) -> Vec<bool> {
    let camera = Camera::pinhole(320, 240, [260.0, 260.0, 159.5, 119.5]);
    let features: Vec<[f32; 2]> = (0..40)
        .map(|i| [105.0 + 2.0 * i as f32, 20.0 + 5.0 * i as f32])
        .collect();
    let z: Vec<f32> = (0..40).map(|i| depths[i % 2] + 0.002 * i as f32).collect();
    let pair = |p: &[f32; 2]| {
        let at = Vec2::new(f64::from(p[0]), f64::from(p[1]));
        Some(FlowPair {
            before_raw: *p,
            before: at,
            before_exposed: at,
            now: at,
            flow_sigma: 0.1,
            shutter_sigma: 0.0,
            edge: Vec2::zeros(),
        })
    };
    let pairs: Vec<Option<FlowPair>> = features.iter().map(pair).collect();
    let frame = RgbdFrame {
        id: FrameId(3),
        stamp: 0.1,
        depth_stamp: 0.1,
        gray: GrayImage::new(320, 240),
        colour: None,
        depth: DepthImage::from_vec(320, 240, vec![1.0; 320 * 240]).unwrap(),
    };
    let input = FrameInput {
        frame: &frame,
        view: &MapView::default(),
        world_from_camera: Se3::identity(),
        camera_from_depth: Se3::identity(),
        features: &features,
        depths: &z,
        pairs: &pairs,
        few: false,
        last_from_now: Se3 {
            translation: Vec3::zeros(),
            ..Se3::identity()
        },
    };
    let verdicts = judge(config, &input, &camera, &[mover(weight, BOX)], 0);
    verdicts.iter().map(|v| v.dynamic).collect()
}

#[test]
fn box_with_two_depths_is_split() {
    let config = config("O+G+D");
    let found = judged(&config, [NEAR, FAR], PERSON);
    let near = (0..40).step_by(2).filter(|i| !found[*i]).count();
    // The threshold is the mean depth of its supporters, so part of the background lies beyond it, and none of the person.
    let far = (1..40).step_by(2).filter(|i| !found[*i]).count();
    assert_eq!(near, 0);
    assert!(far >= 10, "{far}");
    assert!(judged(&config, [NEAR, FAR], DESK).iter().all(|d| !d));
}

#[test]
fn box_of_one_depth_is_split() {
    let found = judged(&config("O+G+D"), [NEAR, NEAR], PERSON);
    let kept = found.iter().filter(|dynamic| !**dynamic).count();
    assert!(kept >= 10, "{kept}");
}
