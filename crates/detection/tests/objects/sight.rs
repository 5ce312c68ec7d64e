//! Occlusion, image borders, and velocity limits.

use super::feed::{detections, feed_items, standing, tracker, truth};
use super::world::{RATE, Walker, World, person};
use std::collections::BTreeSet;
use stillpoint_detection::{BoundingBox, ObjectState};
use stillpoint_geometry::{Se3, Vec3};

/// A person stands 3 m away; another passes 1.8 m away, from left to right.
fn passing() -> World {
    World::new(
        vec![
            Walker::new(|_| Vec3::new(0.0, 0.2, 3.0)),
            Walker::new(|t| Vec3::new(-1.2 + 0.8 * t, 0.2, 1.8)),
        ],
        |_| Se3::default(),
    )
}

/// The wider visible part of a box beside an occluder of the same height.
fn beside(own: &BoundingBox, other: &BoundingBox) -> BoundingBox {
    let [left, right] = [other.x0 - own.x0, own.x1 - other.x1];
    if left >= own.width() || right >= own.width() {
        *own
    } else if left > right {
        BoundingBox {
            x1: other.x0 + 2.0,
            ..*own
        }
    } else {
        BoundingBox {
            x0: other.x1 - 2.0,
            ..*own
        }
    }
}

/// The person behind is detected by the visible part and keeps the same id before, during and after: sides at the
/// occluder are not the person's own.
#[test]
fn partly_occluded_person_keeps_their_id() {
    let world = passing();
    let mut t = tracker(&world);
    let (mut narrow, mut hidden) = (0, 0);
    let mut known = BTreeSet::new();
    for frame in 0..90 {
        let now = frame as f64 / RATE;
        let front = world.truth(1, now).map(|b| b.0);
        let own = world.truth(0, 0.0).unwrap().0;
        let seen = front.map_or(own, |f| beside(&own, &f));
        let mut items: Vec<_> = front.into_iter().map(person).collect();
        let share = seen.width() / own.width();
        if share > 0.3 {
            items.push(person(seen));
        }
        let objects = feed_items(&mut t, &world, frame, items);
        let behind = objects.iter().find(|o| o.id.0 == 0).unwrap();
        narrow += usize::from((0.3..0.7).contains(&share));
        let sure = objects.iter().filter(|o| o.state != ObjectState::Tentative);
        known.extend(sure.map(|o| o.id));
        if frame >= 75 {
            let iou = behind.bounds.iou(&own);
            assert!(iou > 0.8, "frame {frame}: {iou}");
        }
        hidden += usize::from(behind.state == ObjectState::Hidden);
    }
    assert_eq!(known.len(), 2, "{known:?}");
    assert!(narrow >= 4, "{narrow} frames in which a part shows");
    assert!(hidden >= 3, "{hidden} frames in which he is hidden");
}

/// An undetected person behind another is hidden; an undetected one in a free position was only missed.
#[test]
fn only_an_occluded_person_is_hidden() {
    for (stands_before, expected) in [(true, ObjectState::Hidden), (false, ObjectState::Coasting)] {
        let x = if stands_before { 0.2 } else { -0.8 };
        let world = World::new(
            vec![
                Walker::new(|_| Vec3::new(0.2, 0.2, 3.2)),
                Walker::new(move |t| Vec3::new(if t > 0.95 { x } else { -3.0 }, 0.2, 1.6)),
            ],
            |_| Se3::default(),
        );
        let mut t = tracker(&world);
        for frame in 0..29 {
            feed_items(&mut t, &world, frame, vec![person(truth(&world, frame))]);
        }
        for frame in 29..35 {
            let front = world.truth(1, frame as f64 / RATE).unwrap().0;
            let objects = feed_items(&mut t, &world, frame, vec![person(front)]);
            assert_eq!(objects[0].state, expected, "frame {frame}");
        }
    }
}

/// The first boxes of a person entering at a corner show mostly the wall. The track must continue, at the right
/// position, when more is visible.
#[test]
fn entering_person_is_one_track_despite_wall_depth() {
    let world = World::new(vec![Walker::new(|_| Vec3::new(0.9, 0.2, 1.6))], |_| {
        Se3::default()
    });
    let empty = World {
        walkers: Vec::new(),
        ..standing()
    };
    let whole = truth(&world, 0);
    let corner = BoundingBox {
        x0: 600.0,
        y0: 380.0,
        x1: 639.0,
        y1: 479.0,
    };
    let mut t = tracker(&world);
    for frame in 0..3 {
        let found = detections(frame, vec![person(corner)]);
        t.update(&found, &world.pose(0.0), &empty.depth(0.0));
    }
    let first = t.predict(2.0 / RATE, &world.pose(0.0));
    assert!(first[0].position.unwrap().z > 3.0, "{first:?}");
    for frame in 3..10 {
        let objects = feed_items(&mut t, &world, frame, vec![person(whole)]);
        assert_eq!(objects.len(), 1, "frame {frame}");
        assert_eq!(objects[0].id, first[0].id);
        let z = objects[0].position.unwrap().z;
        assert!((z - 1.5).abs() < 0.2, "frame {frame}: {z}");
    }
}

/// A switch to another surface is not motion: reported positions move no faster than a run.
#[test]
fn reported_positions_do_not_jump() {
    let world = World::new(vec![Walker::new(|_| Vec3::new(0.2, 0.2, 1.6))], |_| {
        Se3::default()
    });
    let empty = World {
        walkers: Vec::new(),
        ..standing()
    };
    let whole = truth(&world, 0);
    let mut t = tracker(&world);
    let mut before: Option<Vec3> = None;
    let (mut at_wall, mut at_person) = (0, 0);
    for frame in 0..20 {
        let seen = if frame < 5 { &empty } else { &world };
        let now = frame as f64 / RATE;
        let found = detections(frame, vec![person(whole)]);
        t.update(&found, &world.pose(now), &seen.depth(now));
        let objects = t.predict(now, &world.pose(now));
        let sure = objects.iter().find(|o| o.state != ObjectState::Tentative);
        let at = sure.and_then(|o| o.position);
        if let (Some(was), Some(at)) = (before, at) {
            let speed = (at - was).norm() * RATE;
            assert!(speed < 3.0, "frame {frame}: {speed} m/s");
        }
        at_wall += usize::from(at.is_some_and(|p| p.z > 4.0));
        at_person += usize::from(at.is_some_and(|p| p.z < 1.8));
        before = at;
    }
    assert!(at_wall >= 2 && at_person >= 8, "{at_wall} {at_person}");
}

#[test]
fn velocity_is_limited_to_running_speed() {
    let world = World::new(
        vec![Walker::new(|t| Vec3::new(-1.4 + 4.5 * t, 0.2, 3.0))],
        |_| Se3::default(),
    );
    let mut t = tracker(&world);
    let mut fastest: f64 = 0.0;
    for frame in 0..18 {
        let items = vec![person(truth(&world, frame))];
        for o in feed_items(&mut t, &world, frame, items) {
            fastest = fastest.max(o.velocity.unwrap().norm());
        }
    }
    assert!((2.2..2.41).contains(&fastest), "{fastest}");
}
