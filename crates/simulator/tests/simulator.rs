//! Determinism, ground truth and the sensor's statistics.

use stillpoint_geometry::so3;
use stillpoint_imaging::FrameSource;
use stillpoint_simulator::{Simulator, SimulatorConfig, SimulatorError, scene_names};

fn simulator(scene: &str, seed: u64) -> Simulator {
    let config = SimulatorConfig {
        scene: scene.to_owned(),
        seed,
        ..SimulatorConfig::default()
    };
    Simulator::new(&config).expect("a known scene")
}

#[test]
fn same_seed_gives_identical_frames_in_any_order() {
    let (a, b) = (simulator("xyz", 5), simulator("xyz", 5));
    let first = a.frame_with_colour(7);
    let _ = b.frame(90);
    let _ = b.frame(3);
    let again = b.frame_with_colour(7);
    assert_eq!(first.gray, again.gray);
    assert_eq!(first.depth, again.depth);
    assert_eq!(first.colour, again.colour);
    assert_eq!(first.stamp.to_bits(), again.stamp.to_bits());
    assert_eq!(a.ground_truth(), b.ground_truth());
}

#[test]
fn other_seed_changes_room_noise_and_path() {
    let (a, b) = (simulator("xyz", 5), simulator("xyz", 6));
    assert_ne!(a.frame(0).gray, b.frame(0).gray);
    assert_ne!(a.frame(0).depth, b.frame(0).depth);
    assert_ne!(a.ground_truth(), b.ground_truth());
}

#[test]
fn noise_differs_from_frame_to_frame() {
    let sim = simulator("static", 1);
    assert_ne!(sim.frame(0).gray, sim.frame(1).gray);
}

#[test]
fn source_yields_every_frame_in_order() {
    let config = SimulatorConfig {
        frames: Some(3),
        ..SimulatorConfig::default()
    };
    let mut source = Simulator::new(&config).unwrap().source();
    let mut last = f64::NEG_INFINITY;
    for left in (0..3).rev() {
        let frame = source.next_frame().unwrap().unwrap();
        assert!(frame.stamp > last && frame.depth_stamp >= frame.stamp);
        assert_eq!((frame.gray.width(), frame.gray.height()), (640, 480));
        assert_eq!((frame.depth.width(), frame.depth.height()), (640, 480));
        assert_eq!(source.remaining(), Some(left));
        last = frame.stamp;
    }
    assert!(source.next_frame().is_none());
}

#[test]
fn part_of_the_source_equals_the_whole() {
    let sim = || simulator("static", 2);
    let mut part = sim().source().between(40, Some(42));
    for (left, index) in [(1, 40), (0, 41)] {
        let (frame, whole) = (part.next_frame().unwrap().unwrap(), sim().frame(index));
        assert_eq!((frame.id, frame.stamp), (whole.id, whole.stamp));
        assert_eq!((frame.gray, frame.depth), (whole.gray, whole.depth));
        assert_eq!(part.remaining(), Some(left));
    }
    assert!(part.next_frame().is_none());
    assert_eq!(sim().source().between(290, None).remaining(), Some(10));
    let mut beyond = sim().source().between(900, Some(1000));
    assert_eq!(beyond.remaining(), Some(0));
    assert!(beyond.next_frame().is_none());
}

#[test]
fn unknown_scene_error_names_the_nearest() {
    let config = SimulatorConfig {
        scene: "halfshere".to_owned(),
        ..SimulatorConfig::default()
    };
    let error = Simulator::new(&config).err().unwrap();
    assert_eq!(
        error,
        SimulatorError::UnknownScene {
            found: "halfshere".to_owned(),
            nearest: "halfsphere"
        }
    );
    for name in scene_names() {
        assert!(error.to_string().contains(name));
    }
    let config = SimulatorConfig {
        depth_delay: -0.1,
        ..SimulatorConfig::default()
    };
    assert_eq!(
        Simulator::new(&config).err(),
        Some(SimulatorError::DepthDelay(-0.1))
    );
}

