//! The static filter without SLAM, compared with the simulator's exact masks.

#![allow(clippy::print_stdout)] // Prints the figures of docs/evidence/people.md.

use std::sync::{Arc, LazyLock};
use stillpoint_detection::{BoundingBox, ClassId, Detection, Detections};
use stillpoint_geometry::{Se3, Vec3};
use stillpoint_imaging::{FrameId, RgbdFrame, Simd};
use stillpoint_simulator::{FrameTruth, MoverBox, Simulator, SimulatorConfig};
use stillpoint_slam::{Config, DynamicMask, MaskError, Preset, Segments, System};

/// Processed frames.
const FRAMES: std::ops::Range<usize> = 0..60;
/// First scored frame: a person who stood still until then walks.
const SCORED: usize = 36;

/// A scene, rendered once for all tests.
struct Room {
    scene: &'static str,
    simulator: Simulator,
    frames: Vec<(Arc<RgbdFrame>, FrameTruth)>,
}

static WALKING: LazyLock<Room> = LazyLock::new(|| Room::new("walking_xyz"));
static EMPTY: LazyLock<Room> = LazyLock::new(|| Room::new("xyz"));

impl Room {
    fn new(scene: &'static str) -> Self {
        let config = SimulatorConfig {
            scene: scene.to_owned(),
            frames: Some(FRAMES.end),
            ..SimulatorConfig::default()
        };
        let simulator = Simulator::new(&config).unwrap();
        let render = |i: usize| (Arc::new(simulator.frame(i)), simulator.truth(i));
        let frames = (0..FRAMES.end).map(render).collect();
        Self {
            scene,
            simulator,
            frames,
        }
    }

    fn frame(&self, i: usize) -> &Arc<RgbdFrame> {
        &self.frames[i].0
    }

    fn truth(&self, i: usize) -> &FrameTruth {
        &self.frames[i].1
    }
}

fn filter(room: &Room) -> DynamicMask {
    let camera = *room.simulator.camera();
    DynamicMask::new(&Config::default(), camera, Simd::detect()).unwrap()
}

/// The people as seen by an exact detector.
fn boxes(room: &Room, frame: &RgbdFrame) -> Detections {
    let truth = room.truth(frame.id.0 as usize);
    let people = truth.boxes.iter().filter(|b| b.class == "person");
    let person = |b: &MoverBox| Detection {
        class: ClassId::from_name("person").unwrap(),
        score: 0.9,
        bounds: BoundingBox {
            x0: b.x0,
            y0: b.y0,
            x1: b.x1,
            y1: b.y1,
        },
    };
    Detections {
        frame: frame.id,
        stamp: frame.stamp,
        items: people.map(person).collect(),
    }
}

/// Shares of moving pixels inside the masks, and of other pixels outside.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    moving: [u64; 2],
    others: [u64; 2],
}

impl Score {
    fn add(&mut self, room: &Room, frame: &RgbdFrame, segments: &Segments) {
        let truth = &room.truth(frame.id.0 as usize).mask;
        let mask = segments.mask(frame);
        assert_eq!(
            (mask.width(), mask.height()),
            (truth.width(), truth.height())
        );
        for (found, truth) in mask.data().iter().zip(truth.data()) {
            assert!(*found == 0 || *found == 255);
            let (counts, right) = match truth {
                0 => (&mut self.others, *found == 0),
                _ => (&mut self.moving, *found == 255),
            };
            counts[0] += u64::from(right);
            counts[1] += 1;
        }
    }

    fn recall(&self) -> f64 {
        self.moving[0] as f64 / self.moving[1].max(1) as f64
    }

    fn kept(&self) -> f64 {
        self.others[0] as f64 / self.others[1].max(1) as f64
    }
}

