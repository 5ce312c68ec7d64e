//! Scenes with people: masks, boxes, cover.

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

pub(crate) fn simulator(scene: &str, change: impl Fn(&mut SimulatorConfig)) -> Simulator {
    let mut config = SimulatorConfig {
        scene: scene.to_owned(),
        ..SimulatorConfig::default()
    };
    change(&mut config);
    Simulator::new(&config).expect("a known scene")
}

/// A quarter of the pixels, for tests with many frames.
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
fn boxes_match_the_mask() {
    for scene in WITH_PEOPLE {
        let sim = simulator(scene, small);
        (0..300)
            .step_by(23)
            .for_each(|i| check_boxes(&sim.truth(i)));
    }
}

#[test]
fn masks_follow_the_lens_distortion() {
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

/// Depth at the colour stamp jumps at mask borders: movers are separated from the background.
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
fn masks_agree_with_simultaneous_depth() {
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

/// Mean and maximum share of the image covered by movers.
fn cover(scene: &str, seed: u64) -> [f64; 2] {
    let sim = simulator(scene, |c| {
        small(c);
        c.seed = seed;
    });
    let shares: Vec<f64> = (0..300).step_by(6).map(|i| sim.truth(i).cover()).collect();
    let greatest = shares.iter().copied().fold(0.0, f64::max);
    [shares.iter().sum::<f64>() / shares.len() as f64, greatest]
}

/// Takes long: six whole scenes, each with two seeds.
#[test]
fn image_cover_by_people_matches_the_manual() {
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
    let people = |s: &str| {
        let named = ["walking", "crowd", "carried"];
        WITH_PEOPLE.contains(&s) || named.iter().any(|n| s.contains(n))
    };
    for scene in scene_names().iter().filter(|s| !people(s)) {
        let truth = simulator(scene, small).truth(20);
        assert!(truth.boxes.is_empty() && truth.mask.data().iter().all(|m| *m == 0));
        assert_eq!(truth.cover(), 0.0);
    }
}

#[test]
fn carried_box_is_visible_with_and_without_its_carrier() {
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
fn misspelt_scenes_with_people_get_suggestions() {
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

fn checksum(bytes: impl Iterator<Item = u8>) -> u64 {
    bytes.fold(0xcbf2_9ce4_8422_2325, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// Every machine must render these bytes: grey image, depth, mask. After an intended change of people or scenes, update the checksums.
#[test]
fn frames_with_people_match_reference_checksums() {
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
fn scene_duration_is_independent_of_frame_rate() {
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
    // The same time gives the same image.
    assert_eq!(slow.stamp(30), fast.stamp(120));
    assert_eq!(slow.truth(30), fast.truth(120));
    for rate in [0.9, 1001.0, f64::NAN] {
        let said = at(rate).err().map(|e| e.to_string());
        assert!(said.is_some_and(|s| s.contains("1 to 1000 frames per second")));
    }
}
