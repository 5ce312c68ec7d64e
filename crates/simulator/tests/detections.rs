//! The simulated detector.

use super::people::simulator;
use stillpoint_simulator::DetectionNoise;

#[test]
fn detections_have_misses_and_jitter_for_people_only() {
    let noise = DetectionNoise::default();
    let (mut found, mut visible, mut off, mut n) = (0.0, 0.0, 0.0, 0.0);
    for scene in ["walking_static", "sitting_xyz", "box_carried"] {
        let sim = simulator(scene, |_| ());
        for index in (0..300).step_by(4) {
            let truth = sim.truth(index);
            let people = truth
                .boxes
                .iter()
                .filter(|b| b.class == "person" && b.visible_px >= noise.min_visible_px);
            let rows = sim.detections(index, &noise);
            visible += people.clone().count() as f64;
            found += rows.len() as f64;
            for row in rows {
                assert_eq!((row.class, row.stamp), ("person", sim.stamp(index)));
                assert!((0.4..1.0).contains(&row.score));
                assert!(-0.5 <= row.x0 && row.x0 <= row.x1 && row.x1 <= 639.5);
                assert!(-0.5 <= row.y0 && row.y0 <= row.y1 && row.y1 <= 479.5);
                let errors = people.clone().map(|b| {
                    let d = [row.x0 - b.x0, row.y0 - b.y0, row.x1 - b.x1, row.y1 - b.y1];
                    d.map(|v| v * v).iter().sum::<f64>() / 4.0
                });
                let nearest = errors.fold(f64::MAX, f64::min);
                assert!(nearest < 4.0 * 4.0 * 12.0, "{nearest}");
                off += nearest;
                n += 1.0;
            }
        }
    }
    let share = found / visible;
    assert!(visible > 300.0, "{visible}");
    assert!((share - 0.7).abs() < 0.07, "{share} of {visible} found");
    // Borders are clipped at the image's edge, which hides part of the jitter.
    let jitter = f64::sqrt(off / n);
    assert!((2.4..4.3).contains(&jitter), "{jitter} px");
}

/// Two people walk all the time.
#[test]
fn bursts_suppress_a_person_for_their_length() {
    let sim = simulator("walking_static", |_| ());
    let noise = DetectionNoise {
        drop: 0.0,
        jitter_px: 0.0,
        burst: 0.02,
        seed: 1,
        ..DetectionNoise::default()
    };
    assert_eq!(noise.burst_frames, 25);
    let exact = DetectionNoise {
        burst: 0.0,
        ..noise
    };
    let mut hidden: Vec<Vec<usize>> = vec![Vec::new(); 2];
    let mut seen = 0;
    for index in 0..150 {
        let truth = sim.detections(index, &exact);
        let found = sim.detections(index, &noise);
        // Other detections equal those without bursts.
        assert!(found.iter().all(|row| truth.contains(row)), "frame {index}");
        seen += truth.len();
        for b in sim.truth(index).boxes {
            let whole = b.visible_px >= noise.min_visible_px;
            if whole && !found.iter().any(|r| r.x0 == b.x0 && r.y1 == b.y1) {
                hidden[b.mover as usize - 1].push(index);
            }
        }
    }
    let runs = hidden.iter().flat_map(|frames| {
        let runs = frames.chunk_by(|a, b| a + 1 == *b);
        runs.map(<[usize]>::len).collect::<Vec<_>>()
    });
    let runs: Vec<usize> = runs.collect();
    let total: usize = runs.iter().sum();
    assert!(total > 20 && total < seen, "{total} of {seen}");
    assert!(runs.iter().any(|n| *n >= 25), "{runs:?}");
}

#[test]
fn false_alarms_are_people_at_arbitrary_places() {
    let sim = simulator("xyz", |_| ());
    let noise = DetectionNoise {
        false_alarm: 0.2,
        ..DetectionNoise::default()
    };
    let rows: Vec<_> = (0..200).flat_map(|i| sim.detections(i, &noise)).collect();
    assert!((25..=55).contains(&rows.len()), "{}", rows.len());
    for row in &rows {
        assert_eq!(row.class, "person");
        assert!((0.3..0.5).contains(&row.score), "{}", row.score);
        assert!(-0.5 <= row.x0 && row.x0 + 20.0 < row.x1 && row.x1 <= 639.5);
        assert!(-0.5 <= row.y0 && row.y0 + 60.0 < row.y1 && row.y1 <= 479.5);
    }
    assert!(rows[0].x0 != rows[1].x0);
}

