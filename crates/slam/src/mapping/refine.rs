//! Local bundle adjustment of a keyframe, its covisible keyframes and their landmarks; other keyframes that see these
//! are fixed, as in ORB-SLAM2 (Mur-Artal, Tardos 2017).

use super::Mapper;
use crate::association::{landmarks_of, measurement_in};
use crate::report::BundleCounts;
use std::collections::BTreeMap;
use stillpoint_estimation::{
    BundleObservation, BundleOptions, BundleProblem, Intrinsics, adjust_bundle,
};
use stillpoint_map::{KeyframeId, LandmarkId};

struct Window {
    /// Free keyframes first, then fixed ones.
    keyframes: Vec<KeyframeId>,
    free: usize,
    landmarks: Vec<LandmarkId>,
}

impl Mapper {
    /// Optimises the poses of the keyframe and its neighbours together with the landmarks seen by at least two
    /// keyframes.
    pub(super) fn refine(&mut self, id: KeyframeId) -> BundleCounts {
        let _span = tracing::info_span!("refine").entered();
        let window = self.choose_window(id);
        if window.keyframes.len() < 2 || window.free == 0 || window.landmarks.is_empty() {
            return BundleCounts::default();
        }
        let Some((mut problem, features)) = self.gather(&window) else {
            return BundleCounts::default();
        };
        let report = adjust_bundle(&mut problem, &BundleOptions::default());
        for (keyframe, pose) in window.keyframes[..window.free].iter().zip(&problem.poses) {
            self.map.set_pose(*keyframe, pose.inverse());
        }
        for (landmark, position) in window.landmarks.iter().zip(&problem.points) {
            self.map.set_position(*landmark, *position);
        }
        let mut outliers = 0;
        for ((o, (landmark, keyframe)), is_outlier) in problem
            .observations
            .iter()
            .zip(&features)
            .zip(&report.outliers)
        {
            debug_assert_eq!(window.landmarks[o.point as usize], *landmark);
            if *is_outlier {
                // Removed so that the mismatch does not pull at the map again.
                self.map.remove_observation(*landmark, *keyframe);
                outliers += 1;
            }
        }
        BundleCounts {
            free_keyframes: window.free as u32,
            fixed_keyframes: (window.keyframes.len() - window.free) as u32,
            landmarks: window.landmarks.len() as u32,
            observations: problem.observations.len() as u32,
            outliers,
            iterations: report.iterations as u32,
        }
    }

    /// Free: the keyframe and its most covisible ones. Fixed: other keyframes that see the same landmarks, the first
    /// keyframe of the map, and those that share too few landmarks, as after a time among people: a few mismatches
    /// would displace them, and their tracked pose is better.
    fn choose_window(&self, id: KeyframeId) -> Window {
        let view = self.map.view();
        let first = self.order.first().copied();
        let mut free: Vec<KeyframeId> = vec![id];
        free.extend(self.neighbours(id, self.effort.window.saturating_sub(1) as usize));
        free.retain(|k| Some(*k) != first);
        let mut landmarks = landmarks_of(view, &free);
        // A landmark seen by a single keyframe adds no constraint.
        landmarks.retain(|l| self.map.observations(*l).len() >= 2);
        let held = |k: &KeyframeId| {
            let matches = view.keyframe(*k).map(|k| k.matches.iter().flatten());
            let shared = matches.map(|m| m.filter(|l| landmarks.binary_search(l).is_ok()).count());
            shared.is_some_and(|n| n >= self.min_held)
        };
        let (free, loose): (Vec<KeyframeId>, Vec<KeyframeId>) = free.into_iter().partition(held);
        let mut outside: BTreeMap<KeyframeId, u32> = BTreeMap::new();
        for l in &landmarks {
            for (k, _) in self.map.observations(*l) {
                if !free.contains(k) && !loose.contains(k) {
                    *outside.entry(*k).or_default() += 1;
                }
            }
        }
        let mut fixed: Vec<(u32, KeyframeId)> = outside.iter().map(|(k, n)| (*n, *k)).collect();
        // Those that see most of the landmarks first.
        fixed.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        fixed.truncate(self.fixed_window());
        let mut keyframes = free;
        let free = keyframes.len();
        keyframes.extend(loose);
        keyframes.extend(fixed.iter().map(|f| f.1));
        // At least one keyframe must be fixed: the oldest if there is no other.
        let mut free = free;
        if keyframes.len() == free && free > 1 {
            keyframes.sort_unstable_by(|a, b| b.cmp(a));
            free -= 1;
        }
        Window {
            keyframes,
            free,
            landmarks,
        }
    }

