//! The two equal rooms look the same to a place recogniser, and only the true pose distinguishes them.

use stillpoint_features::{Features, OrbConfig, OrbExtractor, match_brute_force};
use stillpoint_geometry::{Se3, Vec2, Vec3, so3};
use stillpoint_imaging::{RgbdFrame, Simd};
use stillpoint_simulator::{Simulator, SimulatorConfig};

/// Frames from a place of the first room to the same place of the second one.
const HALF: usize = 692;
/// From the first room to the second one, m.
const SHIFT: f64 = 6.06;
/// Frames of the tour of the first room.
const TOUR: [usize; 6] = [0, 60, 120, 180, 230, 280];

fn simulator(scene: &str, seed: u64) -> Simulator {
    let config = SimulatorConfig {
        scene: scene.to_owned(),
        seed,
        ..SimulatorConfig::default()
    };
    Simulator::new(&config).expect("a known scene")
}

fn pose(sim: &Simulator, index: usize) -> Se3 {
    sim.world_from_camera(sim.stamp(index))
}

/// Distance of two frames: m and degrees.
fn apart(sim: &Simulator, a: usize, b: usize) -> [f64; 2] {
    let relative = pose(sim, a).inverse() * pose(sim, b);
    let turn = so3::log(&relative.rotation).norm().to_degrees();
    [relative.translation.norm(), turn]
}

struct Compared {
    matches: usize,
    /// Number of matches with depth that are within 4 px of their position by `b_from_a`.
    agree: usize,
    with_depth: usize,
}

fn compare(sim: &Simulator, a: usize, b: usize, b_from_a: &Se3) -> Compared {
    let (frame_a, found_a) = features(sim, a);
    let (_, found_b) = features(sim, b);
    let matched = match_brute_force(&found_a.descriptors, &found_b.descriptors, 50, 0.8);
    let mut compared = Compared {
        matches: 0,
        agree: 0,
        with_depth: 0,
    };
    let camera = sim.camera();
    for (p, index) in found_a.keypoints.iter().zip(&matched) {
        let Some(index) = index else { continue };
        compared.matches += 1;
        let at = |v: f32| v.round() as usize;
        let z = f64::from(frame_a.depth.at(at(p.x), at(p.y)));
        if z > 0.0 {
            let q = &found_b.keypoints[*index as usize];
            let seen = camera.backproject(Vec2::new(f64::from(p.x), f64::from(p.y)), z);
            let there = camera.project(&b_from_a.transform(&seen));
            let error = (there - Vec2::new(f64::from(q.x), f64::from(q.y))).norm();
            compared.with_depth += 1;
            compared.agree += usize::from(error < 4.0);
        }
    }
    compared
}

fn features(sim: &Simulator, index: usize) -> (RgbdFrame, Features) {
    let frame = sim.frame(index);
    let mut found = Features::default();
    OrbExtractor::new(&OrbConfig::default(), Simd::detect()).extract(&frame.gray, &mut found);
    (frame, found)
}

#[test]
fn same_place_in_the_other_room_is_a_perfect_false_loop() {
    for seed in [0, 7] {
        let sim = simulator("equal_rooms", seed);
        let to_other = Se3::new(so3::exp(&Vec3::zeros()), Vec3::new(SHIFT, 0.0, 0.0));
        for index in TOUR {
            let (one, other) = (pose(&sim, index), pose(&sim, index + HALF));
            // The false belief: the second camera is in the first room.
            let believed = (to_other.inverse() * other).inverse() * one;
            let found = compare(&sim, index, index + HALF, &believed);
            let share = found.agree as f64 / found.with_depth as f64;
            println!(
                "seed {seed} {index}: {} matches, {share:.2} agree",
                found.matches
            );
            assert!(found.matches >= 150, "{index}: {} matches", found.matches);
            assert!(share > 0.8, "{index}: {share} of the matches agree");
            let truth = compare(&sim, index, index + HALF, &(other.inverse() * one));
            assert!(
                truth.agree * 20 < truth.with_depth,
                "{index}: {}",
                truth.agree
            );
            assert!(apart(&sim, index, index + HALF)[0] > 5.0);
        }
    }
}

#[test]
fn different_rooms_have_few_false_matches() {
    // Control: the same measure for opposite places of the two different rooms, as many frames apart.
    let sim = simulator("loop_two_rooms", 0);
    for index in [300, 400, 500] {
        let b_from_a = pose(&sim, index + HALF).inverse() * pose(&sim, index);
        let found = compare(&sim, index, index + HALF, &b_from_a);
        println!("{index}: {} matches", found.matches);
        assert!(found.matches < 60, "{index}: {} matches", found.matches);
    }
}

#[test]
fn only_the_return_walk_comes_back() {
    let (once, back) = (
        simulator("equal_rooms", 4),
        simulator("equal_rooms_return", 4),
    );
    // The shorter walk is the beginning of the longer one.
    assert!(once.len() < back.len());
    assert_eq!(once.frame(500).gray, back.frame(500).gray);
    assert_eq!(once.ground_truth()[..], back.ground_truth()[..once.len()]);
    let near = |sim: &Simulator, a: usize, b: usize| {
        let [metres, degrees] = apart(sim, a, b);
        metres < 1.0 && degrees < 30.0
    };
    for a in (0..once.len()).step_by(10) {
        let again = (a + 150..once.len()).find(|&b| near(&once, a, b));
        assert_eq!(again, None, "frame {a} is seen again");
    }
    // It ends in the second room, after the same tour of the desks.
    let last = pose(&once, once.len() - 1).translation;
    assert!(last.x > SHIFT - 2.0 && last.y > 0.5, "{last:?}");
    // The longer walk meets its own beginning, to some centimetres, after both rooms.
    for a in [0, 60, 120] {
        assert!(
            near(&back, a, a + 2 * HALF),
            "{:?}",
            apart(&back, a, a + 2 * HALF)
        );
        assert!(apart(&back, a, a + 2 * HALF)[0] < 0.1);
    }
    assert!(back.len() > 2 * HALF + 180);
}

#[test]
fn walk_keeps_clear_of_all_surfaces() {
    let config = SimulatorConfig {
        scene: "equal_rooms_return".to_owned(),
        noise: false,
        ..SimulatorConfig::default()
    };
    let sim = Simulator::new(&config).unwrap();
    for index in (0..sim.len()).step_by(15) {
        let depth = sim.depth(index);
        let nearest = depth.data().iter().fold(f32::INFINITY, |a, b| a.min(*b));
        assert!(nearest > 0.3, "frame {index}: {nearest} m");
        // Every ray ends at a surface: the rooms are closed.
        assert!(
            depth.data().iter().all(|z| *z > 0.0 && *z < 14.0),
            "frame {index}"
        );
    }
}

#[test]
fn walk_has_enough_features_and_depth_throughout() {
    let sim = simulator("equal_rooms_return", 1);
    for index in (0..sim.len()).step_by(40) {
        let (frame, found) = features(&sim, index);
        let holes = frame.depth.data().iter().filter(|z| **z == 0.0).count();
        let share = holes as f64 / frame.depth.data().len() as f64;
        println!("{index}: {} features, {share:.2} holes", found.len());
        assert!(found.len() > 800, "frame {index}: {}", found.len());
        assert!(share < 0.6, "frame {index}: {share}");
    }
}
