//! A synthetic world along a circle, a walk in it, and the map made by a drifting camera.

use super::estimation::{Purpose, Rng, rng};
use super::features::{Descriptor, Edge, FeatureGrid, Keypoint};
use super::geometry::{Camera, Se3, Vec3, Vec6};
use super::map::{KeyframeData, KeyframeId, LandmarkId, Map, MapView, NewLandmark};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Distance between keyframes, m.
pub(crate) const STEP_M: f64 = 0.2;
/// Points per metre of the path, and maximum number seen by a keyframe.
const PER_M: f64 = 250.0;
pub(crate) const SEEN: usize = 400;
/// Minimum number of landmarks shared by covisible keyframes.
const MIN_SHARED: u32 = 15;

pub(crate) struct World {
    length: f64,
    /// Additional features per keyframe that are never seen again.
    clutter: usize,
    /// Position along the path, position in space, descriptor; in order of the path.
    points: Vec<(f64, Vec3, Descriptor)>,
}

fn normal(random: &mut Rng) -> f64 {
    (0..12).map(|_| random.unit() - 0.5).sum()
}

fn any(random: &mut Rng) -> Descriptor {
    let word = |r: &mut Rng| (r.unit() * 4_294_967_296.0) as u64;
    let mut bits = || (word(random) << 32) | word(random);
    Descriptor([bits(), bits(), bits(), bits()])
}

/// The pose `world_from_camera` at a position (m) on the circle, looking ahead.
pub(crate) fn pose(place: f64, length: f64) -> Se3 {
    let angle = place / length * std::f64::consts::TAU;
    let radius = length / std::f64::consts::TAU;
    Se3::exp(&Vec6::new(0.0, 0.0, 0.0, 0.0, -angle, 0.0))
        * Se3::new(Default::default(), Vec3::new(radius, 0.0, 0.0))
}

impl World {
    pub(crate) fn new(length: f64) -> Self {
        let random = &mut rng(1, 0, Purpose(1000));
        let points = (0..(PER_M * length) as usize).map(|i| {
            let place = i as f64 / PER_M;
            let side = if random.unit() < 0.5 { -1.0 } else { 1.0 };
            let across = side * (0.3 + 1.5 * random.unit());
            let local = Vec3::new(across, 2.0 * random.unit() - 1.0, 0.0);
            (place, pose(place, length).transform(&local), any(random))
        });
        Self {
            length,
            clutter: 0,
            points: points.collect(),
        }
    }

    /// Adds features to every keyframe that are never seen again.
    #[allow(dead_code)] // Only the laboratory needs as many as real images have.
    pub(crate) fn with_clutter(self, clutter: usize) -> Self {
        Self { clutter, ..self }
    }

    /// Repeats the first `stretch` metres exactly from position `at` (m) on.
    #[allow(dead_code)] // Only the test has equal places.
    pub(crate) fn with_copy(mut self, at: f64, stretch: f64) -> Self {
        let there = pose(at, self.length) * pose(0.0, self.length).inverse();
        let first = (at * PER_M) as usize;
        for i in 0..(stretch * PER_M) as usize {
            let (_, point, descriptor) = self.points[i];
            self.points[first + i] = (at, there.transform(&point), descriptor);
        }
        self
    }

    /// Keyframe data at a position, and the point index of each feature.
    fn look(&self, place: f64, camera: &Camera, random: &mut Rng) -> (KeyframeData, Vec<usize>) {
        let camera_from_world = pose(place, self.length).inverse();
        let first = (place * PER_M) as usize;
        let mut data = KeyframeData {
            stamp: place,
            camera: *camera,
            keypoints: Vec::new(),
            positions: Vec::new(),
            sigma_px: Vec::new(),
            depths: Vec::new(),
            depth_sigmas: Vec::new(),
            descriptors: Arc::default(),
            mappable: Vec::new(),
            grid: FeatureGrid::build(&[], &[], KeyframeData::grid_bounds(camera)),
        };
        let (mut which, mut descriptors) = (Vec::new(), Vec::new());
        for i in (first..first + (4.0 * PER_M) as usize).map(|i| i % self.points.len()) {
            // All keyframes select the same points, as repeatable features.
            if which.len() >= SEEN || i.is_multiple_of(3) {
                continue;
            }
            let (_, point, descriptor) = &self.points[i];
            let p = camera_from_world.transform(point);
            let x = 500.0 * p.x / p.z + 320.0 + 0.7 * normal(random);
            let y = 500.0 * p.y / p.z + 240.0 + 0.7 * normal(random);
            if p.z < 0.5 || !(0.0..640.0).contains(&x) || !(0.0..480.0).contains(&y) {
                continue;
            }
            let sigma = 0.002 + 0.002 * p.z * p.z;
            let mut seen = *descriptor;
            for _ in 0..8 {
                let bit = (random.unit() * 256.0) as usize % 256;
                seen.0[bit / 64] ^= 1 << (bit % 64);
            }
            data.keypoints.push(Keypoint {
                x: x as f32,
                y: y as f32,
                level: 2,
                angle: 0.0,
                response: 50.0,
                edge: Edge::default(),
            });
            data.positions.push([x as f32, y as f32]);
            data.sigma_px.push(1.44);
            data.depths.push((p.z + sigma * normal(random)) as f32);
            data.depth_sigmas.push(sigma as f32);
            descriptors.push(seen);
            data.mappable.push(true);
            which.push(i);
        }
        for _ in 0..self.clutter {
            let at = [random.unit() * 639.0, random.unit() * 479.0].map(|v| v as f32);
            data.keypoints.push(Keypoint {
                x: at[0],
                y: at[1],
                level: 2,
                angle: 0.0,
                response: 20.0,
                edge: Edge::default(),
            });
            data.positions.push(at);
            data.sigma_px.push(1.44);
            data.depths.push(0.0);
            data.depth_sigmas.push(0.0);
            descriptors.push(any(random));
            data.mappable.push(true);
        }
        // Exact capacity, as in frames.
        data.keypoints.shrink_to_fit();
        data.positions.shrink_to_fit();
        for list in [&mut data.sigma_px, &mut data.depths, &mut data.depth_sigmas] {
            list.shrink_to_fit();
        }
        data.mappable.shrink_to_fit();
        descriptors.shrink_to_fit();
        data.descriptors = Arc::new(descriptors);
        let levels = vec![2; data.len()];
        let bounds = KeyframeData::grid_bounds(camera);
        data.grid = FeatureGrid::build(&data.positions, &levels, bounds);
        (data, which)
    }
}