    /// The problem, and the landmark and keyframe of each observation. All measurements are converted to one camera.
    fn gather(&self, window: &Window) -> Option<(BundleProblem, Vec<(LandmarkId, KeyframeId)>)> {
        let view = self.map.view();
        let mut index: BTreeMap<KeyframeId, u32> = BTreeMap::new();
        let mut poses = Vec::with_capacity(window.keyframes.len());
        for (i, id) in window.keyframes.iter().enumerate() {
            index.insert(*id, i as u32);
            poses.push(view.keyframe(*id)?.world_from_camera.inverse());
        }
        // Keyframes of a loaded map may have another calibration.
        let camera = view.keyframe(window.keyframes[0])?.data.camera;
        let mut points = Vec::with_capacity(window.landmarks.len());
        let mut observations = Vec::new();
        let mut owners = Vec::new();
        for (i, landmark) in window.landmarks.iter().enumerate() {
            points.push(view.landmark_position(*landmark)?);
            for (keyframe, feature) in self.map.observations(*landmark) {
                let (Some(pose), Some(k)) = (index.get(keyframe), view.keyframe(*keyframe)) else {
                    continue;
                };
                observations.push(BundleObservation {
                    pose: *pose,
                    point: i as u32,
                    measurement: measurement_in(&k.data, *feature as usize, &camera),
                });
                owners.push((*landmark, *keyframe));
            }
        }
        let problem = BundleProblem {
            camera: Intrinsics::from(&camera),
            poses,
            free_poses: window.free,
            points,
            observations,
        };
        Some((problem, owners))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A failed helper is a failed test.
    use super::*;
    use crate::config::Config;
    use std::sync::Arc;
    use stillpoint_features::{Descriptor, Edge, FeatureGrid, Keypoint};
    use stillpoint_geometry::{Camera, Se3, Vec3};
    use stillpoint_map::{KeyframeData, NewLandmark};

    fn points() -> Vec<Vec3> {
        let point = |i: u32| {
            let (x, y) = (f64::from(i % 8), f64::from(i / 8));
            Vec3::new(0.2 * x - 0.7, 0.2 * y - 0.5, 2.0 + 0.1 * ((x * y) % 3.0))
        };
        (0..48).map(point).collect()
    }

    /// Data of a keyframe `x` m to the right of the origin.
    fn seen(camera: Camera, x: f64) -> KeyframeData {
        let in_camera = |p: &Vec3| Vec3::new(p.x - x, p.y, p.z);
        let pixels: Vec<[f32; 2]> = points()
            .iter()
            .map(|p| camera.project(&in_camera(p)))
            .map(|px| [px.x as f32, px.y as f32])
            .collect();
        let n = pixels.len();
        let keypoint = |p: &[f32; 2]| Keypoint {
            x: p[0],
            y: p[1],
            level: 0,
            angle: 0.0,
            response: 1.0,
            edge: Edge::default(),
        };
        KeyframeData {
            stamp: x,
            camera,
            keypoints: pixels.iter().map(keypoint).collect(),
            sigma_px: vec![1.0; n],
            depths: points().iter().map(|p| p.z as f32).collect(),
            depth_sigmas: vec![0.01; n],
            descriptors: Arc::new(vec![Descriptor([7; 4]); n]),
            mappable: vec![true; n],
            grid: FeatureGrid::build(&pixels, &vec![0; n], KeyframeData::grid_bounds(&camera)),
            positions: pixels,
        }
    }

    /// A mapper with keyframes at `x` m to the right, each with its camera, and a landmark per point. `observed` maps
    /// (keyframe, point) to the feature.
    fn mapper(places: &[(f64, Camera)], observed: impl Fn(usize, usize) -> Option<u32>) -> Mapper {
        let mut mapper = Mapper::new(&Config::default());
        for (id, (x, camera)) in (0..).zip(places) {
            let pose = Se3 {
                translation: Vec3::new(*x, 0.0, 0.0),
                ..Se3::identity()
            };
            let parent = (id > 0).then_some(KeyframeId(0));
            let data = Arc::new(seen(*camera, *x));
            mapper
                .map
                .insert_keyframe(KeyframeId(id), data, pose, parent);
            mapper.order.push(KeyframeId(id));
        }
        for (i, position) in points().iter().enumerate() {
            let new = NewLandmark {
                position: *position,
                observation: (KeyframeId(0), i as u32),
            };
            let landmark = mapper.map.insert_landmark(&new).unwrap();
            for k in 1..places.len() {
                if let Some(feature) = observed(k, i) {
                    let id = KeyframeId(k as u32);
                    assert!(mapper.map.add_observation(landmark, id, feature));
                }
            }
        }
        for id in 0..places.len() as u32 {
            mapper.map.refresh_covisibility(KeyframeId(id), 5);
        }
        mapper
    }

    /// A map started with one calibration and continued with another is not distorted.
    #[test]
    fn keyframes_of_two_calibrations_are_refined_together() {
        let first = Camera::pinhole(640, 480, [525.0, 525.0, 319.5, 239.5]);
        let second = Camera::pinhole(640, 480, [529.0, 527.0, 317.0, 241.5]);
        let cameras = [first, first, first, second];
        let places = [0.0, 0.1, 0.2, 0.3];
        let placed: Vec<(f64, Camera)> = places.into_iter().zip(cameras).collect();
        let mut mapper = mapper(&placed, |_, point| Some(point as u32));
        let report = mapper.refine(KeyframeId(3));
        assert_eq!((report.outliers, report.observations), (0, 4 * 48));
        let view = mapper.map.view();
        for (id, x) in (0..).zip(places) {
            let centre = view.keyframe(KeyframeId(id)).unwrap().centre();
            let off = (centre - Vec3::new(x, 0.0, 0.0)).norm();
            assert!(off < 1e-4, "keyframe {id} is off by {off} m");
        }
        for (id, landmark) in view.landmarks() {
            let off = (view.landmark_position(id).unwrap() - points()[id.index()]).norm();
            assert!(off < 1e-4, "{landmark:?} is off by {off} m");
        }
    }

    /// A keyframe with a few, wrong landmark matches keeps its tracked pose. Control: without the limit it is pulled
    /// away.
    #[test]
    fn few_wrong_matches_do_not_move_a_keyframe() {
        let camera = Camera::pinhole(640, 480, [525.0, 525.0, 319.5, 239.5]);
        let moved = |min_held: usize| {
            // The third keyframe confuses each point with its right neighbour, as in a repetitive texture.
            let mut mapper = mapper(&[0.0, 0.1, 0.2].map(|x| (x, camera)), |k, point| {
                let wrong = (16..23).contains(&point).then_some(point as u32 + 1);
                if k == 2 { wrong } else { Some(point as u32) }
            });
            mapper.min_held = min_held;
            mapper.refine(KeyframeId(2));
            let view = mapper.map.view();
            let centre = view.keyframe(KeyframeId(2)).unwrap().centre();
            (centre - Vec3::new(0.2, 0.0, 0.0)).norm()
        };
        let held = Config::default().tracking.min_inliers;
        assert_eq!(moved(held), 0.0);
        assert!(moved(0) > 0.1, "{}", moved(0));
    }

    #[test]
    fn measurements_of_the_same_camera_are_unchanged() {
        let camera = Camera::pinhole(640, 480, [525.3, 524.7, 319.1, 239.9]);
        let data = seen(camera, 0.1);
        for i in 0..data.len() {
            let own = crate::association::measurement(&data, i);
            assert_eq!(measurement_in(&data, i, &camera), own);
        }
    }
}
