//! Fuses duplicate landmarks by searching landmarks of one keyframe in another, both ways; search radius as in
//! ORB-SLAM2 (Mur-Artal, Tardos 2017).

use super::{MIN_SHARED, Mapper};
use crate::association::{STRICT_DISTANCE, landmarks_of, measurement, window_of};
use std::sync::Arc;
use stillpoint_estimation::Intrinsics;
use stillpoint_features::best_two;
use stillpoint_map::{KeyframeId, LandmarkId};

/// Search radius, px on level 0, as in ORB-SLAM2 (Mur-Artal, Tardos 2017).
const RADIUS_PX: f32 = 3.0;

impl Mapper {
    /// Searches the keyframe's landmarks in its neighbours, and theirs in it. A match with another landmark merges the
    /// one with fewer observers into the other; a match with a free feature adds an observation.
    pub(super) fn fuse(&mut self, id: KeyframeId) -> u32 {
        let _span = tracing::info_span!("fuse").entered();
        let targets = self.neighbours(id, self.effort.neighbours as usize);
        let mut fused = 0;
        let own = landmarks_of(self.map.view(), &[id]);
        for target in &targets {
            fused += self.fuse_into(*target, &own);
        }
        // Collected after the first direction, which may have merged some of them.
        let theirs = landmarks_of(self.map.view(), &targets);
        fused += self.fuse_into(id, &theirs);
        // Once at the end, since a landmark may have gained several observations.
        for landmark in landmarks_of(self.map.view(), &[id]) {
            self.map.refresh_landmark(landmark);
        }
        self.map.refresh_covisibility(id, MIN_SHARED);
        fused
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
        // A lookup set, since searching the matches for each landmark would be quadratic.
        self.seen.clear();
        for id in keyframe.matches.iter().flatten() {
            self.seen.insert(*id);
        }
        let mut fused = 0;
        for id in landmarks {
            if self.seen.contains(*id) {
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
            let best = best_two(&data.searched(), &window, &l.descriptor, agrees);
            let Some(best) = best.filter(|b| b.distance <= STRICT_DISTANCE) else {
                continue;
            };
            fused += u32::from(self.join(*id, target, best.index));
        }
        fused
    }

    /// Assigns a landmark to a feature, merging it with the feature's landmark if there is one.
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
        let keep_other = (b.observers, id.number()) > (a.observers, other.number());
        let (from, into) = if keep_other { (id, other) } else { (other, id) };
        self.map.merge_landmarks(from, into)
    }
}
