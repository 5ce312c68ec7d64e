//! Single rules of the tracker, each on a few frames.

use super::feed::{detections, feed, feed_items, standing, tracker, truth};
use super::world::{Faults, RATE, Walker, World, person};
use stillpoint_detection::{BoundingBox, ClassId, Motion, ObjectState, ObjectsConfig};
use stillpoint_geometry::{Se3, Vec3};
use stillpoint_imaging::CoarseDepth;

#[test]
fn one_detection_is_tentative_and_three_confirm() {
    let world = standing();
    let mut t = tracker(&world);
    let first = feed(&mut t, &world, 0, true);
    assert_eq!(first.len(), 1);
    assert_eq!(first[0].state, ObjectState::Tentative);
    assert!(first[0].bounds.iou(&truth(&world, 0)) > 0.95);
    assert_eq!(
        feed(&mut t, &world, 1, true)[0].state,
        ObjectState::Tentative
    );
    for frame in 2..=60 {
        let objects = feed(&mut t, &world, frame, true);
        assert_eq!(objects[0].state, ObjectState::Confirmed);
        assert_eq!(objects[0].id, first[0].id);
    }
    for frame in 61..=105 {
        let objects = feed(&mut t, &world, frame, false);
        assert_eq!(objects.len(), 1, "frame {frame}");
        assert_eq!(objects[0].state, ObjectState::Coasting);
        assert_eq!(objects[0].last_seen, 60.0 / RATE);
    }
    assert!(feed(&mut t, &world, 106, false).is_empty());
    // Re-detected at its position it keeps its id, once certain.
    feed(&mut t, &world, 107, true);
    assert_eq!(feed(&mut t, &world, 108, true)[0].id, first[0].id);
}

#[test]
fn short_tracks_coast_briefly() {
    let world = standing();
    let mut t = tracker(&world);
    for frame in 0..=4 {
        feed(&mut t, &world, frame, true);
    }
    // Tracked for 0.13 s, it is kept for that plus 0.3 s.
    assert_eq!(feed(&mut t, &world, 16, false).len(), 1);
    assert!(feed(&mut t, &world, 18, false).is_empty());
}

#[test]
fn single_detection_ends_after_three_misses() {
    let world = standing();
    let mut t = tracker(&world);
    feed(&mut t, &world, 0, true);
    assert_eq!(feed(&mut t, &world, 1, false).len(), 1);
    assert_eq!(feed(&mut t, &world, 2, false).len(), 1);
    assert!(feed(&mut t, &world, 3, false).is_empty());
}

#[test]
fn measures_position_velocity_and_size() {
    let world = World::new(
        vec![Walker::new(|t| {
            Vec3::new(-0.6 + 0.5 * t, 0.2, 3.0 - 0.2 * t)
        })],
        |_| Se3::default(),
    );
    let mut t = tracker(&world);
    let mut last = Vec::new();
    for frame in 0..60 {
        let items = Faults::default().detect(&world, frame).items;
        last = feed_items(&mut t, &world, frame, items);
    }
    let o = &last[0];
    let middle = (world.walkers[0].path)(59.0 / RATE);
    // The surface is up to 15 cm in front of the middle.
    let error = o.position.unwrap() - middle;
    assert!(error.x.abs() < 0.06 && error.y.abs() < 0.1, "{error:?}");
    assert!((-0.25..0.02).contains(&error.z), "{error:?}");
    let v = o.velocity.unwrap() - Vec3::new(0.5, 0.0, -0.2);
    assert!(v.norm() < 0.25, "{v:?}");
    let [w, h] = o.size.unwrap();
    assert!((w - 0.5).abs() < 0.08 && (h - 1.7).abs() < 0.2, "{w} {h}");
    let [near, far] = o.depth_range.unwrap();
    assert!(near < middle.z - 0.1 && far > middle.z && far - near < 0.9);
    // The stated uncertainty is realistic: errors within four standard deviations, and bounded.
    let c = o.covariance.unwrap();
    for i in 0..3 {
        let sigma = c[(3 + i, 3 + i)].sqrt();
        assert!(v[i].abs() < 4.0 * sigma && sigma < 0.5, "{i}: {sigma}");
    }
}

