//! Local bundle adjustment: a keyframe, the ones that see the same, and what they see.

use super::Mapper;
use crate::event::BundleCounts;
use crate::tracking::measurement;
use std::collections::BTreeMap;
use stillpoint_estimation::{
    BundleObservation, BundleOptions, BundleProblem, Intrinsics, adjust_bundle,
};
use stillpoint_map::{KeyframeId, LandmarkId};

/// Who takes part in a local bundle adjustment.
struct Window {
    /// Free keyframes first, then fixed ones.
    keyframes: Vec<KeyframeId>,
    free: usize,
    landmarks: Vec<LandmarkId>,
}

impl Mapper {
    /// Refines the poses of the keyframe and its neighbours together with the landmarks that at least two keyframes see.
    pub(super) fn refine(&mut self, id: KeyframeId) -> BundleCounts {
        let _span = tracing::info_span!("refine").entered();
        let window = self.choose_window(id);
        if window.keyframes.len() < 2 || window.landmarks.is_empty() {
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

    /// Free: the keyframe and the ones that share most with it. Fixed: others that see the same landmarks, and always
    /// the first keyframe of the map.
    fn choose_window(&self, id: KeyframeId) -> Window {
        let view = self.map.view();
        let first = self.order.first().copied();
        let mut free: Vec<KeyframeId> = vec![id];
        free.extend(self.neighbours(id, self.config.window.saturating_sub(1)));
        free.retain(|k| Some(*k) != first);
        let mut landmarks: Vec<LandmarkId> = free
            .iter()
            .filter_map(|k| view.keyframe(*k))
            .flat_map(|k| k.matches.iter().flatten().copied())
            .collect();
        landmarks.sort_unstable();
        landmarks.dedup();
        landmarks.retain(|l| self.map.observations(*l).len() >= 2);
        let mut outside: BTreeMap<KeyframeId, u32> = BTreeMap::new();
        for l in &landmarks {
            for (k, _) in self.map.observations(*l) {
                if !free.contains(k) {
                    *outside.entry(*k).or_default() += 1;
                }
            }
        }
        let mut fixed: Vec<(u32, KeyframeId)> = outside.iter().map(|(k, n)| (*n, *k)).collect();
        fixed.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        fixed.truncate(self.config.fixed_window);
        let mut keyframes = free;
        let free = keyframes.len();
        keyframes.extend(fixed.iter().map(|f| f.1));
        // Without a fixed keyframe nothing would hold the window in place: the oldest free one does then.
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

    /// The arrays of the problem, and who stands behind each observation.
    fn gather(&self, window: &Window) -> Option<(BundleProblem, Vec<(LandmarkId, KeyframeId)>)> {
        let view = self.map.view();
        let mut index: BTreeMap<KeyframeId, u32> = BTreeMap::new();
        let mut poses = Vec::with_capacity(window.keyframes.len());
        for (i, id) in window.keyframes.iter().enumerate() {
            index.insert(*id, i as u32);
            poses.push(view.keyframe(*id)?.world_from_camera.inverse());
        }
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
                    measurement: measurement(&k.data, *feature as usize),
                });
                owners.push((*landmark, *keyframe));
            }
        }
        let camera = Intrinsics::from(&view.keyframe(window.keyframes[0])?.data.camera);
        let problem = BundleProblem {
            camera,
            poses,
            free_poses: window.free,
            points,
            observations,
        };
        Some((problem, owners))
    }
}
