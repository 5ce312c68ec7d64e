//! Scenes with a shutter: unchanged scenes, turn rates, and people before the camera.

use stillpoint_geometry::{Camera, Vec3, so3};
use stillpoint_simulator::{
    DepthModel, DetectionNoise, Shutter, Simulator, SimulatorConfig, SimulatorError,
};

fn config(scene: &str, seed: u64) -> SimulatorConfig {
    SimulatorConfig {
        scene: scene.to_owned(),
        seed,
        camera: Camera::pinhole(320, 240, [267.5, 267.5, 159.5, 119.5]),
        ..SimulatorConfig::default()
    }
}

fn simulator(scene: &str, seed: u64) -> Simulator {
    Simulator::new(&config(scene, seed)).expect("a known scene")
}

#[test]
fn global_shutter_without_exposure_equals_plain_rendering() {
    // The slowest of the fast paths is that of `rpy`.
    let plain = simulator("rpy", 4).frame_with_colour(70);
    let global = SimulatorConfig {
        shutter: Some(Shutter::default()),
        depth_model: Some(DepthModel::Independent),
        ..config("rpy_60", 4)
    };
    let global = Simulator::new(&global).unwrap().frame_with_colour(70);
    assert_eq!(plain.colour, global.colour);
    assert_eq!(plain.depth, global.depth);
    let rolling = simulator("rpy_60", 4).frame_with_colour(70);
    assert_ne!(plain.colour, rolling.colour);
    assert_ne!(plain.depth, rolling.depth);
}

#[test]
fn each_shutter_setting_changes_only_its_own_image() {
    let frame = |change: &dyn Fn(&mut Shutter)| {
        let mut shutter = Shutter::default();
        change(&mut shutter);
        let config = SimulatorConfig {
            shutter: Some(shutter),
            ..config("rpy_150", 1)
        };
        let frame = Simulator::new(&config).unwrap().frame(31);
        (frame.gray, frame.depth)
    };
    let plain = frame(&|_| ());
    for change in [
        (&|s: &mut Shutter| s.readout = 0.02) as &dyn Fn(&mut Shutter),
        &|s| s.exposure = 0.01,
    ] {
        let changed = frame(change);
        assert!(changed.0 != plain.0 && changed.1 == plain.1);
    }
    let changed = frame(&|s| s.depth_readout = 0.03);
    assert!(changed.0 == plain.0 && changed.1 != plain.1);
}

#[test]
fn shutter_longer_than_a_frame_is_an_error() {
    let of = |readout: f64, exposure: f64, rate: f64| {
        let shutter = Shutter {
            readout,
            exposure,
            ..Shutter::default()
        };
        let config = SimulatorConfig {
            shutter: Some(shutter),
            rate,
            ..config("xyz", 0)
        };
        Simulator::new(&config).err()
    };
    assert_eq!(of(0.03, 0.01, 30.0), None);
    for (readout, exposure) in [(0.04, 0.0), (-0.01, 0.0), (0.0, f64::NAN)] {
        let error = of(readout, exposure, 30.0);
        assert!(matches!(error, Some(SimulatorError::Shutter(_))));
    }
    // A scene's own shutter fits any rate.
    let fast = SimulatorConfig {
        rate: 120.0,
        depth_delay: 0.002,
        ..config("crowd_xyz", 0)
    };
    let fast = Simulator::new(&fast).unwrap();
    assert_eq!(fast.shutter().readout, 0.005);
}

#[test]
fn mask_follows_the_rolling_shutter_rows() {
    let with = |readout| {
        let shutter = Shutter {
            readout,
            ..Shutter::default()
        };
        let config = SimulatorConfig {
            shutter: Some(shutter),
            ..config("crowd_rpy_150", 2)
        };
        Simulator::new(&config).unwrap()
    };
    // The first row is exposed half a readout before the stamp, like the same row of an earlier global frame.
    let (rolling, global) = (with(0.02), with(0.0));
    let (a, b) = (rolling.truth(20), global.truth(20));
    let row = |mask: &stillpoint_imaging::GrayImage, y: usize| mask.row(y).to_vec();
    assert_eq!(row(&a.mask, 120), row(&b.mask, 120));
    assert_ne!(row(&a.mask, 2), row(&b.mask, 2));
}

#[test]
fn path_turn_rates_match_their_names() {
    for (scene, peak) in [("rpy_60", 60.0), ("rpy_100", 100.0), ("rpy_150", 150.0)] {
        let tops = (0..4).map(|seed| {
            let sim = simulator(scene, seed);
            let rate = |t: f64| {
                let h = 1e-3;
                let step = sim.world_from_camera(t).inverse() * sim.world_from_camera(t + h);
                so3::log(&step.rotation).norm().to_degrees() / h
            };
            (0..1000)
                .map(|i| rate(0.01 * f64::from(i)))
                .fold(0.0, f64::max)
        });
        for top in tops {
            assert!((0.85..1.15).contains(&(top / peak)), "{scene}: {top} deg/s");
        }
    }
}

#[test]
fn crowds_are_visible_from_the_first_frame() {
    for scene in [
        "crowd_xyz",
        "crowd_static",
        "crowd_halfsphere",
        "crowd_rpy_60",
        "crowd_rpy_150",
    ] {
        for seed in [0, 5, 9] {
            let sim = simulator(scene, seed);
            let mut covers = Vec::new();
            for index in [0, 5, 10, 15, 20, 25] {
                let truth = sim.truth(index);
                covers.push(truth.cover());
                let eye = sim.world_from_camera(sim.stamp(index)).translation;
                for motion in truth.boxes.iter().filter_map(|b| b.motion) {
                    let away = Vec3::from(motion.position) - eye;
                    let far = away.norm();
                    assert!((0.8..2.0).contains(&far), "{scene}: {far} m in {index}");
                    // They stop where they turn round.
                    let speed = Vec3::from(motion.velocity).norm();
                    assert!(index != 0 || speed > 0.1, "{scene}: {speed} m/s");
                }
            }
            let mean = covers.iter().sum::<f64>() / covers.len() as f64;
            println!("{scene} {seed}: {covers:.2?}");
            // One may occlude the other for a moment, and a fast turn may lose sight of both.
            assert!(
                (0.4..0.6).contains(&covers[0]),
                "{scene} {seed}: {covers:?}"
            );
            assert!((0.33..0.63).contains(&mean), "{scene} {seed}: {covers:?}");
            let seen = sim.detections(
                0,
                &DetectionNoise {
                    drop: 0.0,
                    ..DetectionNoise::default()
                },
            );
            assert_eq!(seen.len(), 2);
        }
    }
}