/// Processes a scene, optionally with true poses and boxes.
fn score(room: &Room, poses: bool, detector: bool) -> Score {
    let scene = room.scene;
    let mut filter = filter(room);
    let mut score = Score::default();
    for i in FRAMES {
        let frame = room.frame(i);
        // The reference frame is arbitrary.
        let world = Se3::exp(&[1.0, -2.0, 0.5, 0.3, 0.2, -0.4].into());
        let pose = world * room.simulator.world_from_camera(frame.stamp);
        if detector {
            filter.detections(boxes(room, frame));
        }
        let found = filter.step(frame, poses.then_some(&pose)).unwrap();
        assert!(found.world_from_camera.is_some(), "{scene} {i}");
        assert_eq!(
            found.objects.is_empty(),
            !detector || found.objects.is_empty()
        );
        if i >= SCORED {
            assert_eq!(found.mask(), found.segments.mask(frame));
            score.add(room, frame, &found.segments);
        }
    }
    println!(
        "{scene}, poses {poses}, boxes {detector}: recall {:.3}, kept {:.4}",
        score.recall(),
        score.kept()
    );
    score
}

/// Likewise with the whole system, and no detector.
fn score_with_slam(room: &Room) -> Score {
    let (scene, camera) = (room.scene, *room.simulator.camera());
    let mut system = System::new(Config::default(), camera, Simd::detect()).unwrap();
    let mut score = Score::default();
    for i in FRAMES {
        let frame = room.frame(i);
        let events = system.step((**frame).clone());
        let found = events.iter().find_map(|e| e.as_frame()).unwrap();
        if i >= SCORED {
            score.add(room, frame, &found.report.segments);
        }
    }
    println!(
        "{scene}, SLAM: recall {:.3}, kept {:.4}",
        score.recall(),
        score.kept()
    );
    score
}

#[test]
fn walking_people_are_masked_as_well_as_with_slam() {
    let slam = score_with_slam(&WALKING);
    for poses in [false, true] {
        let alone = score(&WALKING, poses, false);
        assert!(
            alone.recall() > slam.recall() - 0.08,
            "{poses}: {alone:?} {slam:?}"
        );
        assert!(
            alone.kept() > slam.kept() - 0.02,
            "{poses}: {alone:?} {slam:?}"
        );
        let boxed = score(&WALKING, poses, true);
        assert!(
            boxed.recall() > 0.6 && boxed.kept() > 0.95,
            "{poses}: {boxed:?}"
        );
    }
}

#[test]
fn empty_room_is_hardly_masked() {
    let slam = score_with_slam(&EMPTY);
    for poses in [false, true] {
        let alone = score(&EMPTY, poses, false);
        assert!(
            alone.kept() > slam.kept() - 0.02 && alone.kept() > 0.95,
            "{poses}: {alone:?} {slam:?}"
        );
    }
}

#[test]
fn pixel_verdicts_agree_with_the_mask() {
    let room = &WALKING;
    let mut filter = filter(room);
    assert!(filter.verdicts(&[[10.0, 10.0]]).is_empty());
    let mut moving = 0;
    for i in FRAMES.take(40) {
        let frame = room.frame(i);
        filter.detections(boxes(room, frame));
        let found = filter.step(frame, None).unwrap();
        let mask = found.mask();
        let pixels: Vec<[f32; 2]> = (0..640 * 480)
            .step_by(37)
            .map(|i| [(i % 640) as f32, (i / 640) as f32])
            .filter(|[x, y]| frame.depth.at(*x as usize, *y as usize) > 0.0)
            .collect();
        for v in filter.verdicts(&pixels) {
            let [x, y] = v.pixel.map(|c| c as usize);
            assert_eq!(v.dynamic, mask.data()[y * 640 + x] == 255, "{i}: {x} {y}");
            moving += u32::from(v.dynamic);
        }
    }
    assert!(moving > 1000, "{moving}");
}

#[test]
fn camera_is_tracked_without_a_map() {
    let (room, simulator) = (&WALKING, &WALKING.simulator);
    let mut filter = filter(room);
    let first = simulator.stamp(FRAMES.start);
    let first = simulator.world_from_camera(first).inverse();
    let mut worst: f64 = 0.0;
    for i in FRAMES {
        let frame = room.frame(i);
        filter.detections(boxes(room, frame));
        let found = filter.step(frame, None).unwrap();
        let truth = first * simulator.world_from_camera(frame.stamp);
        let error: Vec3 = found.world_from_camera.unwrap().translation - truth.translation;
        worst = worst.max(error.norm());
    }
    // Measured: 0.011 m.
    assert!((0.006..0.016).contains(&worst), "{worst} m");
}