#[test]
fn furniture_is_detected_where_visible() {
    let sim = simulator("walking_xyz", |_| ());
    let noise = DetectionNoise {
        drop: 0.0,
        jitter_px: 0.0,
        min_visible_px: 500,
        things: true,
        ..DetectionNoise::default()
    };
    let mut classes = std::collections::BTreeSet::new();
    for index in [0, 60, 120, 180, 240] {
        let truth = sim.truth(index);
        assert!(truth.things.iter().all(|b| b.class != "person"));
        let rows = sim.detections(index, &noise);
        let large = |b: &&stillpoint_simulator::MoverBox| b.visible_px >= 500;
        let things: Vec<_> = truth.things.iter().filter(large).collect();
        let found: Vec<_> = rows.iter().filter(|r| r.class != "person").collect();
        assert_eq!(things.len(), found.len());
        for (a, b) in things.iter().zip(found) {
            assert_eq!((a.class, a.x0, a.y1), (b.class, b.x0, b.y1));
            classes.insert(b.class);
        }
        // Detections of people are unchanged.
        let people = DetectionNoise {
            things: false,
            ..noise
        };
        let people = sim.detections(index, &people);
        assert_eq!(rows[..people.len()], people);
    }
    for class in ["chair", "dining table", "tv", "keyboard"] {
        assert!(classes.contains(class), "{classes:?}");
    }
}

/// In a static scene, in one with people, and in one with carried furniture.
#[test]
fn moving_truth_is_the_truth_without_things() {
    for scene in ["xyz", "walking_xyz", "chair_carried"] {
        let sim = simulator(scene, |_| ());
        for (index, things) in [(0, true), (120, false), (240, true)] {
            let (truth, moving) = (sim.truth(index), sim.moving(index));
            assert!(moving.things.is_empty());
            assert_eq!((&moving.mask, &moving.boxes), (&truth.mask, &truth.boxes));
            let noise = DetectionNoise {
                things,
                false_alarm: 0.5,
                ..DetectionNoise::default()
            };
            let seen = if things { truth } else { moving };
            let rows = sim.detections(index, &noise);
            assert_eq!(sim.detections_of(index, &seen, &noise), rows);
        }
    }
}

#[test]
fn exact_detections_equal_the_truth() {
    let exact = DetectionNoise {
        drop: 0.0,
        jitter_px: 0.0,
        min_visible_px: 0,
        seed: 3,
        ..DetectionNoise::default()
    };
    let sim = simulator("walking_static", |_| ());
    for index in [60, 150, 250] {
        let boxes = sim.truth(index).boxes;
        let rows = sim.detections(index, &exact);
        assert_eq!(boxes.len(), rows.len());
        for (a, b) in boxes.iter().zip(rows) {
            assert_eq!([a.x0, a.y0, a.x1, a.y1], [b.x0, b.y0, b.x1, b.y1]);
        }
    }
    let none = DetectionNoise { drop: 1.0, ..exact };
    assert!(sim.detections(60, &none).is_empty());
    let other = DetectionNoise {
        drop: 0.3,
        seed: 4,
        ..exact
    };
    let counts = |noise: &DetectionNoise| -> Vec<usize> {
        (0..60).map(|i| sim.detections(i, noise).len()).collect()
    };
    assert_ne!(counts(&other), counts(&DetectionNoise { seed: 5, ..other }));
}

/// The corners of the true box contain the visible part of an object, and touch it if it is completely visible.
#[test]
fn true_boxes_contain_the_visible_parts() {
    use stillpoint_geometry::{Se3, Vec2, Vec3};
    let sim = simulator("equal_rooms", |c| c.noise = false);
    let things = sim.things();
    assert!(things.iter().zip(1..).all(|((n, _), k)| *n == k));
    let camera = *sim.camera();
    let mut compared = 0;
    for index in [0, 300, 600, 900] {
        let camera_from_world: Se3 = sim.world_from_camera(sim.stamp(index)).inverse();
        for seen in sim.truth(index).things {
            let (_, thing) = things[seen.mover as usize - 1];
            assert_eq!(thing.class, seen.class);
            let (c, s) = (libm::cos(thing.yaw), libm::sin(thing.yaw));
            let corner = |k: usize| {
                let [x, y, z] = [0, 1, 2].map(|i| {
                    let sign = if k >> i & 1 == 1 { 0.5 } else { -0.5 };
                    sign * thing.size[i]
                });
                let p = Vec3::from(thing.centre) + Vec3::new(c * x - s * y, s * x + c * y, z);
                camera_from_world.transform(&p)
            };
            let corners: Vec<Vec3> = (0..8).map(corner).collect();
            if corners.iter().any(|p| p.z < 0.3) {
                continue;
            }
            let pixels = corners.iter().map(|p| {
                let (x, y) = (camera.fx * p.x / p.z, camera.fy * p.y / p.z);
                Vec2::new(x + camera.cx, y + camera.cy)
            });
            let far = Vec2::repeat(f64::INFINITY);
            let (low, high) = pixels.fold((far, -far), |(a, b), p| (a.inf(&p), b.sup(&p)));
            let off = [
                low.x - seen.x0,
                low.y - seen.y0,
                seen.x1 - high.x,
                seen.y1 - high.y,
            ];
            assert!(off.iter().all(|d| *d < 1.5), "{seen:?} {low} {high}");
            compared += 1;
        }
    }
    assert!(compared > 20, "{compared}");
}

