//! Synthetic frames and maps for unit tests: cameras observing points, and images of a wall.

use std::collections::BTreeMap;
use std::sync::Arc;
use stillpoint_features::{Descriptor, Edge, FeatureGrid, Keypoint};
use stillpoint_geometry::{Camera, Se3, Vec3};
use stillpoint_imaging::{DepthImage, FrameId, GrayImage, RgbdFrame};
use stillpoint_map::{KeyframeData, KeyframeId, LandmarkId, Map, NewLandmark};

/// Scale factor between pyramid levels: that of all maps (decision 60).
const SCALE: f32 = 1.45;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Feature {
    pub(crate) pixel: [f32; 2],
    /// m; 0 if none.
    pub(crate) depth: f32,
    pub(crate) level: u8,
    /// Seed of the descriptor: equal ones have equal descriptors, others differ by about 128 bits.
    pub(crate) look: u64,
    /// Number of flipped descriptor bits.
    pub(crate) noise: u32,
    pub(crate) mappable: bool,
}

/// A camera without distortion, 640 x 480.
pub(crate) fn camera() -> Camera {
    Camera::pinhole(640, 480, [500.0, 500.0, 319.5, 239.5])
}

pub(crate) fn blank_keyframe(stamp: f64) -> KeyframeData {
    let camera = camera();
    KeyframeData {
        stamp,
        grid: FeatureGrid::build(&[], &[], KeyframeData::grid_bounds(&camera)),
        camera,
        keypoints: Vec::new(),
        positions: Vec::new(),
        sigma_px: Vec::new(),
        depths: Vec::new(),
        depth_sigmas: Vec::new(),
        descriptors: Arc::default(),
        mappable: Vec::new(),
    }
}

