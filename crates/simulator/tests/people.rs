//! Scenes with people: masks, boxes, cover, detections.

use stillpoint_geometry::{BrownConrady, Camera};
use stillpoint_simulator::{
    DetectionNoise, FrameTruth, Simulator, SimulatorConfig, SimulatorError, scene_names,
};

const WITH_PEOPLE: [&str; 6] = [
    "walking_xyz",
    "walking_static",
    "walking_rpy",
    "walking_halfsphere",
    "sitting_xyz",
    "box_carried",
];

fn simulator(scene: &str, change: impl Fn(&mut SimulatorConfig)) -> Simulator {
    let mut config = SimulatorConfig {
        scene: scene.to_owned(),
        ..SimulatorConfig::default()
    };
    change(&mut config);
    Simulator::new(&config).expect("a known scene")
}

/// A quarter of the pixels, for tests that look at many frames.
fn small(config: &mut SimulatorConfig) {
    config.camera = Camera::pinhole(320, 240, [267.5, 267.5, 159.5, 119.5]);
}

fn check_boxes(truth: &FrameTruth) {
    let (mask, boxes) = (&truth.mask, &truth.boxes);
    let movers = mask.data().iter().copied().max().unwrap_or(0);
    let numbers: Vec<u32> = boxes.iter().map(|b| b.mover).collect();
    let mut expected = Vec::new();
    for mover in 1..=movers {
        let (mut n, mut bounds) = (0, [f64::MAX, f64::MAX, f64::MIN, f64::MIN]);
        for y in 0..mask.height() {
            for x in 0..mask.width() {
                if mask.at(x, y) == mover {
                    let (u, v) = (x as f64, y as f64);
                    n += 1;
                    let b = bounds;
                    bounds = [b[0].min(u), b[1].min(v), b[2].max(u), b[3].max(v)];
                }
            }
        }
        if n > 0 {
            expected.push(u32::from(mover));
            let found = boxes.iter().find(|b| b.mover == u32::from(mover));
            let found = found.expect("a box for every mover of the mask");
            let borders = [
                found.x0 + 0.5,
                found.y0 + 0.5,
                found.x1 - 0.5,
                found.y1 - 0.5,
            ];
            assert_eq!(borders, bounds);
            assert_eq!(found.visible_px, n);
        }
    }
    assert_eq!(numbers, expected, "one box per mover that is seen");
}

#[test]
fn boxes_are_those_of_the_mask() {
    for scene in WITH_PEOPLE {
        let sim = simulator(scene, small);
        (0..300)
            .step_by(23)
            .for_each(|i| check_boxes(&sim.truth(i)));
    }
}

#[test]
fn masks_follow_the_lens() {
    let camera = |config: &mut SimulatorConfig| {
        config.camera = Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3]);
        config.camera.distortion = BrownConrady {
            k1: 0.2624,
            k2: -0.9531,
            p1: -0.0054,
            p2: 0.0026,
            k3: 1.1633,
        };
        config.noise = false;
        config.depth_delay = 0.0;
    };
    let sim = simulator("walking_halfsphere", camera);
    let truth = sim.truth(100);
    assert_eq!((truth.mask.width(), truth.mask.height()), (640, 480));
    check_boxes(&truth);
    check_depth(&sim, 100);
}

/// Depth at the colour stamp jumps where the mask does: movers stand out from what is behind them.
fn check_depth(sim: &Simulator, index: usize) {
    let (truth, depth) = (sim.truth(index), sim.depth(index));
    let (mut edges, mut jumps) = (0, 0);
    for y in 0..truth.mask.height() {
        for x in 1..truth.mask.width() {
            if truth.mask.at(x - 1, y) != truth.mask.at(x, y) {
                let (a, b) = (depth.at(x - 1, y), depth.at(x, y));
                edges += 1;
                jumps += usize::from((a - b).abs() > 0.04);
            }
        }
    }
    assert!(edges > 300, "{edges} edges");
    assert!(jumps * 100 > edges * 90, "{jumps} of {edges}");
}

#[test]
fn masks_agree_with_depth_taken_at_the_same_moment() {
    for scene in WITH_PEOPLE {
        let ideal = |config: &mut SimulatorConfig| {
            config.noise = false;
            config.depth_delay = 0.0;
        };
        check_depth(&simulator(scene, ideal), 110);
    }
}

#[test]
fn truth_and_detections_do_not_depend_on_the_sensor() {
    let noisy = simulator("walking_xyz", |_| ());
    let ideal = simulator("walking_xyz", |c| {
        c.noise = false;
        c.depth_delay = 0.0;
    });
    for index in [30, 90, 270] {
        assert_eq!(noisy.truth(index), ideal.truth(index));
        let errors = DetectionNoise::default();
        assert_eq!(
            noisy.detections(index, &errors),
            ideal.detections(index, &errors)
        );
    }
    assert_ne!(noisy.truth(30).mask, noisy.truth(90).mask);
}

/// Mean and greatest share of the image that movers cover.
fn cover(scene: &str, seed: u64) -> [f64; 2] {
    let sim = simulator(scene, |c| {
        small(c);
        c.seed = seed;
    });
    let shares: Vec<f64> = (0..300).step_by(6).map(|i| sim.truth(i).cover()).collect();
    let greatest = shares.iter().copied().fold(0.0, f64::max);
    [shares.iter().sum::<f64>() / shares.len() as f64, greatest]
}

