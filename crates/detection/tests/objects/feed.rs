//! Single frames for the tracker.

use super::world::{RATE, Walker, World, person};
use stillpoint_detection::{
    BoundingBox, Detection, Detections, Object, ObjectTracker, ObjectsConfig,
};
use stillpoint_geometry::{Se3, Vec3};
use stillpoint_imaging::FrameId;

pub(crate) fn standing() -> World {
    World::new(vec![Walker::new(|_| Vec3::new(0.2, 0.2, 2.5))], |_| {
        Se3::default()
    })
}

pub(crate) fn tracker(world: &World) -> ObjectTracker {
    ObjectTracker::new(ObjectsConfig::default(), world.camera)
}

pub(crate) fn detections(frame: u64, items: Vec<Detection>) -> Detections {
    Detections {
        frame: FrameId(frame as u32),
        stamp: frame as f64 / RATE,
        items,
    }
}

pub(crate) fn truth(world: &World, frame: u64) -> BoundingBox {
    world.truth(0, frame as f64 / RATE).unwrap().0
}

/// Feeds one frame with the true box, or none, and returns the objects of that frame.
pub(crate) fn feed(
    tracker: &mut ObjectTracker,
    world: &World,
    frame: u64,
    seen: bool,
) -> Vec<Object> {
    let items = seen.then(|| person(truth(world, frame)));
    feed_items(tracker, world, frame, items.into_iter().collect())
}

pub(crate) fn feed_items(
    tracker: &mut ObjectTracker,
    world: &World,
    frame: u64,
    items: Vec<Detection>,
) -> Vec<Object> {
    let t = frame as f64 / RATE;
    tracker.update(&detections(frame, items), &world.pose(t), &world.depth(t));
    tracker.predict(t, &world.pose(t))
}