/// Scaling lengths keeps ideal images, and scales depths, poses and movers' velocities.
#[test]
fn scene_can_be_scaled() {
    let at = |scale| {
        let config = SimulatorConfig {
            scene: "walking_xyz".to_owned(),
            scale,
            noise: false,
            ..SimulatorConfig::default()
        };
        Simulator::new(&config)
    };
    let (one, three) = (at(1.0).unwrap(), at(3.0).unwrap());
    assert_eq!(one.colour(40).data(), three.colour(40).data());
    for (a, b) in one.depth(40).data().iter().zip(three.depth(40).data()) {
        assert!((3.0 * a - b).abs() <= 1e-5 * b, "{a} {b}");
    }
    let pose = |sim: &Simulator| sim.world_from_camera(0.7);
    assert_eq!(pose(&one).rotation, pose(&three).rotation);
    assert!((pose(&one).translation * 3.0 - pose(&three).translation).norm() < 1e-12);
    let speed = |sim: &Simulator| sim.truth(40).boxes[0].motion.unwrap().velocity[0];
    assert!((3.0 * speed(&one) - speed(&three)).abs() < 1e-12 && speed(&one).abs() > 0.01);
    for scale in [0.0, f64::NAN, 1e9] {
        let error = at(scale).err().unwrap();
        assert!(error.to_string().contains("scale"), "{error}");
    }
}

#[test]
fn out_of_range_camera_is_an_error() {
    let mut tiny = SimulatorConfig::default();
    tiny.camera.width = 3;
    let mut blind = SimulatorConfig::default();
    blind.camera.fx = f64::NAN;
    let mut wild = SimulatorConfig::default();
    wild.camera.distortion.k1 = f64::NAN;
    for config in [tiny, blind, wild] {
        let error = Simulator::new(&config).err();
        assert!(
            matches!(error, Some(SimulatorError::Camera(_))),
            "{error:?}"
        );
    }
}

/// Mean and maximum speed (m/s) and turn rate (deg/s), from poses a millisecond apart; checks that neither jumps.
fn speeds(sim: &Simulator) -> [[f64; 2]; 2] {
    let duration = sim.len() as f64 / 30.0;
    let (mut sum, mut greatest, mut n) = ([0.0; 2], [0.0_f64; 2], 0.0);
    let h = 1e-3;
    let mut last: Option<stillpoint_geometry::Vec6> = None;
    for i in 0..(duration / 0.01) as usize {
        let t = i as f64 * 0.01;
        let step = sim.world_from_camera(t).inverse() * sim.world_from_camera(t + h);
        let speed = step.translation.norm() / h;
        let rate = so3::log(&step.rotation).norm().to_degrees() / h;
        for (k, v) in [speed, rate].into_iter().enumerate() {
            sum[k] += v;
            greatest[k] = greatest[k].max(v);
        }
        n += 1.0;
        let twist = step.log() / h;
        if let Some(last) = last {
            // 0.01 s apart: accelerations under 8 m/s^2 and 8 rad/s^2, which a jump in speed would exceed.
            assert!(
                (twist - last).norm() < 0.08 * 1.5,
                "the motion jumps at {t} s"
            );
        }
        last = Some(twist);
    }
    [0, 1].map(|k| [sum[k] / n, greatest[k]])
}

#[test]
fn path_speeds_match_hand_held_recordings() {
    // Mean speeds of fr1_xyz, fr1_rpy and fr3_halfsphere: 0.24 m/s and 9 deg/s, 0.06 m/s and 50 deg/s, 0.2 m/s and 19 deg/s.
    let check = |scene: &str, speed: [f64; 2], rate: [f64; 2], peaks: [f64; 2]| {
        let [[mean_speed, top_speed], [mean_rate, top_rate]] = speeds(&simulator(scene, 3));
        assert!(
            (speed[0]..speed[1]).contains(&mean_speed),
            "{scene}: {mean_speed} m/s"
        );
        assert!(
            (rate[0]..rate[1]).contains(&mean_rate),
            "{scene}: {mean_rate} deg/s"
        );
        assert!(top_speed < peaks[0], "{scene}: up to {top_speed} m/s");
        assert!(top_rate < peaks[1], "{scene}: up to {top_rate} deg/s");
    };
    check("xyz", [0.15, 0.4], [0.5, 12.0], [0.7, 25.0]);
    // Twice as fast by its jolts alone, with the same rotation.
    check("xyz_jolting", [0.35, 0.6], [0.5, 12.0], [1.2, 25.0]);
    check("rpy", [0.005, 0.1], [15.0, 60.0], [0.15, 110.0]);
    check("halfsphere", [0.15, 0.7], [10.0, 40.0], [1.0, 70.0]);
    check("static", [0.001, 0.03], [0.1, 3.0], [0.06, 6.0]);
    check("walking_xyz", [0.15, 0.4], [0.5, 12.0], [0.7, 25.0]);
    check("walking_rpy", [0.005, 0.1], [15.0, 60.0], [0.15, 110.0]);
    check("walking_halfsphere", [0.3, 1.2], [10.0, 40.0], [1.6, 70.0]);
    check("walking_static", [0.001, 0.03], [0.1, 3.0], [0.06, 6.0]);
    check("loop_two_rooms", [0.7, 1.0], [5.0, 30.0], [1.3, 90.0]);
    let turning = [15.0, 45.0];
    check("equal_rooms_return", [0.65, 1.0], turning, [1.3, 110.0]);
    check("loop_in_haste", [1.2, 1.8], [50.0, 100.0], [2.2, 240.0]);
    check(
        "equal_rooms_in_haste",
        [1.1, 1.8],
        [50.0, 100.0],
        [2.2, 240.0],
    );
}

