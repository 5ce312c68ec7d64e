//! Duplicates: landmarks of one keyframe searched in another, both ways.

use super::Mapper;
use crate::tracking::matching::STRICT_DISTANCE;
use crate::tracking::measurement;
use std::sync::Arc;
use stillpoint_estimation::Intrinsics;
use stillpoint_features::{Window, best_two};
use stillpoint_geometry::Vec3;
use stillpoint_map::{KeyframeData, KeyframeId, Landmark, LandmarkId};

/// Radius of the search, px on level 0.
const RADIUS_PX: f32 = 3.0;

/// Where a keyframe should see a landmark at `p` (m, its camera coordinates): none when outside its image, or too near or far
/// to be recognised. `radius_px` is the radius on level 0.
pub(crate) fn window_of(
    data: &KeyframeData,
    landmark: &Landmark,
    p: &Vec3,
    radius_px: f32,
    scale_factor: f64,
) -> Option<Window> {
    if p.z <= 0.05 {
        return None;
    }
    let px = data.camera.project(p);
    // Those of the image: undistorting its border for each landmark anew would take most of mapping's time.
    let bounds = data.grid.bounds().map(f64::from);
    if px.x < bounds[0] || px.y < bounds[1] || px.x > bounds[2] || px.y > bounds[3] {
        return None;
    }
    let distance = p.norm();
    let range = landmark.scale_range;
    if distance < 0.8 * f64::from(range.min_distance)
        || distance > 1.2 * f64::from(range.max_distance)
    {
        return None;
    }
    let ratio = f64::from(range.max_distance) / distance;
    let level =
        libm::ceil(libm::log(ratio) / libm::log(scale_factor) - 1e-3).clamp(0.0, 15.0) as u8;
    Some(Window {
        x: px.x as f32,
        y: px.y as f32,
        radius: radius_px * libm::pow(scale_factor, f64::from(level)) as f32,
        min_level: level.saturating_sub(1),
        max_level: level,
    })
}

impl Mapper {
    /// Searches the keyframe's landmarks in its neighbours and their neighbours, and theirs in it. Where a landmark meets
    /// another, the one with fewer observers becomes the other; where it meets a free feature, it gains an observation.
    pub(super) fn fuse(&mut self, id: KeyframeId) -> u32 {
        let _span = tracing::info_span!("fuse").entered();
        let mut targets = self.neighbours(id, self.effort.neighbours as usize);
        for i in 0..targets.len() {
            for second in self.neighbours(targets[i], 5) {
                if second != id && !targets.contains(&second) {
                    targets.push(second);
                }
            }
        }
        let mut fused = 0;
        let own = self.landmarks_of(&[id]);
        for target in &targets {
            fused += self.fuse_into(*target, &own);
        }
        let theirs = self.landmarks_of(&targets);
        fused += self.fuse_into(id, &theirs);
        for landmark in self.landmarks_of(&[id]) {
            self.map.refresh_landmark(landmark);
        }
        self.map.refresh_covisibility(id, self.config.min_shared);
        fused
    }

    /// Live landmarks of some keyframes, by id.
    fn landmarks_of(&self, keyframes: &[KeyframeId]) -> Vec<LandmarkId> {
        let view = self.map.view();
        let mut ids: Vec<LandmarkId> = keyframes
            .iter()
            .filter_map(|k| view.keyframe(*k))
            .flat_map(|k| k.matches.iter().flatten().copied())
            .collect();
        ids.sort_unstable();
        ids.dedup();
        ids
    }

    fn fuse_into(&mut self, target: KeyframeId, landmarks: &[LandmarkId]) -> u32 {
        let Some(keyframe) = self.map.view().keyframe(target).map(Arc::clone) else {
            return 0;
        };
        let camera_from_world = keyframe.world_from_camera.inverse();
        let (r, t) = (
            camera_from_world.rotation_matrix(),
            camera_from_world.translation,
        );
        let data = &keyframe.data;
        let intrinsics = Intrinsics::from(&data.camera);
        let mut seen = vec![false; self.map.view().landmark_bound()];
        for id in keyframe.matches.iter().flatten() {
            seen[id.index()] = true;
        }
        let mut fused = 0;
        for id in landmarks {
            if seen[id.index()] {
                continue;
            }
            let view = self.map.view();
            let (Some(l), Some(position)) = (view.landmark(*id), view.landmark_position(*id))
            else {
                continue;
            };
            let p = r * position + t;
            let Some(window) = window_of(data, l, &p, RADIUS_PX, self.scale_factor) else {
                continue;
            };
            let agrees = |i: u32| {
                let m = measurement(data, i as usize);
                m.chi2(&intrinsics, &p) <= m.gate()
            };
            let best = best_two(
                &data.grid,
                &window,
                &l.descriptor,
                &data.descriptors,
                agrees,
            );
            let Some(best) = best.filter(|b| b.distance <= STRICT_DISTANCE) else {
                continue;
            };
            fused += u32::from(self.join(*id, target, best.index));
        }
        fused
    }

    /// Ties a landmark to a feature: by merging with the landmark that the feature observes, else by observing.
    fn join(&mut self, id: LandmarkId, keyframe: KeyframeId, feature: u32) -> bool {
        let view = self.map.view();
        let occupant = view
            .keyframe(keyframe)
            .and_then(|k| k.matches[feature as usize]);
        let Some(other) = occupant else {
            return self.map.add_observation(id, keyframe, feature);
        };
        let (Some(a), Some(b)) = (view.landmark(id), view.landmark(other)) else {
            return false;
        };
        // Ties go to the older landmark.
        let keep_other = (b.observers, id.0) > (a.observers, other.0);
        let (from, into) = if keep_other { (id, other) } else { (other, id) };
        self.map.merge_landmarks(from, into)
    }
}