#[test]
fn things_have_false_alarms_and_missed_bursts() {
    let sim = simulator("xyz", |_| ());
    let with = |false_alarm: f64, burst: f64| DetectionNoise {
        drop: 0.0,
        false_alarm,
        burst,
        things: true,
        ..DetectionNoise::default()
    };
    let count = |noise: &DetectionNoise, class: &str| {
        let rows = (0..60).flat_map(|i| sim.detections(i, noise));
        rows.filter(|r| r.class == class).count()
    };
    let exact = with(0.0, 0.0);
    assert_eq!(count(&exact, "person"), 0);
    assert!(count(&with(0.3, 0.0), "person") > 5);
    let wrong = (0..60)
        .flat_map(|i| sim.detections(i, &with(0.3, 0.0)))
        .filter(|r| r.score < 0.5 && r.class != "person")
        .count();
    let weak = (0..60)
        .flat_map(|i| sim.detections(i, &exact))
        .filter(|r| r.score < 0.5)
        .count();
    assert!((5..40).contains(&(wrong - weak)), "{wrong} and {weak}");
    let (all, some) = (count(&exact, "tv"), count(&with(0.0, 0.02), "tv"));
    assert!(some < all && some > all / 4, "{some} of {all}");
}

/// It stands until it is lifted, is detected before and after, and leaves its place.
#[test]
fn carried_chair_leaves_its_place() {
    let sim = simulator("chair_carried", |_| ());
    let taken: Vec<_> = sim.things();
    let (number, chair) = *taken.last().unwrap();
    let lifted = chair.taken_at.unwrap();
    assert_eq!(chair.class, "chair");
    assert!((chair.centre[2] - 0.525).abs() < 1e-9 && (chair.size[2] - 1.05).abs() < 1e-9);
    let seen = |t: f64| {
        let truth = sim.truth((t * 30.0) as usize);
        truth.boxes.into_iter().find(|b| b.mover == number)
    };
    for t in [0.5, 2.0, lifted - 0.1] {
        let b = seen(t).unwrap();
        let motion = b.motion.unwrap();
        assert_eq!((b.class, motion.velocity), ("chair", [0.0; 3]));
        assert!(b.visible_px > 8000, "{} px at {t} s", b.visible_px);
    }
    let high = seen(lifted + 0.9).unwrap().motion.unwrap().position[2];
    assert!(high > chair.centre[2] + 0.4, "{high} m");
    assert!(seen(9.0).is_none_or(|b| b.visible_px < 500));
    let noise = DetectionNoise {
        things: true,
        drop: 0.0,
        jitter_px: 0.0,
        ..DetectionNoise::default()
    };
    let (b, rows) = (seen(1.0).unwrap(), sim.detections(30, &noise));
    assert!(rows.iter().any(|r| r.class == "chair" && r.x0 == b.x0));
    let silent = DetectionNoise {
        things: false,
        ..noise
    };
    assert!(
        sim.detections(30, &silent)
            .iter()
            .all(|r| r.class == "person")
    );
}

/// Active depth cameras do not measure black and distant surfaces.
#[test]
fn thing_pixels_are_counted_with_and_without_depth() {
    let sim = simulator("walking_xyz", |_| ());
    let exact = simulator("walking_xyz", |c| c.noise = false);
    let (measured, all) = (sim.depth_px(60), exact.depth_px(60));
    let sum = |counts: &[[usize; 2]], k: usize| counts.iter().map(|c| c[k]).sum::<usize>();
    assert!(sum(&all, 0) > 5000 && sum(&all, 0) == sum(&all, 1));
    // The same pixels are visible, and some of them have no depth.
    assert_eq!(sum(&measured, 0), sum(&all, 0));
    let with = sum(&measured, 1);
    assert!(with > sum(&all, 0) / 3 && with < sum(&all, 0), "{with}");
    let depth = sim.depth(60);
    assert!(with < depth.data().iter().filter(|z| **z > 0.0).count());
}
