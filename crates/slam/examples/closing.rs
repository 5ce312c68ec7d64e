//! Time and memory of closing one loop at the end of a long path: the looper alone, on a synthetic map of so many keyframes.
//!
//! `cargo run --release -p stillpoint-slam --example closing -- 2000`. Keyframes are 0.2 m apart on one circle and see 400 of the
//! points along it; the last ones see what the first ones saw. One run per process, so that its peak memory is its own.
#![allow(clippy::unwrap_used, clippy::print_stdout)]
// The library reads no clock and no file; what measures it has to.
#![allow(clippy::disallowed_types, clippy::disallowed_methods)]

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;
use stillpoint_estimation::{Purpose, Rng, rng};
use stillpoint_features::{Descriptor, FeatureGrid, Keypoint};
use stillpoint_geometry::{Camera, Se3, Vec3, Vec6};
use stillpoint_map::{KeyframeData, KeyframeId, LandmarkId, Map, NewLandmark};
use stillpoint_slam::{Config, LoopOutcome, Looper, LooperMsg};

const STEP_M: f64 = 0.2;
/// Points for each metre of the path, and how many of them a keyframe sees at most.
const PER_M: f64 = 250.0;
const SEEN: usize = 400;

struct World {
    length: f64,
    /// Place along the path, position, descriptor; by place.
    points: Vec<(f64, Vec3, Descriptor)>,
}

fn normal(random: &mut Rng) -> f64 {
    (0..12).map(|_| random.unit() - 0.5).sum()
}

/// The pose `world_from_camera` at a place (m) on the circle, looking ahead.
fn pose(place: f64, length: f64) -> Se3 {
    let angle = place / length * std::f64::consts::TAU;
    let radius = length / std::f64::consts::TAU;
    Se3::exp(&Vec6::new(0.0, 0.0, 0.0, 0.0, -angle, 0.0))
        * Se3::new(Default::default(), Vec3::new(radius, 0.0, 0.0))
}

impl World {
    fn new(length: f64) -> Self {
        let random = &mut rng(1, 0, Purpose(1000));
        let points = (0..(PER_M * length) as usize).map(|i| {
            let place = i as f64 / PER_M;
            let side = if random.unit() < 0.5 { -1.0 } else { 1.0 };
            let across = side * (0.3 + 1.5 * random.unit());
            let local = Vec3::new(across, 2.0 * random.unit() - 1.0, 0.0);
            let word = |r: &mut Rng| (r.unit() * 2f64.powi(32)) as u64;
            let mut bits = || (word(random) << 32) | word(random);
            let descriptor = Descriptor([bits(), bits(), bits(), bits()]);
            (place, pose(place, length).transform(&local), descriptor)
        });
        Self {
            length,
            points: points.collect(),
        }
    }

    /// What a keyframe at a place sees, and which point each feature is.
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
            descriptors: Vec::new(),
            mappable: Vec::new(),
            grid: FeatureGrid::build(&[], &[], KeyframeData::grid_bounds(camera)),
        };
        let mut which = Vec::new();
        for i in (first..first + (4.0 * PER_M) as usize).map(|i| i % self.points.len()) {
            // The same points are chosen by all: features are repeatable.
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
            });
            data.positions.push([x as f32, y as f32]);
            data.sigma_px.push(1.44);
            data.depths.push((p.z + sigma * normal(random)) as f32);
            data.depth_sigmas.push(sigma as f32);
            data.descriptors.push(seen);
            data.mappable.push(true);
            which.push(i);
        }
        let levels = vec![2; which.len()];
        let bounds = KeyframeData::grid_bounds(camera);
        data.grid = FeatureGrid::build(&data.positions, &levels, bounds);
        (data, which)
    }
}

/// A figure of this process in MB, where the system tells.
fn memory(which: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with(which));
    let kb = line.and_then(|l| l.split_whitespace().nth(1)?.parse::<f64>().ok());
    kb.map_or(f64::NAN, |kb| kb * 1024e-6)
}

fn main() {
    let count: u32 = std::env::args().nth(1).map_or(2000, |a| a.parse().unwrap());
    // The last thirty keyframes see the beginning again.
    let length = STEP_M * f64::from(count - 30);
    let world = World::new(length);
    let camera = Camera::pinhole(640, 480, [500.0, 500.0, 320.0, 240.0]);
    let mut config = Config::default();
    config.looping.enabled = true;
    let mut looper = Looper::new(&config);
    let mut map = Map::new(8, 1.2);
    let random = &mut rng(2, 0, Purpose(1001));
    let (mut known, mut drift) = (BTreeMap::<usize, LandmarkId>::new(), Se3::identity());
    let (mut slowest, mut revisited) = (0.0f64, false);
    for k in 0..count {
        let place = STEP_M * f64::from(k) % length;
        if STEP_M * f64::from(k) >= length && !revisited {
            // What drifted away is not known again.
            (known, revisited) = (BTreeMap::new(), true);
        }
        let (data, which) = world.look(place, &camera, random);
        let mut noise = |size: f64| size * normal(random);
        let step = Vec6::new(
            noise(1e-3),
            noise(1e-3),
            noise(1e-3),
            noise(1e-4),
            noise(1e-4),
            noise(1e-4),
        );
        drift = drift * Se3::exp(&step);
        let (id, parent) = (KeyframeId(k), k.checked_sub(1).map(KeyframeId));
        let estimate = pose(0.0, length) * drift * pose(0.0, length).inverse();
        let data = Arc::new(data);
        let world_from_camera = (estimate * pose(place, length)).normalized();
        map.insert_keyframe(id, data.clone(), world_from_camera, parent);
        for (feature, point) in which.iter().enumerate() {
            if let Some(landmark) = known.get(point) {
                map.add_observation(*landmark, id, feature as u32);
                continue;
            }
            let new = NewLandmark {
                position: world_from_camera.transform(&data.point_in_camera(feature).unwrap()),
                observation: (id, feature as u32),
            };
            if let Some(landmark) = map.insert_landmark(&new) {
                known.insert(*point, landmark);
            }
        }
        map.refresh_covisibility(id, config.mapping.min_shared);
        let view = map.publish();
        let before = memory("VmRSS");
        let start = Instant::now();
        let out = looper.step(LooperMsg::Keyframe { id, view });
        let seconds = start.elapsed().as_secs_f64();
        match out.report.filter(|r| r.outcome == LoopOutcome::Closed) {
            Some(report) => {
                println!("{report:?}");
                println!(
                    "closed at keyframe {k} in {seconds:.2} s; steps that close nothing take {:.1} ms at most; memory {before:.0} MB before, {:.0} MB at most",
                    slowest * 1e3,
                    memory("VmHWM"),
                );
                let start = Instant::now();
                let applied = map.apply(&out.correction.unwrap());
                println!(
                    "applied in {:.3} s, {} landmarks merged",
                    start.elapsed().as_secs_f64(),
                    applied.merged
                );
                return;
            }
            None => slowest = slowest.max(seconds),
        }
    }
    println!("no loop was closed in {count} keyframes");
}
