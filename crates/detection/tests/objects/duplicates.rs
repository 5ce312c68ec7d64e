//! One box per object: suppressed and merged duplicates, and distinct objects.

use super::feed::{feed, feed_items, standing, tracker, truth};
use super::world::{Faults, RATE, Walker, World, person};
use stillpoint_detection::{BoundingBox, ClassId, Detection, ObjectId, ObjectState};
use stillpoint_geometry::{Se3, Vec3};

#[test]
fn classes_are_tracked_separately() {
    let world = standing();
    let mut t = tracker(&world);
    let person_box = person(truth(&world, 0));
    let chair = Detection {
        class: ClassId(56),
        ..person_box
    };
    feed_items(&mut t, &world, 0, vec![person_box]);
    let objects = feed_items(&mut t, &world, 1, vec![chair]);
    assert_eq!(objects.len(), 2);
    assert_eq!([objects[0].class.0, objects[1].class.0], [0, 56]);
}

#[test]
fn duplicate_box_on_a_person_is_suppressed_or_merged() {
    let world = standing();
    let whole = truth(&world, 0);
    let half = BoundingBox {
        y1: whole.y0 + 0.55 * whole.height(),
        ..whole
    };
    // Beside the whole, the half starts no track.
    let mut t = tracker(&world);
    feed(&mut t, &world, 0, true);
    let both = || vec![person(whole), person(half)];
    for frame in 1..20 {
        assert_eq!(feed_items(&mut t, &world, frame, both()).len(), 1);
    }
    // A track started by the half becomes the whole and keeps its id.
    let mut t = tracker(&world);
    for frame in 0..5 {
        feed_items(&mut t, &world, frame, vec![person(half)]);
    }
    let id = t.predict(5.0 / RATE, &world.pose(0.0))[0].id;
    let mut last = Vec::new();
    for frame in 5..15 {
        last = feed_items(&mut t, &world, frame, both());
    }
    assert_eq!(last.len(), 1);
    assert_eq!(last[0].id, id);
    assert!(last[0].bounds.iou(&whole) > 0.9, "{:?}", last[0].bounds);
}

#[test]
fn two_people_close_together_stay_separate() {
    let world = World::new(
        vec![
            Walker::new(|_| Vec3::new(-0.2, 0.2, 2.5)),
            Walker::new(|_| Vec3::new(0.15, 0.2, 3.1)),
        ],
        |_| Se3::default(),
    );
    let mut t = tracker(&world);
    for frame in 0..30 {
        let items = Faults::default().detect(&world, frame).items;
        assert_eq!(feed_items(&mut t, &world, frame, items).len(), 2);
    }
}

/// A cake detected on a person's legs, at the same depth, is part of the person. Beside the person it is a thing.
#[test]
fn thing_on_a_person_at_the_same_depth_is_suppressed() {
    let world = standing();
    let whole = truth(&world, 0);
    let cake = |by: f64| Detection {
        class: ClassId(55),
        score: 0.6,
        bounds: BoundingBox {
            x0: whole.x0 + by,
            y0: whole.y0 + 0.5 * whole.height(),
            x1: whole.x1 + by,
            y1: whole.y0 + 0.85 * whole.height(),
        },
    };
    for (by, expected) in [(0.0, 1), (2.0 * whole.width(), 2)] {
        let mut t = tracker(&world);
        feed(&mut t, &world, 0, true);
        for frame in 1..20 {
            let objects = feed_items(&mut t, &world, frame, vec![person(whole), cake(by)]);
            assert_eq!(objects.len(), expected, "frame {frame}: {objects:?}");
        }
    }
}

/// The box of a second person visible at the side of the first, at the same depth, of the same height and a quarter of
/// the width.
fn strip(whole: &BoundingBox) -> BoundingBox {
    BoundingBox {
        x0: whole.x1 - 0.25 * whole.width(),
        ..*whole
    }
}