#[test]
fn box_sigma_matches_its_uncertainty() {
    let world = standing();
    let mut t = tracker(&world);
    for frame in 0..20 {
        let items = Faults::default().detect(&world, frame).items;
        feed_items(&mut t, &world, frame, items);
    }
    let sigma = |frames: f64| t.predict((19.0 + frames) / RATE, &world.pose(0.0))[0].bounds_sigma;
    let truth = truth(&world, 19);
    let now = sigma(0.0);
    let bounds = t.predict(19.0 / RATE, &world.pose(0.0))[0].bounds;
    assert!((bounds.x0 - truth.x0).abs() < 3.0 * now[0]);
    assert!((bounds.y1 - truth.y1).abs() < 3.0 * now[1]);
    assert!(now[0] < 0.1 * truth.width() && now[1] < 0.1 * truth.height());
    // A second later a person may have moved by half a metre: 110 px.
    let later = sigma(30.0);
    assert!((80.0..250.0).contains(&later[0]), "{later:?}");
    assert!(sigma(10.0)[0] > now[0] && sigma(10.0)[0] < later[0]);
}

#[test]
fn prediction_changes_nothing_and_agrees_with_the_update() {
    let world = standing();
    let mut t = tracker(&world);
    for frame in 0..5 {
        feed(&mut t, &world, frame, true);
    }
    let now = t.predict(4.0 / RATE, &world.pose(0.0));
    let ahead = t.predict(10.0 / RATE, &world.pose(0.0));
    assert_eq!(t.predict(4.0 / RATE, &world.pose(0.0)), now);
    let mut other = t.clone();
    let after = feed(&mut other, &world, 10, false);
    assert_eq!(ahead[0].bounds, after[0].bounds);
    assert_eq!(ahead[0].position, after[0].position);
    assert!(t.predict(4.0 / RATE + 1.6, &world.pose(0.0)).is_empty());
    assert!(t.predict(f64::NAN, &world.pose(0.0)).is_empty());
}

#[test]
fn out_of_order_updates_are_ignored_and_counted() {
    let world = standing();
    let mut t = tracker(&world);
    for frame in [3, 5] {
        feed(&mut t, &world, frame, true);
    }
    let before = t.predict(6.0 / RATE, &world.pose(0.0));
    feed_items(&mut t, &world, 4, Vec::new());
    feed(&mut t, &world, 5, true);
    let mut broken = detections(7, Vec::new());
    broken.stamp = f64::NAN;
    t.update(&broken, &world.pose(0.0), &world.depth(0.0));
    let nowhere = Se3::new(Se3::default().rotation, Vec3::new(f64::NAN, 0.0, 0.0));
    t.update(&detections(7, Vec::new()), &nowhere, &world.depth(0.0));
    assert_eq!(t.ignored(), 4);
    assert_eq!(t.stamp(), Some(5.0 / RATE));
    assert_eq!(t.predict(6.0 / RATE, &world.pose(0.0)), before);
}

#[test]
fn invalid_boxes_are_dropped() {
    let world = standing();
    let mut t = tracker(&world);
    let bad = |x0: f64, x1: f64| {
        person(BoundingBox {
            x0,
            y0: 10.0,
            x1,
            y1: 90.0,
        })
    };
    let items = vec![
        bad(f64::NAN, 20.0),
        bad(50.0, 20.0),
        bad(900.0, 950.0),
        bad(f64::NEG_INFINITY, f64::INFINITY),
    ];
    assert!(feed_items(&mut t, &world, 0, items).is_empty());
}

#[test]
fn box_is_tracked_without_depth_and_gains_a_position() {
    let mut world = World::new(
        vec![Walker::new(|t| Vec3::new(-0.6 + 0.6 * t, 0.2, 3.0))],
        |_| Se3::default(),
    );
    world.with_depth = false;
    let mut t = tracker(&world);
    for frame in 0..40 {
        let objects = feed(&mut t, &world, frame, frame % 4 != 3);
        assert_eq!(objects.len(), 1);
        let o = &objects[0];
        assert!(o.position.is_none() && o.depth_range.is_none() && o.size.is_none());
        let iou = o.bounds.iou(&truth(&world, frame));
        assert!(iou > 0.85, "frame {frame}: {iou}");
    }
    let id = t.predict(40.0 / RATE, &world.pose(0.0))[0].id;
    world.with_depth = true;
    let objects = feed(&mut t, &world, 40, true);
    assert_eq!(objects[0].id, id);
    assert!((objects[0].position.unwrap().z - 2.9).abs() < 0.15);
}

#[test]
fn wrong_first_depth_is_corrected() {
    let world = standing();
    let wall = World {
        walkers: Vec::new(),
        ..standing()
    };
    let mut t = tracker(&world);
    let bounds = truth(&world, 0);
    for frame in 0..2 {
        let d = detections(frame, vec![person(bounds)]);
        t.update(&d, &world.pose(0.0), &wall.depth(0.0));
    }
    let behind = t.predict(1.0 / RATE, &world.pose(0.0));
    assert!(behind[0].position.unwrap().z > 4.0);
    let mut last = Vec::new();
    for frame in 2..8 {
        last = feed(&mut t, &world, frame, true);
    }
    assert_eq!(last.len(), 1);
    assert_eq!(last[0].id, behind[0].id);
    assert!((last[0].position.unwrap().z - 2.4).abs() < 0.15, "{last:?}");
}