/// A map that grows by a keyframe every 0.2 m with drifting poses. Points seen again after a round are not matched.
pub(crate) struct Walk {
    world: World,
    camera: Camera,
    pub(crate) map: Map,
    known: BTreeMap<usize, LandmarkId>,
    rounds: f64,
    drift: Se3,
    random: Rng,
    keyframes: u32,
    /// Interval of keyframes after which nothing is matched.
    gap: Option<u32>,
    /// Distance between keyframes, m.
    pace: f64,
}

impl Walk {
    pub(crate) fn new(world: World) -> Self {
        Self {
            world,
            camera: Camera::pinhole(640, 480, [500.0, 500.0, 320.0, 240.0]),
            map: Map::new(5, 1.45),
            known: BTreeMap::new(),
            rounds: 0.0,
            drift: Se3::identity(),
            random: rng(2, 0, Purpose(1001)),
            keyframes: 0,
            gap: None,
            pace: STEP_M,
        }
    }

    /// Adds gaps, as after fast turns: every `every` keyframes nothing earlier is matched, and the pose is off by some
    /// 6 cm and 1 degree.
    #[allow(dead_code)] // The laboratory has none.
    pub(crate) fn with_gaps(mut self, every: u32) -> Self {
        self.gap = Some(every);
        self
    }

    #[allow(dead_code)] // The laboratory walks as fast as it can.
    pub(crate) fn at_pace(mut self, pace: f64) -> Self {
        self.pace = pace;
        self
    }

    /// Memory of the world and of the known landmarks, bytes.
    #[allow(dead_code)] // The test measures none.
    pub(crate) fn world_bytes(&self) -> usize {
        // A tree node is half empty at worst.
        size_of_val(&*self.world.points) + 2 * 16 * self.known.len()
    }

    #[allow(dead_code)] // The laboratory knows no truth.
    pub(crate) fn truth(&self, id: KeyframeId) -> Se3 {
        pose(self.pace * f64::from(id.0), self.world.length)
    }

    /// Adds a keyframe; returns its id and the map with it.
    pub(crate) fn step(&mut self) -> (KeyframeId, Arc<MapView>) {
        let length = self.world.length;
        let gone = self.pace * f64::from(self.keyframes);
        let id = KeyframeId(self.keyframes);
        let parent = self.keyframes.checked_sub(1).map(KeyframeId);
        self.keyframes += 1;
        let rounds = (gone / length).floor();
        if rounds > self.rounds {
            (self.known, self.rounds) = (BTreeMap::new(), rounds);
        }
        let place = gone - rounds * length;
        let is_gap = self.gap.is_some_and(|n| id.0 > 0 && id.0.is_multiple_of(n));
        if is_gap {
            self.known = BTreeMap::new();
        }
        let (data, which) = self.world.look(place, &self.camera, &mut self.random);
        let mut noise = |size: f64| size * normal(&mut self.random);
        let (m, rad) = if is_gap { (0.035, 0.01) } else { (5e-4, 5e-5) };
        let step = Vec6::new(
            noise(m),
            noise(m),
            noise(m),
            noise(rad),
            noise(rad),
            noise(rad),
        );
        self.drift = self.drift * Se3::exp(&step);
        let data = Arc::new(data);
        let start = pose(0.0, length);
        let estimate = start * self.drift * start.inverse();
        let world_from_camera = (estimate * pose(place, length)).normalized();
        self.map
            .insert_keyframe(id, data.clone(), world_from_camera, parent);
        for (feature, point) in which.iter().enumerate() {
            let observation = (id, feature as u32);
            if let Some(landmark) = self.known.get(point) {
                self.map.add_observation(*landmark, id, feature as u32);
            } else if let Some(p) = data.point_in_camera(feature) {
                let position = world_from_camera.transform(&p);
                let new = NewLandmark {
                    position,
                    observation,
                };
                let landmark = self.map.insert_landmark(&new);
                self.known.extend(landmark.map(|l| (*point, l)));
            }
        }
        self.map.refresh_covisibility(id, MIN_SHARED);
        (id, self.map.publish())
    }
}
