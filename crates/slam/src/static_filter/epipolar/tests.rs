//! A camera and points at many depths, of which those in a box move.

use super::*;
use crate::static_filter::semantic::Mover;
use stillpoint_detection::{BoundingBox, ObjectId};
use stillpoint_geometry::nalgebra::UnitQuaternion;
use stillpoint_geometry::{Se3, Vec2, Vec3};
use stillpoint_imaging::{DepthImage, FrameId, GrayImage, RgbdFrame};
use stillpoint_map::MapView;

/// The left part of the image is outside the box.
const BOX: BoundingBox = BoundingBox {
    x0: 100.0,
    y0: -0.5,
    x1: 319.5,
    y1: 239.5,
};

fn camera() -> Camera {
    Camera::pinhole(320, 240, [260.0, 260.0, 159.5, 119.5])
}

struct Scene {
    features: Vec<[f32; 2]>,
    depths: Vec<f32>,
    pairs: Vec<Option<FlowPair>>,
    last_from_now: Se3,
}

impl Scene {
    /// Static points outside the box, and points inside that moved by `moved` (m, in the last frame).
    fn new(outside: usize, inside: usize, last_from_now: Se3, moved: Vec3) -> Self {
        let camera = camera();
        let mut scene = Self {
            features: Vec::new(),
            depths: Vec::new(),
            pairs: Vec::new(),
            last_from_now,
        };
        for i in 0..outside + inside {
            // Spread over each part, at depths from 1 to 3 m that lie on no plane.
            let (a, b, c) = (i * 37 % 101, i * 53 % 97, i * 71 % 89);
            let (from, width) = if i < outside {
                (5.0, 90.0)
            } else {
                (105.0, 205.0)
            };
            let pixel = Vec2::new(
                from + width * a as f64 / 101.0,
                10.0 + 220.0 * b as f64 / 97.0,
            );
            let z = 1.0 + 2.0 * c as f64 / 89.0;
            let mut before = last_from_now.transform(&camera.backproject(pixel, z));
            if i >= outside {
                before += moved;
            }
            let before = camera.project(&before);
            scene.features.push([pixel.x as f32, pixel.y as f32]);
            scene.depths.push(z as f32);
            scene.pairs.push(Some(FlowPair {
                before_raw: [before.x as f32, before.y as f32],
                before,
                before_exposed: before,
                now: pixel,
                flow_sigma: 0.1,
                shutter_sigma: 0.0,
                edge: Vec2::zeros(),
            }));
        }
        scene
    }

    /// Adds flow errors of up to a fifth of a pixel: exactly degenerate data yields no model at all.
    fn with_noise(mut self) -> Self {
        let at = |i: usize| 0.4 * ((i * 61 % 127) as f64 / 127.0 - 0.5);
        for (i, pair) in self.pairs.iter_mut().enumerate() {
            if let Some(pair) = pair {
                pair.before += Vec2::new(at(i), at(i + 40));
            }
        }
        self
    }

    fn distances(&self) -> Vec<Option<f64>> {
        let frame = RgbdFrame {
            id: FrameId(5),
            stamp: 1.0,
            depth_stamp: 1.0,
            gray: GrayImage::new(320, 240),
            colour: None,
            depth: DepthImage::from_vec(320, 240, vec![1.0; 320 * 240]).unwrap(),
        };
        let input = FrameInput {
            frame: &frame,
            view: &MapView::default(),
            world_from_camera: Se3::identity(),
            camera_from_depth: Se3::identity(),
            features: &self.features,
            depths: &self.depths,
            pairs: &self.pairs,
            last_from_now: self.last_from_now,
            few: false,
        };
        let mover = Mover {
            id: ObjectId(0),
            bounds: BOX,
            range: None,
            weight: 5.0,
            strength: 0.0,
        };
        distances(&input, &camera(), &[mover], 0)
    }
}

fn shift(x: f64, y: f64, z: f64) -> Se3 {
    Se3::new(UnitQuaternion::identity(), Vec3::new(x, y, z))
}

fn worst(distances: &[Option<f64>]) -> f64 {
    distances.iter().flatten().copied().fold(0.0, f64::max)
}

fn median(distances: &[Option<f64>]) -> f64 {
    let mut all: Vec<f64> = distances.iter().flatten().copied().collect();
    all.sort_by(f64::total_cmp);
    all[all.len() / 2]
}

#[test]
fn epipolar_lines_follow_the_camera_not_the_majority() {
    // Four in five move with the person in the box; the camera moves sideways, they move up.
    let scene = Scene::new(60, 240, shift(0.05, 0.0, 0.0), Vec3::new(0.0, -0.06, 0.0));
    let found = scene.distances();
    assert!(worst(&found[..60]) < 0.01, "{}", worst(&found[..60]));
    assert!(median(&found[60..]) > 2.0, "{}", median(&found[60..]));
    // Control: outside of a box, they would determine the lines.
    let outside = Scene {
        features: vec![[50.0, 100.0]; 300],
        ..scene
    };
    let found = outside.distances();
    assert!(median(&found[..60]) > 2.0, "{}", median(&found[..60]));
}

#[test]
fn few_features_outside_boxes_make_all_features_count() {
    // 30 outside do not suffice. All agree on the camera's motion.
    let scene = Scene::new(30, 100, shift(0.05, 0.01, 0.02), Vec3::zeros());
    assert!(worst(&scene.distances()) < 0.01);
}

#[test]
fn motion_along_epipolar_lines_is_not_detected() {
    // A limit of the published method, and its reason to add depth.
    let scene = Scene::new(60, 240, shift(0.05, 0.0, 0.0), Vec3::new(0.06, 0.0, 0.0));
    assert!(worst(&scene.distances()) < 0.01);
}

#[test]
fn without_epipolar_lines_the_rigid_distance_is_used() {
    let turn = UnitQuaternion::from_euler_angles(0.01, -0.02, 0.015);
    let rotation = Se3::new(turn, Vec3::zeros());
    for (name, motion) in [("rotation", rotation), ("rest", Se3::identity())] {
        let mut scene = Scene::new(80, 60, motion, Vec3::new(0.03, 0.0, 0.0)).with_noise();
        scene.depths[7] = 0.0;
        scene.pairs[9] = None;
        let found = scene.distances();
        for (i, found) in found.iter().enumerate() {
            let rigid = scene.pairs[i].as_ref().and_then(|pair| {
                rigid::distance_px(&camera(), pair, scene.depths[i], &scene.last_from_now)
            });
            assert_eq!(*found, rigid, "{name}, {i}");
        }
        assert_eq!((found[7], found[9]), (None, None));
        // Epipolar lines are undefined here; the rigid distance still finds the motion.
        assert!(worst(&found[..80]) < 0.3, "{name}");
        assert!(median(&found[80..]) > 2.0, "{name}");
    }
}

#[test]
fn no_flow_gives_no_distances() {
    let mut scene = Scene::new(60, 10, shift(0.05, 0.0, 0.0), Vec3::zeros());
    scene.pairs.clear();
    assert_eq!(scene.distances(), vec![None; 70]);
}