#[test]
fn loop_walk_is_long_passes_both_rooms_and_closes() {
    let sim = simulator("loop_two_rooms", 0);
    let poses = sim.ground_truth();
    let length: f64 = poses
        .windows(2)
        .map(|w| (w[1].1.translation - w[0].1.translation).norm())
        .sum();
    assert!(length >= 40.0, "{length} m");
    let start = &poses[0].1;
    assert!(poses.iter().any(|(_, p)| p.translation.x > 3.0));
    assert!(poses.iter().any(|(_, p)| p.translation.x < -3.0));
    // The start is revisited from the same side only after a long way.
    let back: Vec<usize> = (0..poses.len())
        .filter(|&i| {
            let relative = start.inverse() * poses[i].1;
            relative.translation.norm() < 0.3 && so3::log(&relative.rotation).norm() < 0.4
        })
        .collect();
    assert!(back.iter().any(|&i| i > poses.len() * 8 / 10));
    assert!(back.iter().all(|&i| i < 30 || i > poses.len() * 8 / 10));
}

#[test]
fn simulated_depth_has_kinect_noise_range_and_holes() {
    for scene in ["xyz", "halfsphere", "loop_two_rooms"] {
        let config = |noise| SimulatorConfig {
            scene: scene.to_owned(),
            noise,
            ..SimulatorConfig::default()
        };
        let (noisy, ideal) = (
            Simulator::new(&config(true)).unwrap(),
            Simulator::new(&config(false)).unwrap(),
        );
        let (mut holes, mut squares, mut n) = (0, 0.0, 0.0);
        for i in [0, 100, 200] {
            let (a, b) = (noisy.depth(i), ideal.depth(i));
            for (&found, &z) in a.data().iter().zip(b.data()) {
                if found == 0.0 {
                    holes += 1;
                    continue;
                }
                assert!((0.38..7.5).contains(&found), "{found}");
                let (z, found) = (f64::from(z), f64::from(found));
                let sigma = 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4);
                let step = z * z * 0.125 / (535.0 * 0.075);
                squares += (found - z) * (found - z) / (sigma * sigma + step * step / 12.0);
                n += 1.0;
            }
        }
        let share = f64::from(holes) / (3.0 * 640.0 * 480.0);
        assert!((0.16..0.5).contains(&share), "{scene}: {share}");
        let normalised = squares / n;
        assert!(
            (0.85..1.15).contains(&normalised),
            "{scene}: variance {normalised} of the model's"
        );
    }
}

fn checksum(bytes: impl Iterator<Item = u8>) -> u64 {
    bytes.fold(0xcbf2_9ce4_8422_2325, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// Every machine must render these bytes. After an intended change of scenes or sensor, update the checksums.
#[test]
fn frames_match_reference_checksums() {
    let sums = [("xyz", 17), ("loop_two_rooms", 700)].map(|(scene, index)| {
        let frame = simulator(scene, 42).frame(index);
        let depth = frame.depth.data().iter().flat_map(|z| z.to_le_bytes());
        [checksum(frame.gray.data().iter().copied()), checksum(depth)]
    });
    let expected = [
        [0x3320_2d0e_88fe_82f1, 0xe195_e15f_7274_12f3],
        [0x8bdb_64ac_e16c_8e14, 0x729a_86de_a53f_8661],
    ];
    assert_eq!(sums, expected, "found {sums:#018x?}");
}