/// A person visible at the side of another is not part of the other: neither suppressed nor merged. The upper half is:
/// see above.
#[test]
fn person_visible_beside_another_stays_separate() {
    let world = standing();
    let whole = truth(&world, 0);
    let mut t = tracker(&world);
    feed(&mut t, &world, 0, true);
    let both = || vec![person(whole), person(strip(&whole))];
    let mut seen = Vec::new();
    for frame in 1..30 {
        let objects = feed_items(&mut t, &world, frame, both());
        assert_eq!(objects.len(), 2, "frame {frame}");
        seen = objects;
    }
    assert!(seen.iter().all(|o| o.state == ObjectState::Confirmed));
    assert!(seen[0].bounds.iou(&whole) > 0.9 && seen[1].bounds.iou(&strip(&whole)) > 0.8);
}

/// Two people who were tracked separately, then detected as one, get their ids back when they part.
#[test]
fn two_people_merged_briefly_regain_their_ids() {
    let world = World::new(
        vec![
            Walker::new(|t| Vec3::new(-0.05 - (0.8 - 0.8 * t).abs(), 0.2, 2.5)),
            Walker::new(|t| Vec3::new(0.05 + (0.8 - 0.8 * t).abs(), 0.2, 2.6)),
        ],
        |_| Se3::default(),
    );
    let mut t = tracker(&world);
    let mut numbers: Vec<Vec<ObjectId>> = Vec::new();
    for frame in 0..60 {
        let mut items = Faults::default().detect(&world, frame).items;
        // While they are together the network detects one person, and the upper half as another.
        if (22..38).contains(&frame) {
            let both = items.iter().map(|d| d.bounds);
            let whole = both.reduce(|a, b| BoundingBox {
                x0: a.x0.min(b.x0),
                y0: a.y0.min(b.y0),
                x1: a.x1.max(b.x1),
                y1: a.y1.max(b.y1),
            });
            let whole = whole.unwrap();
            let half = BoundingBox {
                y1: whole.y0 + 0.5 * whole.height(),
                ..whole
            };
            items = vec![person(whole), person(half)];
        }
        let objects = feed_items(&mut t, &world, frame, items);
        let sure = objects.iter().filter(|o| o.state == ObjectState::Confirmed);
        numbers.push(sure.map(|o| o.id).collect());
    }
    assert_eq!(numbers[20].len(), 2);
    assert_eq!(numbers[37].len(), 1, "{numbers:?}");
    assert_eq!(numbers[59], numbers[20], "{numbers:?}");
}

/// A screen detected as tv and laptop is one object, with the class of the higher scores; two things side by side are
/// two.
#[test]
fn thing_detected_as_two_classes_is_one_object() {
    let world = World {
        walkers: Vec::new(),
        ..standing()
    };
    let screen = BoundingBox {
        x0: 200.0,
        y0: 150.0,
        x1: 320.0,
        y1: 240.0,
    };
    let shifted = |by: f64| BoundingBox {
        x0: screen.x0 + by,
        x1: screen.x1 + by,
        ..screen
    };
    let thing = |class: u8, score: f32, bounds| Detection {
        class: ClassId(class),
        score,
        bounds,
    };
    let (tv, laptop) = (62, 63);
    let mut t = tracker(&world);
    let mut seen = Vec::new();
    for frame in 0..20 {
        let items = match frame {
            0..5 => vec![thing(tv, 0.7, screen), thing(laptop, 0.5, shifted(8.0))],
            _ if frame % 3 == 0 => vec![thing(laptop, 0.6, shifted(6.0))],
            _ => vec![thing(tv, 0.6, screen)],
        };
        seen = feed_items(&mut t, &world, frame, items);
        assert_eq!(seen.len(), 1, "frame {frame}: {seen:?}");
    }
    assert_eq!((seen[0].class, seen[0].id), (ClassId(tv), ObjectId(0)));
    // At first each is detected in frames of its own: the younger track is merged into the older.
    let mut t = tracker(&world);
    for frame in 0..12 {
        let class = if frame % 2 == 0 { tv } else { laptop };
        let by = if frame < 4 { 0.0 } else { 5.0 };
        seen = feed_items(&mut t, &world, frame, vec![thing(class, 0.6, shifted(by))]);
    }
    assert_eq!(seen.len(), 1, "{seen:?}");
    // Control: side by side they are two.
    let mut t = tracker(&world);
    for frame in 0..12 {
        let items = vec![thing(tv, 0.7, screen), thing(laptop, 0.7, shifted(80.0))];
        seen = feed_items(&mut t, &world, frame, items);
    }
    assert_eq!(seen.len(), 2, "{seen:?}");
}