/// It takes long: six whole scenes, each with two seeds.
#[test]
fn people_cover_as_much_of_the_image_as_the_manual_says() {
    for seed in [0, 7] {
        for (scene, mean, greatest) in [
            ("walking_xyz", 0.19..0.3, 0.5..0.66),
            ("walking_static", 0.19..0.3, 0.45..0.66),
            ("walking_rpy", 0.19..0.3, 0.45..0.66),
            ("walking_halfsphere", 0.17..0.3, 0.4..0.66),
            ("sitting_xyz", 0.07..0.2, 0.1..0.3),
            ("box_carried", 0.07..0.2, 0.3..0.6),
        ] {
            let [found_mean, found_greatest] = cover(scene, seed);
            assert!(
                mean.contains(&found_mean),
                "{scene}: {found_mean} on average"
            );
            assert!(
                greatest.contains(&found_greatest),
                "{scene}: up to {found_greatest}"
            );
        }
    }
}

#[test]
fn scenes_without_people_have_an_empty_truth() {
    let people = |s: &str| WITH_PEOPLE.contains(&s) || s.contains("walking") || s.contains("crowd");
    for scene in scene_names().iter().filter(|s| !people(s)) {
        let truth = simulator(scene, small).truth(20);
        assert!(truth.boxes.is_empty() && truth.mask.data().iter().all(|m| *m == 0));
        assert_eq!(truth.cover(), 0.0);
    }
}

#[test]
fn the_box_moves_with_its_carrier_and_alone() {
    let sim = simulator("box_carried", small);
    let (mut alone, mut together, mut travel, mut last) = (0, 0, 0.0, None);
    for index in (0..300).step_by(3) {
        let truth = sim.truth(index);
        let seen = |class| truth.boxes.iter().find(|b| b.class == class);
        let Some(carried) = seen("box") else {
            continue;
        };
        let person = seen("person").map_or(0, |p| p.visible_px);
        alone += usize::from(person < 800);
        together += usize::from(person > 3000);
        let centre = 0.5 * (carried.x0 + carried.x1);
        travel += last.map_or(0.0, |l: f64| (centre - l).abs());
        last = Some(centre);
    }
    assert!(
        alone >= 15 && together >= 15,
        "{alone} alone, {together} together"
    );
    assert!(travel > 320.0, "{travel} px");
}

#[test]
fn detections_miss_jitter_and_know_no_box() {
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
    // Borders at the image's edge are clipped, which hides part of the jitter.
    let jitter = f64::sqrt(off / n);
    assert!((2.4..4.3).contains(&jitter), "{jitter} px");
}

/// Two people walk all the time.
#[test]
fn bursts_hide_a_person_for_their_length() {
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
        // What is found is found as it would be without bursts.
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
fn false_alarms_are_people_where_none_need_be() {
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
fn furniture_is_found_where_it_stands() {
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
        // People are found as they were.
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

#[test]
fn exact_detections_are_the_truth() {
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

#[test]
fn misspelt_scenes_with_people_are_understood() {
    let config = SimulatorConfig {
        scene: "walking_xzy".to_owned(),
        ..SimulatorConfig::default()
    };
    let error = Simulator::new(&config).err();
    assert!(matches!(
        error,
        Some(SimulatorError::UnknownScene {
            nearest: "walking_xyz",
            ..
        })
    ));
}

/// FNV-1a, 64 bits.
fn checksum(bytes: impl Iterator<Item = u8>) -> u64 {
    bytes.fold(0xcbf2_9ce4_8422_2325, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// Every machine must render these bytes: grey image, depth, mask. Whoever changes people or scenes on purpose writes
/// down the new sums.
#[test]
fn frames_with_people_are_the_same_bits_on_every_machine() {
    let sums = WITH_PEOPLE.map(|scene| {
        let sim = simulator(scene, |c| c.seed = 42);
        let frame = sim.frame(95);
        let depth = frame.depth.data().iter().flat_map(|z| z.to_le_bytes());
        [
            checksum(frame.gray.data().iter().copied()),
            checksum(depth),
            checksum(sim.truth(95).mask.data().iter().copied()),
        ]
    });
    let expected = [
        [
            0xf48c_e799_66b0_5554,
            0x58df_fee9_8c4d_72c9,
            0xe5c3_641d_f223_e42e,
        ],
        [
            0xf189_727c_25e3_61c0,
            0x49de_86aa_3074_c0b3,
            0x7ef5_59b8_3d69_dc34,
        ],
        [
            0xd9b0_6c5b_ad92_7d48,
            0xed28_1e02_d308_ca9d,
            0xb7bd_9122_4d51_ae9c,
        ],
        [
            0x1dca_c0f2_4ace_0f56,
            0x9f21_01ca_1655_e7d1,
            0xe835_28bf_528d_f961,
        ],
        [
            0x4a27_1e6e_4fce_50aa,
            0x050a_f440_36b0_a2a8,
            0xd88e_fa6c_e68d_f480,
        ],
        [
            0x184e_3e2d_a502_00c3,
            0xf729_9ae8_3b2c_9d6a,
            0x21bc_0b5b_91f9_7a57,
        ],
    ];
    assert_eq!(sums, expected, "found {sums:#018x?}");
}

#[test]
fn a_scene_takes_as_long_at_any_rate() {
    let at = |rate: f64| {
        Simulator::new(&SimulatorConfig {
            scene: "walking_xyz".to_owned(),
            rate,
            depth_delay: 0.001,
            ..SimulatorConfig::default()
        })
    };
    let (slow, fast) = (at(15.0).unwrap(), at(60.0).unwrap());
    assert_eq!(4 * slow.len(), fast.len());
    // The same moment is the same picture.
    assert_eq!(slow.stamp(30), fast.stamp(120));
    assert_eq!(slow.truth(30), fast.truth(120));
    for rate in [0.9, 1001.0, f64::NAN] {
        let said = at(rate).err().map(|e| e.to_string());
        assert!(said.is_some_and(|s| s.contains("1 to 1000 frames per second")));
    }
}
