//! The hardest beginnings: a patterned coat seen from behind, and a fast pitch towards people.

use super::people::simulator;
use stillpoint_geometry::so3;
use stillpoint_imaging::GrayImage;
use stillpoint_simulator::{DetectionNoise, Simulator};

/// The circle of the segment test (FAST: Rosten and Drummond 2006), px.
const CIRCLE: [(isize, isize); 16] = [
    (0, -3),
    (1, -3),
    (2, -2),
    (3, -1),
    (3, 0),
    (3, 1),
    (2, 2),
    (1, 3),
    (0, 3),
    (-1, 3),
    (-2, 2),
    (-3, 1),
    (-3, 0),
    (-3, -1),
    (-2, -2),
    (-1, -3),
];

/// Whether nine consecutive neighbours on the circle are all brighter, or all darker, by 20.
fn is_corner(image: &GrayImage, x: usize, y: usize) -> bool {
    let centre = i32::from(image.at(x, y));
    let differs = CIRCLE.map(|(dx, dy)| {
        let at = image.at(x.wrapping_add_signed(dx), y.wrapping_add_signed(dy));
        let d = i32::from(at) - centre;
        d.signum() * i32::from(d.abs() > 20)
    });
    [1, -1].into_iter().any(|sign| {
        let around = differs.iter().chain(&differs[..8]);
        let (mut run, mut longest) = (0, 0);
        for d in around {
            run = if *d == sign { run + 1 } else { 0 };
            longest = longest.max(run);
        }
        longest >= 9
    })
}

/// Corners per pixel on people and elsewhere, and the share of all that is on people.
fn corners(sim: &Simulator, index: usize) -> [f64; 3] {
    let (image, mask) = (sim.frame(index).gray, sim.truth(index).mask);
    let (mut found, mut pixels) = ([0.0; 2], [0.0; 2]);
    for y in 3..image.height() - 3 {
        for x in 3..image.width() - 3 {
            let of = usize::from(mask.at(x, y) == 0);
            pixels[of] += 1.0;
            found[of] += f64::from(u8::from(is_corner(&image, x, y)));
        }
    }
    let share = found[0] / (found[0] + found[1]);
    [found[0] / pixels[0], found[1] / pixels[1], share]
}

/// Control: shirts of a crowd have about as many corners per pixel as the room.
#[test]
fn coat_fills_a_quarter_of_the_view_with_most_corners() {
    for seed in [0, 5] {
        let sim = simulator("crowd_coat", |c| c.seed = seed);
        for index in [0, 36, 90] {
            let cover = sim.truth(index).cover();
            assert!((0.19..0.3).contains(&cover), "{seed} {index}: {cover}");
            let [on, off, share] = corners(&sim, index);
            assert!(on > 4.0 * off && share > 0.6, "{seed}: {on} {off} {share}");
        }
        let crowd = simulator("crowd_static", |c| c.seed = seed);
        let [on, off, _] = corners(&crowd, 0);
        assert!(on < 1.5 * off, "{seed}: {on} {off}");
    }
}

/// Controls: another scene, and a detector that finds people from behind as well as from the front.
#[test]
fn people_seen_from_behind_are_missed_for_long() {
    let found = |scene: &str, from_behind: f64| -> Vec<usize> {
        let sim = simulator(scene, |_| ());
        let noise = DetectionNoise {
            from_behind,
            ..DetectionNoise::default()
        };
        (0..150).map(|i| sim.detections(i, &noise).len()).collect()
    };
    let share = |found: &[usize]| found.iter().sum::<usize>() as f64 / found.len() as f64;
    let usual = DetectionNoise::default().from_behind;
    let coat = found("crowd_coat", usual);
    assert!((0.0..0.3).contains(&share(&coat)), "{}", share(&coat));
    let missed = coat.split(|n| *n > 0).map(<[usize]>::len).max();
    assert!(missed > Some(30), "{missed:?}");
    assert!((share(&found("crowd_coat", 0.0)) - 0.7).abs() < 0.12);
    assert_eq!(found("crowd_static", usual), found("crowd_static", 0.0));
}

/// Control: a crowd before a camera that does not nod.
#[test]
fn nodding_camera_pitches_fast_towards_people() {
    let pitch = |sim: &Simulator, t: f64| {
        let h = 1e-3;
        let step = sim.world_from_camera(t).inverse() * sim.world_from_camera(t + h);
        so3::log(&step.rotation).map(|v| v.to_degrees() / h)
    };
    for seed in [0, 5] {
        let sim = simulator("crowd_pitch", |c| c.seed = seed);
        let turn = pitch(&sim, 1.2);
        assert!((140.0..180.0).contains(&turn.x), "{seed}: {turn} deg/s");
        assert!(turn.y.abs() < 40.0 && turn.z.abs() < 40.0, "{seed}: {turn}");
        // Before and after the nod the camera turns slowly.
        for t in [0.3, 0.6, 1.8] {
            assert!(pitch(&sim, t).norm() < 40.0, "{seed} at {t}");
        }
        let covers = [36, 37, 38].map(|i| sim.truth(i).cover());
        assert!(covers.iter().sum::<f64>() > 1.5, "{seed}: {covers:?}");
        assert!(sim.truth(0).cover() > 0.4);
        let level = simulator("crowd_xyz", |c| c.seed = seed);
        assert!(pitch(&level, 1.2).norm() < 40.0);
    }
}
