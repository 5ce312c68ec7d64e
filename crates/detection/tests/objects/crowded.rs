//! Frames full of boxes, from a detector with a wrong threshold.

use super::world::{RATE, Walker, World, person, uniform};
use stillpoint_detection::{
    BoundingBox, Detections, MOST_DETECTIONS, Object, ObjectTracker, ObjectsConfig,
};
use stillpoint_geometry::{Se3, Vec3};
use stillpoint_imaging::FrameId;

/// Two thousand boxes per frame: the best one is tracked as if alone, and the number of others is bounded. Comparing
/// all with all would take half an hour.
#[test]
fn strongest_of_thousands_of_boxes_is_tracked() {
    let world = World::new(vec![Walker::new(|_| Vec3::new(0.2, 0.2, 2.5))], |_| {
        Se3::default()
    });
    let mut tracker = ObjectTracker::new(ObjectsConfig::default(), world.camera);
    for frame in 0..12 {
        let t = f64::from(frame) / RATE;
        let noise = |i: u64| {
            let part = |k: u64| uniform(7, [u64::from(frame), i, k]);
            let (x0, y0) = (600.0 * part(0), 440.0 * part(1));
            let mut noise = person(BoundingBox {
                x0,
                y0,
                x1: x0 + 20.0 + 100.0 * part(2),
                y1: y0 + 20.0 + 100.0 * part(3),
            });
            noise.score = 0.3 + 0.2 * part(4) as f32;
            noise
        };
        let mut items: Vec<_> = (0..2000).map(noise).collect();
        let truth = world.truth(0, t).unwrap().0;
        items.push(person(truth));
        let detections = Detections {
            frame: FrameId(frame),
            stamp: t,
            items,
        };
        tracker.update(&detections, &world.pose(t), &world.depth(t));
        let objects = tracker.predict(t, &world.pose(t));
        assert!(objects.len() <= MOST_DETECTIONS, "{}", objects.len());
        let of_person = |o: &&Object| o.score == 0.8 && o.bounds.iou(&truth) > 0.8;
        assert!(objects.iter().any(|o| of_person(&o)), "frame {frame}");
    }
}
