//! Laws that hold for any input of the tracker.

use super::world::{distorted, person};
use proptest::prelude::*;
use stillpoint_detection::{BoundingBox, Detections, ObjectTracker, ObjectsConfig};
use stillpoint_geometry::Se3;
use stillpoint_imaging::{CoarseDepth, DepthImage, FrameId};

/// Stamp, boxes, pose twist and depth: mostly valid, occasionally not.
fn anything() -> impl Strategy<Value = (f64, Vec<[f64; 4]>, [f64; 6], f32)> {
    let coordinate = prop_oneof![
        8 => -200.0..900.0_f64,
        1 => Just(f64::NAN),
        1 => Just(1e300),
    ];
    (
        prop_oneof![8 => 0.0..5.0_f64, 1 => -1e9..1e9_f64, 1 => Just(f64::NAN)],
        prop::collection::vec(prop::array::uniform4(coordinate), 0..6),
        prop::array::uniform6(-2.0..2.0_f64),
        prop_oneof![0.0..6.0_f32, Just(0.0), Just(1e6)],
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn objects_are_finite_and_distinct_for_any_input(frames in prop::collection::vec(anything(), 1..20)) {
        let mut t = ObjectTracker::new(ObjectsConfig::default(), distorted());
        for (stamp, boxes, twist, z) in frames {
            let items = boxes.iter().map(|b| person(BoundingBox { x0: b[0], y0: b[1], x1: b[2], y1: b[3] }));
            let d = Detections { frame: FrameId(0), stamp, items: items.collect() };
            let pose = Se3::exp(&twist.into());
            let depth = DepthImage::from_vec(640, 480, vec![z; 640 * 480]).unwrap();
            t.update(&d, &pose, &CoarseDepth::new(&depth, 8));
            for at in [stamp, stamp + 0.7, stamp - 0.2] {
                let objects = t.predict(at, &pose);
                prop_assert!(objects.windows(2).all(|o| o[0].id < o[1].id));
                for o in &objects {
                    let b = o.bounds;
                    prop_assert!(b.x0 <= b.x1 && b.y0 <= b.y1, "{b:?}");
                    prop_assert!(b.x0 >= -0.5 && b.x1 <= 639.5 && b.y0 >= -0.5 && b.y1 <= 479.5, "{b:?}");
                    prop_assert!(o.bounds_sigma.iter().all(|s| s.is_finite()));
                    prop_assert!(o.position.is_none_or(|p| p.iter().all(|x| x.is_finite())));
                    prop_assert!(o.covariance.is_none_or(|c| c.iter().all(|x| x.is_finite()) && (0..6).all(|i| c[(i, i)] > 0.0)));
                    prop_assert!(o.depth_range.is_none_or(|r| r[0] >= 0.0 && r[0] < r[1]));
                }
            }
        }
    }
}
