//! Health of frames: consistency of covariances, and causes of tracking loss.

use super::PERIOD;
use std::sync::OnceLock;
use stillpoint_detection::{BoundingBox, ClassId, Detection, ScriptRow, ScriptedDetector};
use stillpoint_geometry::{Camera, Mat6, Se3, Vec6};
use stillpoint_imaging::{DepthImage, FrameId, GrayImage, RgbdFrame, Simd};
use stillpoint_simulator::{Simulator, SimulatorConfig};
use stillpoint_slam::{Config, Event, FrameReport, Health, LossCause, Outcome, System};

const FRAMES: usize = 55;

/// A room rendered once.
struct Room {
    camera: Camera,
    frames: Vec<RgbdFrame>,
    truth: Vec<Se3>,
}

fn room() -> &'static Room {
    static ROOM: OnceLock<Room> = OnceLock::new();
    ROOM.get_or_init(|| {
        let camera = Camera::pinhole(320, 240, [262.5, 262.5, 159.5, 119.5]);
        let simulator = Simulator::new(&SimulatorConfig {
            scene: "rpy".into(),
            frames: Some(FRAMES),
            camera,
            ..SimulatorConfig::default()
        })
        .unwrap();
        let truth = simulator.ground_truth();
        Room {
            camera,
            frames: (0..FRAMES).map(|i| simulator.frame(i)).collect(),
            truth: truth.iter().map(|(_, pose)| *pose).collect(),
        }
    })
}

fn system() -> System {
    System::new(Config::default(), room().camera, Simd::detect()).unwrap()
}

fn step(system: &mut System, frame: &RgbdFrame) -> (FrameReport, Health) {
    let events = system.step(frame.clone());
    let tracked = events.iter().find_map(Event::as_frame).unwrap();
    let (report, health) = (&tracked.report, &tracked.health);
    assert!(report.frame == health.frame && report.stamp == health.stamp);
    assert!((0.0..=1.0).contains(&health.quality.value()));
    let lost = matches!(report.outcome, Outcome::Lost { .. });
    assert_eq!(lost, health.loss.is_some());
    assert_eq!(lost, health.quality.value() == 0.0, "{health}");
    (report.clone(), health.clone())
}

fn nees(error: &Vec6, covariance: &Mat6) -> f64 {
    error.dot(&covariance.cholesky().unwrap().solve(error))
}

/// Errors against the truth, absolute and between frames, are within a factor of 2 of the standard deviations. While a
/// motion hypothesis is undecided, the covariance is larger.
#[test]
fn pose_errors_match_the_stated_covariance() {
    // Pooled over seeds: a single one gives the factor to a twentieth.
    let (mut world, mut steps) = (Vec::new(), Vec::new());
    for seed in 0..3 {
        compare_with_covariance(seed, &mut world, &mut steps);
    }
    let factor = |nees: &[f64]| (nees.iter().sum::<f64>() / nees.len() as f64 / 6.0).sqrt();
    let (world, steps) = (factor(&world), factor(&steps));
    println!("errors by what the covariance tells: {world:.2} in the world, {steps:.2} per step");
    assert!((0.5..2.0).contains(&world) && (0.5..2.0).contains(&steps));
}

/// Adds the squared Mahalanobis distances of the errors of a run's poses and of its steps.
fn compare_with_covariance(seed: u64, world: &mut Vec<f64>, steps: &mut Vec<f64>) {
    let config = Config {
        seed,
        ..Config::default()
    };
    let room = room();
    let mut system = System::new(config, room.camera, Simd::detect()).unwrap();
    let (mut posed, mut undecided) = (0, 0);
    let mut last: Option<(Se3, Health, Se3)> = None;
    for (frame, truth) in room.frames.iter().zip(&room.truth) {
        let (report, health) = step(&mut system, frame);
        let Some(covariance) = health.covariance else {
            // The pose that starts the map is exact.
            assert_eq!(report.outcome, Outcome::Initialised);
            continue;
        };
        let pose = report.world_from_camera.unwrap();
        let real = room.truth[0].inverse() * *truth;
        let off = nees(&(pose.inverse() * real).log(), &covariance);
        assert_eq!(health.undecided, report.undecided.is_some());
        if health.undecided {
            assert!(off < 6.0, "{off} {health}");
            undecided += 1;
            continue;
        }
        world.push(off);
        posed += 1;
        if let Some((before, health_before, real_before)) = &last {
            let (step, real_step) = (before.inverse() * pose, real_before.inverse() * real);
            let error = (step.inverse() * real_step).log();
            let covariance = health.covariance_since(health_before, &step).unwrap();
            steps.push(nees(&error, &covariance));
        }
        last = Some((pose, health.clone(), real));
        assert!(health.quality.value() > 0.5, "{health}");
        assert!((health.static_share + health.dynamic_share - 1.0).abs() < 1e-12);
    }
    assert_eq!(posed + undecided, FRAMES - 1);
    assert!((10..30).contains(&undecided), "{undecided}");
}