#[test]
fn person_leaving_the_image_keeps_their_size() {
    let world = World::new(
        vec![Walker::new(|t| Vec3::new(0.6 + 0.5 * t, 0.2, 2.5))],
        |_| Se3::default(),
    );
    let mut t = tracker(&world);
    for frame in 0..60 {
        let Some((bounds, _)) = world.truth(0, frame as f64 / RATE) else {
            assert!(frame > 40);
            return;
        };
        let objects = feed(&mut t, &world, frame, true);
        let [w, h] = objects[0].size.unwrap();
        assert!((w - 0.5).abs() < 0.1 && (h - 1.65).abs() < 0.2, "{w} {h}");
        let iou = objects[0].bounds.iou(&bounds);
        assert!(iou > 0.75, "frame {frame}: {iou}");
    }
    panic!("the walker never left");
}

#[test]
fn rigidity_parks_an_object_and_motion_frees() {
    let world = standing();
    let mut t = tracker(&world);
    let mut motions = Vec::new();
    for frame in 0..120 {
        let objects = feed(&mut t, &world, frame, true);
        motions.push(objects[0].motion);
        let agreeing = if frame < 100 { 19 } else { 3 };
        t.observe_rigidity(objects[0].id, frame as f64 / RATE, agreeing, 20);
        t.observe_rigidity(stillpoint_detection::ObjectId(999), 0.0, 0, 20);
    }
    assert_eq!(motions[30], Motion::Unknown);
    assert_eq!(motions[90], Motion::Parked);
    assert_eq!(motions[119], Motion::Moving);
}

/// Parked, out of sight for three seconds, then seen again at its position or 0.6 m beside it.
fn back_after_three_seconds(class: &str, moved: f64) -> Motion {
    let place = move |t: f64| Vec3::new(if t < 4.0 { 0.2 } else { 0.2 + moved }, 0.2, 2.5);
    let world = World::new(vec![Walker::new(place)], |_| Se3::default());
    let mut t = tracker(&world);
    let mut motions = Vec::new();
    let mut ids = Vec::new();
    for frame in 0..220 {
        let seen = !(90..180).contains(&frame);
        let mut item = person(truth(&world, frame));
        item.class = ClassId::from_name(class).unwrap();
        let items = if seen { vec![item] } else { Vec::new() };
        let objects = feed_items(&mut t, &world, frame, items);
        for o in objects.iter().filter(|_| seen) {
            t.observe_rigidity(o.id, frame as f64 / RATE, 20, 20);
            motions.push(o.motion);
            ids.push(o.id);
        }
    }
    assert_eq!(ids[0], ids[96], "{class} {moved}");
    // Six frames after its return: re-identified, but not yet judged anew.
    motions[96]
}

#[test]
fn thing_re_detected_in_place_is_still_parked() {
    assert_eq!(back_after_three_seconds("tv", 0.0), Motion::Parked);
    assert_eq!(back_after_three_seconds("tv", 0.6), Motion::Unknown);
    assert_eq!(back_after_three_seconds("person", 0.0), Motion::Unknown);
}

#[test]
fn empty_tracker_predicts_nothing() {
    let world = standing();
    let mut t = tracker(&world);
    assert!(t.predict(0.0, &world.pose(0.0)).is_empty());
    t.update(
        &detections(0, Vec::new()),
        &world.pose(0.0),
        &CoarseDepth::default(),
    );
    assert!(t.predict(0.0, &world.pose(0.0)).is_empty());
}

#[test]
fn out_of_range_configuration_is_reported() {
    assert!(ObjectsConfig::default().problems().is_empty());
    let bad = ObjectsConfig {
        coast_seconds: f64::NAN,
        tentative_seconds: -1.0,
        side_sigma: 2.0,
        ..ObjectsConfig::default()
    };
    let problems = bad.problems();
    assert_eq!(problems.len(), 3, "{problems:?}");
    assert_eq!(problems[2], "side_sigma: expected 0.005 to 0.5, found 2");
}

/// After a change of the clock or the frame of reference, any stamp is accepted.
#[test]
fn earlier_stamps_are_accepted_after_a_reset() {
    let world = standing();
    let mut t = tracker(&world);
    feed(&mut t, &world, 100, true);
    // Control: late detections are ignored.
    assert_eq!(feed(&mut t, &world, 50, true).len(), 0);
    assert_eq!(t.ignored(), 1);
    t.forget();
    assert_eq!(feed(&mut t, &world, 50, true).len(), 1);
    assert_eq!(t.ignored(), 1);
}
