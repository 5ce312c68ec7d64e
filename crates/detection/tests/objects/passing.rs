//! People who pass each other at arm's length, so near that the border cuts both, must keep their ids.

use super::feed::{feed_items, tracker};
use super::world::{RATE, Walker, World, normal, person, uniform};
use std::collections::BTreeSet;
use stillpoint_detection::{BoundingBox, Object, ObjectId, ObjectState};
use stillpoint_geometry::{Se3, Vec3};

/// One 0.9 m in front of the camera, one half a metre behind; they walk to and fro, mostly in opposite directions.
fn crowd(phase: f64) -> World {
    World::new(
        vec![
            Walker::new(move |t| Vec3::new(0.5 * libm::sin(1.2 * t + phase), 0.1, 0.95)),
            Walker::new(|t| Vec3::new(-0.65 * libm::sin(1.05 * t), 0.1, 1.5)),
        ],
        |_| Se3::default(),
    )
}

/// Boxes of the visible parts, with sides off by 4 px, from a detector that misses every third box.
fn found(world: &World, seed: u64, frame: u64) -> Vec<BoundingBox> {
    let t = frame as f64 / RATE;
    let boxes = (0..world.walkers.len()).filter_map(|n| {
        let missed = uniform(seed, [frame, n as u64, 7]) < 0.3;
        let b = world.shown(n, t).filter(|_| !missed)?.0;
        let off = |i: u64| 4.0 * normal(seed, [frame, 10 * n as u64 + i]);
        let moved = BoundingBox {
            x0: b.x0 + off(0),
            y0: b.y0 + off(1),
            x1: b.x1 + off(2),
            y1: b.y1 + off(3),
        };
        Some(moved.clipped(640, 480))
    });
    boxes.collect()
}

/// Share of both walkers' boxes, over ten seconds, with their most frequent id; and the number of ids.
fn identified(world: &World, seed: u64) -> (f64, usize) {
    let mut t = tracker(world);
    let mut borne: Vec<Vec<ObjectId>> = vec![Vec::new(); world.walkers.len()];
    let mut numbers = BTreeSet::new();
    for frame in 0..300 {
        let items = found(world, seed, frame).into_iter().map(person).collect();
        let objects = feed_items(&mut t, world, frame, items);
        let sure = |o: &&Object| {
            matches!(o.state, ObjectState::Confirmed | ObjectState::Coasting)
                && o.bounds.area() > 0.0
        };
        numbers.extend(objects.iter().filter(sure).map(|o| o.id));
        for (n, borne) in borne.iter_mut().enumerate() {
            let Some((shown, _)) = world.shown(n, frame as f64 / RATE) else {
                continue;
            };
            let best = objects.iter().filter(sure);
            let best = best.max_by(|a, b| a.bounds.iou(&shown).total_cmp(&b.bounds.iou(&shown)));
            borne.extend(best.filter(|o| o.bounds.iou(&shown) > 0.5).map(|o| o.id));
        }
    }
    let own = |ids: &Vec<ObjectId>| {
        let of = |id| ids.iter().filter(|i| **i == id).count();
        numbers.iter().map(|id| (of(*id), *id)).max().unwrap()
    };
    let right: usize = borne.iter().map(|ids| own(ids).0).sum();
    let all: usize = borne.iter().map(Vec::len).sum();
    println!("{right} of {all}, {} numbers", numbers.len());
    (right as f64 / all as f64, numbers.len())
}

/// Depth identifies the person in a box: the one in front is visible completely, the one behind in part. Without depth
/// they are exchanged.
#[test]
fn people_passing_at_arms_length_keep_their_ids() {
    let mean = |with_depth| {
        let share = |seed: u64| {
            let world = World {
                with_depth,
                ..crowd(0.3 * seed as f64)
            };
            identified(&world, seed).0
        };
        (1..4).map(share).sum::<f64>() / 3.0
    };
    let (with, without) = (mean(true), mean(false));
    assert!(with > 0.87 && without < with - 0.1, "{with} {without}");
}