/// Frame `index` of a stream that shows the room's frame `of` with another image.
fn shown(index: usize, of: usize, gray: GrayImage, depth: DepthImage) -> RgbdFrame {
    RgbdFrame {
        id: FrameId(index as u32),
        stamp: index as f64 * PERIOD,
        depth_stamp: index as f64 * PERIOD,
        gray,
        depth,
        ..room().frames[of].clone()
    }
}

fn flat(level: u8) -> GrayImage {
    GrayImage::from_vec(320, 240, vec![level; 320 * 240]).unwrap()
}

fn no_depth() -> DepthImage {
    DepthImage::from_vec(320, 240, vec![0.0; 320 * 240]).unwrap()
}

/// A wall of people: textured patches of 80 px, at 1 m and more, with independent motions.
fn people(step: usize) -> (GrayImage, DepthImage) {
    let (mut gray, mut depth) = (Vec::new(), Vec::new());
    for i in 0..320 * 240_usize {
        let (x, y) = (i % 320, i / 320);
        let person = y / 80 * 4 + x / 80;
        let (dx, dy) = ([5, 0, 7, 2, 6][person % 5], [3, 6, 1, 4][person % 4]);
        let (u, v) = ((x + dx * step) / 5, (y + dy * step) / 5);
        let mut z = (u * 7919 + v * 104_729 + person * 15_485_863) as u64;
        z = (z ^ (z >> 7)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        gray.push(40 + ((z >> 40) % 160) as u8);
        depth.push(1.0 + 0.1 * person as f32);
    }
    (
        GrayImage::from_vec(320, 240, gray).unwrap(),
        DepthImage::from_vec(320, 240, depth).unwrap(),
    )
}

/// Tracks some frames of the room, then `others`; returns the last health.
fn after(mut system: System, others: impl Iterator<Item = (GrayImage, DepthImage)>) -> Health {
    let known = 5;
    for frame in &room().frames[..known] {
        let (report, _) = step(&mut system, frame);
        assert!(!matches!(report.outcome, Outcome::Lost { .. }));
    }
    let frames = others.zip(known..);
    let all = frames.map(|((gray, depth), i)| step(&mut system, &shown(i, known, gray, depth)).1);
    all.last().unwrap()
}

#[test]
fn dark_dazzled_and_blank_images_are_reported() {
    let last = |level: u8| {
        let health = after(system(), (0..7).map(|_| (flat(level), no_depth())));
        (health.loss.unwrap().cause, health.to_string())
    };
    let (cause, line) = last(3);
    assert!(
        matches!(cause, LossCause::Dark { keypoints: 0, .. }),
        "{cause}"
    );
    assert_eq!(
        line,
        "quality 0.00 | lost for 0.2 s: the image is black or covered (0 keypoints; 30 needed); uncover the lens or make light, and show it a place that it has seen"
    );
    let (cause, _) = last(255);
    assert!(matches!(cause, LossCause::Dazzled { .. }), "{cause}");
    let (cause, _) = last(120);
    assert!(matches!(cause, LossCause::Blank { .. }), "{cause}");
}

#[test]
fn missing_depth_is_reported() {
    let mut system = system();
    let gray = room().frames[0].gray.clone();
    for i in 0..3 {
        let (_, health) = step(&mut system, &shown(i, 0, gray.clone(), no_depth()));
        let loss = health.loss.unwrap();
        assert!(
            matches!(loss.cause, LossCause::NoDepth { pixels } if pixels == 0.0),
            "{loss}"
        );
        assert!(!loss.can_recognise);
        let words = "no depth: 0 % of the pixels have one; check the depth sensor and its range";
        assert!(loss.to_string().ends_with(words), "{loss}");
    }
    // With depth tracking recovers at once.
    let (_, health) = step(
        &mut system,
        &shown(3, 0, gray, room().frames[0].depth.clone()),
    );
    assert_eq!(health.loss, None);
    assert!(health.depth_share > 0.5);
}

#[test]
fn crowd_is_reported_as_cause_only_if_detected() {
    let wall = || (0..6).map(people);
    let script = (5..11).map(|i| ScriptRow {
        stamp: f64::from(i) * PERIOD,
        detection: Detection {
            class: ClassId::PERSON,
            score: 0.9,
            bounds: BoundingBox {
                x0: 0.0,
                y0: 0.0,
                x1: 319.0,
                y1: 239.0,
            },
        },
    });
    let detector = ScriptedDetector::new("the test's", script.collect()).unwrap();
    let health = after(system().with_detector(Box::new(detector)), wall());
    let loss = health.loss.as_ref().unwrap();
    assert!(
        matches!(loss.cause, LossCause::Crowd { moving } if moving > 0.9),
        "{loss}"
    );
    assert!(
        loss.to_string()
            .contains("people or things that move fill the image: 100 %")
    );
    assert_eq!(health.detections_age, Some(0.0));
    // Control: without detections the cause is unknown.
    let health = after(system(), wall());
    let cause = health.loss.unwrap().cause;
    assert!(matches!(cause, LossCause::Unknown { .. }), "{cause}");
    assert_eq!(health.detections_age, None);
}
