//! False alarms near missed people, and boxes that also show another person.

use super::feed::{detections, feed, feed_items, standing, tracker, truth};
use super::world::{RATE, Walker, World, person};
use stillpoint_detection::{BoundingBox, Detection, Object, ObjectState};
use stillpoint_geometry::{Se3, Vec3};

fn scored(bounds: BoundingBox, score: f32) -> Detection {
    Detection {
        score,
        ..person(bounds)
    }
}

/// A person is detected for a second, then missed for half a second; then a box with `score` appears around an object
/// of similar shape and depth beside the person. Returns the objects.
fn box_beside(score: f32) -> (BoundingBox, Vec<Object>) {
    let at = |x: f64| Walker::new(move |_| Vec3::new(x, 0.2, 2.5));
    let world = World::new(vec![at(0.2), at(0.6)], |_| Se3::default());
    let mut t = tracker(&world);
    for frame in 0..45 {
        feed(&mut t, &world, frame, frame < 30);
    }
    let beside = world.truth(1, 1.5).unwrap().0;
    let objects = feed_items(&mut t, &world, 45, vec![scored(beside, score)]);
    (truth(&world, 0), objects)
}

/// The position is uncertain after half a second of misses: a sure box beside it is assigned to the person, one of half
/// the usual score is not.
#[test]
fn missed_person_takes_a_sure_box_but_not_a_doubtful_one() {
    let (own, objects) = box_beside(0.8);
    assert_eq!(objects.len(), 1, "{objects:?}");
    assert!(objects[0].bounds.iou(&own) < 0.4, "{:?}", objects[0].bounds);
    assert_eq!(objects[0].state, ObjectState::Confirmed);

    let (own, objects) = box_beside(0.35);
    assert_eq!(objects.len(), 2, "{objects:?}");
    assert!(objects[0].bounds.iou(&own) > 0.9, "{:?}", objects[0].bounds);
    assert_eq!(objects[0].state, ObjectState::Coasting);
    assert_eq!(
        objects[1].state,
        ObjectState::Tentative,
        "it masks all the same"
    );
}

/// A low-score box at the person's position is assigned: networks give lower scores to people who turn round or are
/// half hidden.
#[test]
fn low_score_box_at_a_person_is_assigned() {
    let world = standing();
    let mut t = tracker(&world);
    for frame in 0..35 {
        feed(&mut t, &world, frame, frame < 30);
    }
    let items = vec![scored(truth(&world, 35), 0.35)];
    let objects = feed_items(&mut t, &world, 35, items);
    assert_eq!(objects.len(), 1, "{objects:?}");
    assert_eq!(objects[0].state, ObjectState::Confirmed);
}

/// A small box on a person's body, detected once while the person was missed, must not shrink the person.
#[test]
fn single_small_box_does_not_shrink_a_person() {
    let world = World::new(vec![Walker::new(|_| Vec3::new(0.0, 0.2, 1.2))], |_| {
        Se3::default()
    });
    let mut t = tracker(&world);
    for frame in 0..31 {
        feed(&mut t, &world, frame, frame < 30);
    }
    let own = truth(&world, 0);
    let [u, v] = own.centre();
    let small = BoundingBox {
        x0: u - 25.0,
        y0: v - 60.0,
        x1: u + 25.0,
        y1: v + 60.0,
    };
    feed_items(&mut t, &world, 31, vec![scored(small, 0.35)]);
    for frame in 32..40 {
        let objects = feed(&mut t, &world, frame, false);
        let iou = objects[0].bounds.iou(&own);
        assert!(iou > 0.8, "frame {frame}: {iou} {:?}", objects[0].bounds);
    }
}

/// A person who leaves the image undetected is predicted there, but marked as hidden.
#[test]
fn person_leaving_the_image_is_marked_hidden() {
    let world = World::new(
        vec![Walker::new(|t| Vec3::new(0.9 + 0.4 * t, 0.2, 2.5))],
        |_| Se3::default(),
    );
    let mut t = tracker(&world);
    let mut left = 0;
    for frame in 0..75 {
        let seen = world.truth(0, frame as f64 / RATE);
        let items = seen.map(|b| person(b.0)).into_iter().collect();
        let objects = feed_items(&mut t, &world, frame, items);
        if seen.is_some() {
            assert_eq!(left, 0);
            assert!(objects[0].state != ObjectState::Hidden, "frame {frame}");
            continue;
        }
        left += 1;
        if (9..=14).contains(&left) {
            let state = objects[0].state;
            assert!(objects[0].bounds.area() > 0.0, "frame {frame}");
            assert_eq!(state, ObjectState::Hidden, "{left} frames after");
        }
    }
    assert!(left > 14, "{left}");
}

/// A person at 2.4 m emerges from behind another at 1.2 m: half of the first box shows the other.
#[test]
fn person_emerging_from_occlusion_has_the_right_depth() {
    let world = World::new(
        vec![
            Walker::new(|_| Vec3::new(0.0, 0.2, 1.2)),
            Walker::new(|_| Vec3::new(0.45, 0.2, 2.4)),
        ],
        |_| Se3::default(),
    );
    let mut t = tracker(&world);
    let front = truth(&world, 0);
    for frame in 0..10 {
        feed(&mut t, &world, frame, true);
    }
    let behind = BoundingBox {
        x0: front.x1 - 50.0,
        x1: front.x1 + 40.0,
        ..world.truth(1, 0.0).unwrap().0
    };
    let now = 10.0 / RATE;
    t.update(
        &detections(10, vec![person(front), person(behind)]),
        &world.pose(now),
        &world.depth(now),
    );
    let objects = t.predict(now, &world.pose(now));
    assert_eq!(objects.len(), 2, "{objects:?}");
    let z = objects[1].position.unwrap().z;
    assert!((z - 2.3).abs() < 0.3, "{z} m away");
}

/// A second box of a person, which includes some wall, does not create a person at the wall.
#[test]
fn duplicate_box_of_a_person_has_the_persons_depth() {
    let world = World::new(vec![Walker::new(|_| Vec3::new(0.0, 0.2, 1.2))], |_| {
        Se3::default()
    });
    let mut t = tracker(&world);
    let front = truth(&world, 0);
    for frame in 0..10 {
        feed(&mut t, &world, frame, true);
    }
    let second = BoundingBox {
        x0: front.x0 - 30.0,
        x1: front.x0 + 70.0,
        ..front
    };
    let now = 10.0 / RATE;
    t.update(
        &detections(10, vec![person(front), person(second)]),
        &world.pose(now),
        &world.depth(now),
    );
    let objects = t.predict(now, &world.pose(now));
    let z: Vec<f64> = objects.iter().map(|o| o.position.unwrap().z).collect();
    assert!(z.iter().all(|z| (z - 1.1).abs() < 0.3), "{z:?} m away");
}