#[test]
fn unusable_frames_are_refused_or_tolerated() {
    let (room, camera) = (&WALKING, *WALKING.simulator.camera());
    let off = {
        let mut config = Config::default();
        config.static_filter.preset = Preset::Off;
        DynamicMask::new(&config, camera, Simd::detect()).err()
    };
    assert_eq!(off, Some(MaskError::Preset(Preset::Off)));
    assert!(off.is_some_and(|e| e.to_string().contains("expected \"default\"")));
    let mut filter = filter(room);
    filter.step(room.frame(0), None).unwrap();
    assert!(
        filter.step(room.frame(0), None).is_err(),
        "the same frame twice"
    );
    for i in 1..30u32 {
        let mut frame = (**room.frame(i as usize)).clone();
        frame.id = FrameId(i);
        if (3..20).contains(&i) {
            frame.gray.data_mut().fill(0);
        }
        let found = filter.step(&Arc::new(frame), None).unwrap();
        if (3..20).contains(&i) {
            assert!(found.world_from_camera.is_none());
            assert!(found.mask().data().iter().all(|v| *v == 0));
        }
        assert!(i < 25 || found.world_from_camera.is_some(), "{i}");
    }
}

/// Invalid cameras are refused with a message before any computation.
#[test]
fn invalid_camera_models_are_refused() {
    use stillpoint_geometry::{BrownConrady, Camera};
    use stillpoint_slam::Stages;
    let good = Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3]);
    let lens = |k1, k2, k3| Camera {
        distortion: BrownConrady {
            k1,
            k2,
            p1: -0.0054,
            p2: 0.0026,
            k3,
        },
        ..good
    };
    for (camera, part) in [
        (lens(0.2624, -0.9531, 0.0), "k3 is 0: was it left out?"),
        (lens(1e100, 0.0, 1.0), "k1 = 1e100"),
        (lens(f64::NAN, 0.0, 1.0), "finite distortion"),
        (Camera { fx: 0.0, ..good }, "focal lengths"),
        (Camera { width: 0, ..good }, "0 x 480"),
        (
            Camera {
                width: 4000,
                height: 3000,
                ..good
            },
            "scale the images down",
        ),
        (Camera { width: 15, ..good }, "at least 16 px"),
    ] {
        let (config, simd) = (Config::default(), Simd::detect());
        let said = Stages::new(config.clone(), camera, simd).err().unwrap();
        assert!(said.to_string().contains(part), "{said}");
        let said = DynamicMask::new(&config, camera, simd).err().unwrap();
        assert!(said.to_string().contains(part), "{said}");
    }
    assert!(
        Stages::new(
            Config::default(),
            lens(0.2624, -0.9531, 1.1633),
            Simd::detect()
        )
        .is_ok()
    );
}

/// The smallest accepted image causes no failure.
#[test]
fn smallest_image_is_processed() {
    use stillpoint_geometry::Camera;
    use stillpoint_imaging::{DepthImage, GrayImage};
    let camera = Camera::pinhole(16, 16, [16.0, 16.0, 7.5, 7.5]);
    let mut system = System::new(Config::default(), camera, Simd::detect()).unwrap();
    for id in 0..5 {
        let pixel = |i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8;
        let frame = RgbdFrame {
            id: FrameId(id),
            stamp: f64::from(id) / 30.0,
            depth_stamp: f64::from(id) / 30.0,
            gray: GrayImage::from_vec(16, 16, (0..256).map(pixel).collect()).unwrap(),
            colour: None,
            depth: DepthImage::from_vec(16, 16, vec![1.0; 256]).unwrap(),
        };
        assert!(!system.step(frame).is_empty());
    }
    system.finish();
}