pub(crate) fn hash(seed: u64) -> u64 {
    let h = seed.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let h = (h ^ (h >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    (h ^ (h >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB) ^ (h >> 31)
}

/// A camera at this position (m), looking along z.
pub(crate) fn at(x: f64, y: f64, z: f64) -> Se3 {
    Se3 {
        translation: Vec3::new(x, y, z),
        ..Se3::identity()
    }
}

/// Point of a number: all lie in a block 2 m wide and 1.2 m high, 2 to 3 m in front of the origin.
pub(crate) fn point(number: usize) -> Vec3 {
    let share = |axis: u64| (hash(3 * number as u64 + axis) >> 11) as f64 / (1_u64 << 53) as f64;
    Vec3::new(2.0 * share(0) - 1.0, 1.2 * share(1) - 0.6, 2.0 + share(2))
}

/// Observation of a point with depth, on the finest level.
pub(crate) fn see(point: &Vec3, look: usize, world_from_camera: &Se3) -> Feature {
    let p = world_from_camera.inverse().transform(point);
    let pixel = camera().project(&p);
    Feature {
        pixel: [pixel.x as f32, pixel.y as f32],
        depth: p.z as f32,
        level: 0,
        look: look as u64,
        noise: 0,
        mappable: true,
    }
}

/// Observations of numbered points, with their own appearances.
pub(crate) fn see_points(
    numbers: impl IntoIterator<Item = usize>,
    world_from_camera: &Se3,
) -> Vec<Feature> {
    let see = |n| see(&point(n), n, world_from_camera);
    numbers.into_iter().map(see).collect()
}

pub(crate) fn data(features: &[Feature]) -> Arc<KeyframeData> {
    let keypoint = |f: &Feature| Keypoint {
        x: f.pixel[0],
        y: f.pixel[1],
        level: f.level,
        angle: 0.0,
        response: 1.0,
        edge: Edge::default(),
    };
    let descriptor = |f: &Feature| {
        let mut words = [0, 1, 2, 3].map(|w| hash(4 * f.look + w));
        for bit in 0..f.noise {
            words[(bit % 4) as usize] ^= 1 << (bit / 4);
        }
        Descriptor(words)
    };
    let positions: Vec<[f32; 2]> = features.iter().map(|f| f.pixel).collect();
    let levels: Vec<u8> = features.iter().map(|f| f.level).collect();
    let camera = camera();
    let grid = FeatureGrid::build(&positions, &levels, KeyframeData::grid_bounds(&camera));
    Arc::new(KeyframeData {
        stamp: 0.0,
        camera,
        keypoints: features.iter().map(keypoint).collect(),
        positions,
        sigma_px: levels
            .iter()
            .map(|l| libm::powf(SCALE, f32::from(*l)))
            .collect(),
        depths: features.iter().map(|f| f.depth).collect(),
        depth_sigmas: features.iter().map(|f| 0.01 * f.depth.min(1.0)).collect(),
        descriptors: Arc::new(features.iter().map(descriptor).collect()),
        mappable: features.iter().map(|f| f.mappable).collect(),
        grid,
    })
}

pub(crate) struct World {
    pub(crate) map: Map,
    /// The landmark of each observed point, by submap.
    pub(crate) landmarks: BTreeMap<(u32, usize), LandmarkId>,
}

impl World {
    pub(crate) fn new() -> Self {
        Self {
            map: Map::new(8, SCALE),
            landmarks: BTreeMap::new(),
        }
    }

    /// Adds a keyframe that observes some points; without a parent it starts a submap.
    pub(crate) fn add(
        &mut self,
        id: u32,
        parent: Option<u32>,
        world_from_camera: Se3,
        numbers: std::ops::Range<usize>,
    ) {
        let key = KeyframeId(id);
        let data = data(&see_points(numbers.clone(), &world_from_camera));
        let parent = parent.map(KeyframeId);
        assert!(
            self.map
                .insert_keyframe(key, data, world_from_camera, parent)
        );
        let submap = self.map.view().submap_of(key).map_or(id, |s| s.0);
        for (feature, number) in (0..).zip(numbers) {
            if let Some(known) = self.landmarks.get(&(submap, number)) {
                assert!(self.map.add_observation(*known, key, feature));
                continue;
            }
            let new = NewLandmark {
                position: point(number),
                observation: (key, feature),
            };
            let made = self.map.insert_landmark(&new).expect("a free feature");
            self.landmarks.insert((submap, number), made);
        }
        self.map.refresh_covisibility(key, 1);
    }
}

/// Size of images of the wall, px: chosen, half of 640x480 along each side, so that tests are quick.
pub(crate) const WALL: [usize; 2] = [320, 240];
/// Distance of the wall, m: chosen, well within the range of a depth camera.
pub(crate) const WALL_M: f32 = 1.5;

pub(crate) fn wall_camera() -> Camera {
    Camera::pinhole(320, 240, [260.0, 260.0, 159.5, 119.5])
}

/// Sideways displacement, m, of a camera that sees the wall shifted by `shift` px.
pub(crate) fn aside(shift: f64) -> f64 {
    shift * f64::from(WALL_M) / wall_camera().fx
}

/// A frame of a wall with these grey levels, at 30 Hz.
pub(crate) fn wall(id: u32, grey: impl Fn(usize, usize) -> u8) -> RgbdFrame {
    let [width, height] = WALL;
    let stamp = f64::from(id) / 30.0;
    let pixels = (0..width * height).map(|i| grey(i % width, i / width));
    RgbdFrame {
        id: FrameId(id),
        stamp,
        depth_stamp: stamp,
        gray: GrayImage::from_vec(width, height, pixels.collect()).expect("a whole image"),
        colour: None,
        depth: DepthImage::from_vec(width, height, vec![WALL_M; width * height])
            .expect("a whole image"),
    }
}

/// Texture of a wall of blocks of 4 px, which have corners; `paint` is a seed.
pub(crate) fn blocks(paint: u64, x: usize, y: usize) -> u8 {
    (hash(paint << 40 | ((x / 4) as u64) << 20 | (y / 4) as u64) >> 56) as u8
}
